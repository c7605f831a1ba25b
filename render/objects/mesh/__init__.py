"""Meshes as solids: files, repair step by step, report, cache."""
