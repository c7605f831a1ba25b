"""`palpate selftest`: three stimuli that a hand should feel, and a report of them to send back."""
