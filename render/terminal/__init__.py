"""Messages, progress and results of commands; text from others is shown, and the terminal does not obey it."""
