"""Explorations in NumPy, as the kernels are judged: slow, and each stroke by itself."""
