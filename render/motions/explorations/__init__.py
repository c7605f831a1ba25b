"""Synthetic explorations of objects: options and persons, checked without Warp, and the poses, made by kernels."""
