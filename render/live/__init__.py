"""A hand that moves now: poses from its tracker, drawn and handed to the array within milliseconds."""
