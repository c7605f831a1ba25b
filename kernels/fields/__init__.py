"""Solids as functions of position: below 0 inside."""
