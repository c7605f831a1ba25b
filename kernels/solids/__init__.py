"""Computations on objects before rendering: exact predicates, crossings, nesting, voxels, surfaces."""
