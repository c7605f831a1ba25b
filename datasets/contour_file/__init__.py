"""The contour file: its header, written while it is computed, read lazily, checked."""
