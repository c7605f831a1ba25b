"""Recorded hands from the files that trackers write."""
