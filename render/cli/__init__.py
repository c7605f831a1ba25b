"""The command line: the commands as their options, and what they do."""
