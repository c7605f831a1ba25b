"""Focal points -> drives -> frames -> arrays."""
