"""How commands talk to people: progress, warnings, results; foreign text is shown and not obeyed."""
