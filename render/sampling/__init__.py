"""Contours over time -> focal points at the update rate."""
