"""Corners of plane polygons that lie nearly on another edge of their section, where gaps of hardly any width end."""

import numpy as np
import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.func
def square_to_segment(p: wp.vec2d, a: wp.vec2d, b: wp.vec2d):
    """Square of a point's distance from a segment."""
    step = b - a
    off = p - a
    part = wp.dot(off, step) / wp.max(wp.dot(step, step), wp.float64(1e-300))
    off = off - wp.clamp(part, wp.float64(0.0), wp.float64(1.0)) * step
    return wp.dot(off, off)


@wp.kernel
def _find_near_corners(
    # In:
    points: wp.array[wp.vec2d],
    after: wp.array[wp.int64],  # index of the corner that follows each
    section: wp.array[wp.int64],  # of each corner
    start: wp.array[wp.int64],  # offsets of sections into corners, shape [section + 1]
    limit: wp.float64,
    # Out:
    near: wp.array[wp.uint8],  # shape [section], zero-initialised
):
    """Compare a corner with all edges of its section but its own two."""
    i = wp.int64(wp.tid())
    own = section[i]
    p = points[i]
    j = start[own]
    while j < start[own + wp.int64(1)] and near[own] == wp.uint8(0):
        if j != i and after[j] != i:
            a = points[j]
            b = points[after[j]]
            beside = p[0] < wp.min(a[0], b[0]) - limit or p[0] > wp.max(a[0], b[0]) + limit
            joined = after[i] == j and wp.length(p - a) < limit  # by an edge that is shorter than the limit
            joined = joined or (after[after[j]] == i and wp.length(p - b) < limit)
            if not beside and not joined and square_to_segment(p, a, b) < limit * limit:
                near[own] = wp.uint8(1)
        j += wp.int64(1)


def have_near_corners(
    points: np.ndarray, after: np.ndarray, section: np.ndarray, section_count: int, limit: float
) -> np.ndarray:
    """Whether a corner of each section lies within a limit of an edge that does not end there, bool, shape [section].

    An edge to which the corner is joined by one that is shorter than the limit is passed over.
    points: corners of polygons, float64, shape [corner, 2]. after: index of the corner that follows each around its
    polygon; section: its section's number, ascending; both int64, shape [corner]. Runs on the CPU.
    """
    start = np.searchsorted(section, np.arange(section_count + 1)).astype(np.int64)
    corners = wp.array(np.ascontiguousarray(points), dtype=wp.vec2d, device="cpu")
    numbers = [
        wp.array(np.ascontiguousarray(a, np.int64), dtype=wp.int64, device="cpu") for a in (after, section, start)
    ]
    near = wp.zeros(section_count, dtype=wp.uint8, device="cpu")
    inputs = [corners, *numbers, wp.float64(limit)]
    wp.launch(_find_near_corners, len(points), inputs=inputs, outputs=[near], device="cpu", block_dim=BLOCK)
    return near.numpy() > 0
