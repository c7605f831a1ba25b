"""Focal points of many motions at once: routes, cycles and samples of contours on a device."""
