"""Whole loops of the sections of a closed surface, in the frames of their patches, in float64; patches cut nothing off.

`render/intersection/section_regularisation.py` regularises a section from them, and asks for corners of its polygons
that lie nearly on another edge of their section, where gaps of hardly any width end.
"""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ..offsets import BLOCK, scan_counts
from ..patch import EXACT, Frame, Patch, half_extents, section_frame
from .half_edges import OPEN, Surface
from .join import Entries, entry_count, entry_slot, join_sections
from .pieces import ContourPieces, CutPlanes, section_of, start_of
from .walk import crossing_after, crossing_at, point_of

wp.set_module_options(EXACT)


class PlaneLoops(NamedTuple):
    """Device arrays of closed loops, the inside of the solid to their left seen from the +n side."""

    points: wp.array  # vec2d along u and v [m], the first of a loop not repeated at its end, shape [point]
    loop_start: wp.array  # offsets into points, int64, shape [loop + 1]
    section_start: wp.array  # offsets of each section's loops, int64, shape [section + 1]
    frame: wp.array  # origin [m], u and v of each section's patch, array frame, vec3d, shape [section, 3]


@wp.func
def loop_length(surface: Surface, f: Frame, half: int):
    """Number of crossings around the loop of a half-edge that runs down through the plane."""
    c = crossing_after(surface, f, crossing_at(surface, f, half))
    count = int(1)
    while c.half != half and c.half != OPEN:
        count += 1
        c = crossing_after(surface, f, c)
    return count


@wp.kernel
def _count_crossings(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    # Out:
    crossings: wp.array[wp.int64],  # of each section's loops, zero-initialised, shape [section + 1]
):
    """Count the crossings of all loops of a query."""
    query = wp.tid()
    count = entry_count(entries.count[query])
    if count == 0:
        return
    section = section_of(pieces, query)
    f = section_frame(pose, patch, section)
    base = start_of(pieces, query)
    total = int(0)
    for e in range(count):
        slot = entry_slot(entries.entry[base + wp.int64(e) * pieces.stride])
        total += loop_length(surface, f, pieces.half[base + wp.int64(slot) * pieces.stride])
    crossings[section] = wp.int64(total)


@wp.kernel
def _draw_loops(
    # In:
    surface: Surface,
    pose: wp.array2d[wp.transform],
    patch: wp.array[Patch],
    pieces: ContourPieces,
    entries: Entries,
    bounded: int,  # 0: points are brought to no side of a patch
    section_start: wp.array[wp.int64],
    point_start: wp.array[wp.int64],  # offsets of each section's points, shape [section + 1]
    # Out:
    points: wp.array[wp.vec2d],
    loop_start: wp.array[wp.int64],
):
    """Write the loops of a query in the order of its entries."""
    query = wp.tid()
    section = section_of(pieces, query)
    f = section_frame(pose, patch, section)
    side = half_extents(patch[section % patch.shape[0]], bounded)
    base = start_of(pieces, query)
    i = point_start[section]
    for e in range(entry_count(entries.count[query])):
        slot = entry_slot(entries.entry[base + wp.int64(e) * pieces.stride])
        half = pieces.half[base + wp.int64(slot) * pieces.stride]
        loop_start[section_start[section] + wp.int64(e)] = i
        c = crossing_at(surface, f, half)
        points[i] = point_of(f, c, side)
        c = crossing_after(surface, f, c)
        while c.half != half and c.half != OPEN:
            i += wp.int64(1)
            points[i] = point_of(f, c, side)
            c = crossing_after(surface, f, c)
        i += wp.int64(1)


@wp.kernel
def _write_frames(pose: wp.array2d[wp.transform], patch: wp.array[Patch], frame: wp.array2d[wp.vec3d]):
    """Write where a section's patch is; at the origin where points are written relative to it."""
    section = wp.tid()
    f = section_frame(pose, patch, section)
    if f.relative == 1:
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        f.origin = wp.vec3d(zero, zero, zero)
        f.u = wp.vec3d(one, zero, zero)
        f.v = wp.vec3d(zero, one, zero)
    frame[section, 0] = f.origin
    frame[section, 1] = f.u
    frame[section, 2] = f.v


def plane_loops(
    surface: Any,
    pose: wp.array,
    patch: wp.array,
    *,
    bounded: bool = True,
    limit: int | None = None,
) -> PlaneLoops:
    """Find all loops of a closed surface in the whole planes of all patches at all poses.

    pose, patch: as of `CutPlanes`; bounded: whether points that are flush with a side of a patch lie on it. Loops of a
    section come in the order of their keys, see docs/develop/geometry.md.
    Raises PointLimitError, before memory is allocated for them, if the loops have more points than `limit`.
    """
    device = pose.device
    joined = join_sections(CutPlanes(surface, pose, patch, bounded=False, closes=False), draws=False)
    crossings = wp.zeros_like(joined.point_start)
    launch = partial(wp.launch, device=device, block_dim=BLOCK)
    for pieces, entries in joined.blocks:
        inputs = [surface, pose, patch, pieces, entries]
        launch(_count_crossings, pieces.count.shape[0], inputs=inputs, outputs=[crossings])
    (point_start,), (point_count,) = scan_counts(crossings, limit=limit)
    section_start, loop_count = joined.section_start, joined.polyline_count
    points = wp.empty(point_count, dtype=wp.vec2d, device=device)
    loop_start = wp.full(loop_count + 1, point_count, dtype=wp.int64, device=device)
    for pieces, entries in joined.blocks:
        inputs = [surface, pose, patch, pieces, entries, int(bounded), section_start, point_start]
        launch(_draw_loops, pieces.count.shape[0], inputs=inputs, outputs=[points, loop_start])
    section_count = pose.shape[0] * patch.shape[0]
    frame = wp.empty((section_count, 3), dtype=wp.vec3d, device=device)
    launch(_write_frames, section_count, inputs=[pose, patch], outputs=[frame])
    return PlaneLoops(points, loop_start, section_start, frame)


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
