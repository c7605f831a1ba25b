"""Sections of meshes that cross themselves: the region where the winding number says inside, and its boundary.

The loops in which a plane cuts such a mesh cross one another, so they are not the boundary of the solid's section. Here
each loop is cut off at the patch's sides, and manifold3d's `CrossSection` (Clipper2) finds the polygons that bound what
is inside. Polygons are all it returns. An edge of theirs with both ends on one side of the patch is the hand's, all
others are the object's: a contour that runs along a side counts as the patch's own boundary, as in the kernels.

Coordinates are rounded to a lattice of 2^-40 m (0.9e-12 m), where loops end within 1 km of the patch's middle.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from manifold3d import CrossSection, FillRule

from ..kernels.pen import HAND, OBJECT
from ..kernels.plane_loops import PlaneLoops
from .contours import ContourBatch, join_batches, object_part

RULES = {"winding": FillRule.Positive, "even-odd": FillRule.EvenOdd}
LATTICE_BITS = 40  # finest lattice: 2^-40 m
COORDINATE_BITS = 50  # a coordinate has at most as many bits above the lattice, so that float64 holds it
UNIT_BITS = 27  # `CrossSection` rounds to 2^-27 of its unit (measured): Clipper2's 8 decimal places, as a power of 2
THIN = 4.0  # steps of the lattice; a polygon that is narrower in the mean is rounding's, not the solid's
BLOCK_POINTS = 2**18  # of loops that are worked on at a time: some 100 bytes each


class Loops(NamedTuple):
    """Closed loops in the frames of their patches, on the host."""

    points: np.ndarray
    """Along u and v [m], the first of a loop not repeated, float64, shape [point, 2]."""
    start: np.ndarray
    """Offsets into points, int64, shape [loop + 1]."""
    section: np.ndarray
    """Which section each loop belongs to, ascending, int64, shape [loop]."""


def regularised_contours(
    loops: PlaneLoops, patch: wp.array, *, solid: str, bounded: bool, closes: bool
) -> ContourBatch:
    """The boundary of the regularised section in each patch (CC), or what of it lies within (OC), on the host.

    loops: of `plane_loops`; patch: those it was called with. solid: which winding numbers are inside, one of RULES.
    bounded: whether contours end at the patches' sides; closes: whether they are closed along them, not for the whole
    plane. A polyline that meets the patch's boundary starts where the object's contour enters the patch, or at corner 0
    if nothing but the boundary is left; a loop starts at its lowest point along u, then v. Of a section those that meet
    the boundary come first, each group in the order of where they start.
    """
    points, loop_start, section_start, frame = (array.numpy() for array in loops)
    half = patch.numpy()["half"].astype(np.float64).reshape(-1, 2)
    batches = []
    for first, stop in _blocks(loop_start[section_start], len(half)):
        lines = slice(section_start[first], section_start[stop])
        start = loop_start[lines.start : lines.stop + 1]
        section = np.repeat(np.arange(stop - first), np.diff(section_start[first : stop + 1]))
        own = Loops(points[start[0] : start[-1]].reshape(-1, 2), start - start[0], section)
        sides = np.tile(half, ((stop - first) // len(half), 1)) if bounded else None
        batch = _contours(own, sides, frame[first:stop], RULES[solid], len(half))
        batches.append(batch if closes or not bounded else object_part(batch))
    return join_batches(batches)


def _blocks(point_start: np.ndarray, patch_count: int) -> Iterator[tuple[int, int]]:
    """Sections of whole poses, as (first, stop), with about BLOCK_POINTS points together; one block at least.

    point_start: offsets of sections' points, shape [section + 1].
    """
    of_pose = point_start[::patch_count]
    first, count = 0, len(of_pose) - 1
    while True:
        stop = int(np.searchsorted(of_pose, of_pose[first] + BLOCK_POINTS, side="right")) - 1
        stop = min(max(stop, first + 1), count)
        yield first * patch_count, stop * patch_count
        if stop >= count:
            return
        first = stop


def _contours(
    loops: Loops, half: np.ndarray | None, frame: np.ndarray, rule: FillRule, patch_count: int
) -> ContourBatch:
    """Closed contours of the sections of whole poses; half: of each section's patch [m], None for the whole plane."""
    low, high = _extents(loops)
    if half is not None:  # a loop beside the patch's rectangle winds around no point of it
        met = ((low < half[loops.section]) & (high > -half[loops.section])).all(axis=1)
        loops, low, high = _chosen(loops, met), low[met], high[met]
    reach = np.zeros((len(frame), 2))
    np.maximum.at(reach, loops.section, np.maximum(high, -low))
    step = _lattice_steps(reach.max(axis=1))
    size = None if half is None else np.where((reach < half).all(axis=1)[:, None], 0.0, np.rint(half / step[:, None]))
    polygons = _without_slivers(_regularised(loops, step, size, rule))
    return _as_batch(polygons, step, half, frame, patch_count)


def _extents(loops: Loops) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of each loop, shape [loop, 2]."""
    if len(loops.section) == 0:
        return np.zeros((0, 2)), np.zeros((0, 2))
    return np.minimum.reduceat(loops.points, loops.start[:-1]), np.maximum.reduceat(loops.points, loops.start[:-1])


def _lattice_steps(reach: np.ndarray) -> np.ndarray:
    """Step of the lattice for coordinates of up to `reach` [m], a power of 2."""
    return 2.0 ** np.maximum(np.ceil(np.log2(np.maximum(reach, 1.0))) - COORDINATE_BITS, -LATTICE_BITS)


def _chosen(loops: Loops, kept: np.ndarray) -> Loops:
    """Some of the loops."""
    if kept.all():
        return loops
    count = np.diff(loops.start)
    start = np.concatenate([[0], np.cumsum(count[kept])])
    return Loops(loops.points[np.repeat(kept, count)], start, loops.section[kept])


def _following(start: np.ndarray) -> np.ndarray:
    """Index of the point that follows each around its loop; start: offsets of loops, none of them empty."""
    after = np.arange(1, start[-1] + 1)
    after[start[1:] - 1] = start[:-1]
    return after


def _regularised(loops: Loops, step: np.ndarray, size: np.ndarray | None, rule: FillRule) -> Loops:
    """The polygons that bound what is inside, outlines counter-clockwise, in steps of the lattice.

    size: half extents of each section's patch in these steps, 0 where all loops lie within it; None for the whole plane.
    """
    unit = 2.0**-UNIT_BITS
    points = np.rint(loops.points / np.repeat(step[loops.section], np.diff(loops.start))[:, None]) * unit
    first = np.flatnonzero(np.diff(loops.section, prepend=-1, append=-1))
    polygons: list[np.ndarray] = []
    section: list[int] = []
    for one, two in zip(first[:-1].tolist(), first[1:].tolist(), strict=True):
        own = int(loops.section[one])
        found = CrossSection([points[a:b] for a, b in _spans(loops.start[one : two + 1])], rule)
        if size is not None and size[own, 0] > 0:
            found ^= CrossSection.square(2 * unit * size[own], center=True)
        polygons += found.to_polygons()
        section += [own] * (len(polygons) - len(section))
    start = np.concatenate([[0], np.cumsum([len(polygon) for polygon in polygons])]).astype(np.int64)
    every = np.concatenate(polygons) / unit if polygons else np.zeros((0, 2))
    return Loops(every, start, np.array(section, np.int64))


def _spans(start: np.ndarray) -> Iterator[tuple[int, int]]:
    """Consecutive offsets as pairs."""
    offsets = start.tolist()
    return zip(offsets[:-1], offsets[1:], strict=True)


def _without_slivers(polygons: Loops) -> Loops:
    """Polygons, in steps of the lattice, but for those whose mean width is below THIN steps."""
    if len(polygons.section) == 0:
        return polygons
    after = _following(polygons.start)
    p = polygons.points - np.repeat(polygons.points[polygons.start[:-1]], np.diff(polygons.start), axis=0)
    q = p[after]
    area = np.add.reduceat(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0], polygons.start[:-1])
    length = np.add.reduceat(np.hypot(*(q - p).T), polygons.start[:-1])
    return _chosen(polygons, 2 * np.abs(area) > THIN * length)  # area here is twice the area, length twice a sliver's


def _as_batch(
    polygons: Loops, step: np.ndarray, half: np.ndarray | None, frame: np.ndarray, patch_count: int
) -> ContourBatch:
    """Polygons as closed contours in the array's frame, started and ordered as `regularised_contours` says."""
    side = _sides(polygons, step, half)
    touches, start = _starts(polygons, side)
    u, v = polygons.points[start].T
    order = np.lexsort([v, u, ~touches, polygons.section])
    index, line_start = _turned(polygons.start, start, order)
    section = polygons.section[order]
    kind = np.where(_edge_sides(side, polygons.start) != 0, HAND, OBJECT).astype(np.uint8)[index]
    of_point = np.repeat(section, np.diff(line_start))
    place = polygons.points[index] * step[of_point, None]
    origin, u, v = (frame[of_point, k] for k in range(3))
    points = (origin + place[:, :1] * u + place[:, 1:] * v).astype(np.float32)
    return _without_still_steps(points, kind, line_start, section, (len(step) // patch_count, patch_count))


def _sides(polygons: Loops, step: np.ndarray, half: np.ndarray | None) -> np.ndarray:
    """On which of a patch's sides each point lies, a bit each, shape [point]."""
    if half is None:
        return np.zeros(len(polygons.points), np.uint8)
    of_point = np.repeat(polygons.section, np.diff(polygons.start))
    end = np.rint(half / step[:, None])[of_point]
    on = np.concatenate([polygons.points >= end - 1, polygons.points <= 1 - end], axis=1)  # 1 step: rounding's
    return np.packbits(on, axis=1, bitorder="little")[:, 0]


def _edge_sides(side: np.ndarray, start: np.ndarray) -> np.ndarray:
    """The side that each polygon's edge runs along, as a bit, 0 for none; an edge goes by its first point."""
    return side & side[_following(start)] if len(side) else side


def _starts(polygons: Loops, side: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each polygon has an edge along the patch's boundary, and the point that it starts at."""
    along = _edge_sides(side, polygons.start) != 0
    before = np.empty_like(along)
    before[_following(polygons.start)] = along
    number = np.repeat(np.arange(len(polygons.section)), np.diff(polygons.start))
    enters = before & ~along
    has_entry = np.zeros(len(polygons.section), bool)
    has_entry[number[enters]] = True
    touches = has_entry.copy()
    touches[number[along]] = True
    may_start = np.flatnonzero(enters | ~has_entry[number])
    u, v = polygons.points[may_start].T
    order = may_start[np.lexsort([v, u, number[may_start]])]
    _, first = np.unique(number[order], return_index=True)
    return touches, order[first]


def _turned(offsets: np.ndarray, start: np.ndarray, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of polygons in an order, each from its start on and with it again at its end; and the offsets of those."""
    first, count = offsets[:-1][order], np.diff(offsets)[order]
    line_start = np.concatenate([[0], np.cumsum(count + 1)]).astype(np.int64)
    own = np.repeat(np.arange(len(order)), count + 1)
    along = np.arange(line_start[-1]) - line_start[own]
    return first[own] + ((start[order] - first)[own] + along) % count[own], line_start


def _without_still_steps(
    points: np.ndarray, kind: np.ndarray, line_start: np.ndarray, section: np.ndarray, shape: tuple[int, int]
) -> ContourBatch:
    """Closed contours without steps of zero length in float32, nor polylines of nothing else; shape: poses, patches."""
    last = np.zeros(len(points), bool)
    last[line_start[1:] - 1] = True
    moves = np.zeros(len(points), bool)
    moves[:-1] = (points[1:] != points[:-1]).any(axis=1)
    moves &= ~last
    line = np.repeat(np.arange(len(section)), np.diff(line_start))
    drawn = np.bincount(line[moves], minlength=len(section)) > 0
    kept = moves | (last & drawn[line])
    start = np.concatenate([[0], np.cumsum(kept)])[line_start]
    start = np.concatenate([[0], start[1:][drawn]]).astype(np.int64)
    kind = kind[kept]
    kind[start[1:] - 1] = kind[start[1:] - 2]
    count = np.bincount(section[drawn] // shape[1], minlength=shape[0])
    return ContourBatch(
        points=points[kept],
        kind=kind,
        polyline_start=start,
        polyline_patch=(section[drawn] % shape[1]).astype(np.int32),
        polyline_closed=np.ones(len(start) - 1, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
    )
