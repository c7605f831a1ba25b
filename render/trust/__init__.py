"""Permission to run code that data name, and the way that code is found and run."""
