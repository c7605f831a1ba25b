"""Contours of any field on a triangulated skin."""
