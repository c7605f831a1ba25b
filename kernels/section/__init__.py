"""Meshes cut by patches: contours found, walked, joined and written."""
