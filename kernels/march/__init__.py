"""Contours of any field on patches, by marching squares on a grid over each patch."""
