"""Hand motions: poses of a palm over time, from files or made."""
