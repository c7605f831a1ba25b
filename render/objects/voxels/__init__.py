"""Voxel volumes as solids: files, values, places, and volumes made of meshes."""
