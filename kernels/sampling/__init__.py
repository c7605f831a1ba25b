"""Focal points of many motions at once: routes, tracks and samples of contours on a device."""
