"""Drives of transducers -> what they emit, pressure at points, and power that arrives late."""
