"""The command line: options of each command, and what the commands do."""
