"""Pieces of contours found in the fastest way for a surface; and the search for large ones."""
