"""Intersection strategies as data: raw intersection, prune stages, transform stages."""
