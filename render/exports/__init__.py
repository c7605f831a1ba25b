"""Contour files as files that other programs open: VTKHDF, CSV, NPZ, point lists, files of focal points."""
