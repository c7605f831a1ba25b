"""The kernels of stages that fill regions of contours: which regions, with what, and where it belongs."""
