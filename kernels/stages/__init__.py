"""The kernels of prune and transform stages, and of objects that move."""
