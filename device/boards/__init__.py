"""The arrays: one folder each."""
