"""The options of commands: of one each, and those that several share."""
