"""Permission to run code that data name, and how that code is found and run."""
