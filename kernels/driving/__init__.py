"""Focal points -> delays of transducers."""
