"""Frames to arrays in time, guarded, and off on every way out."""
