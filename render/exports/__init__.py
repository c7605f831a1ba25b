"""Contour files as files that other programs open: VTKHDF, CSV, NPZ, point lists, scripts for an AUTD3."""
