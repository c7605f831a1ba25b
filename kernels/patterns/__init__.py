"""Closed solids of few vertices cut by patches: a table has the loops for each pattern of vertices above the plane."""
