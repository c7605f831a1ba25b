"""Sections of meshes that cross themselves: the region where the winding number says inside, and its boundary.

The loops in which a plane cuts such a mesh cross one another, so they are not the boundary of the solid's section. The
polygons that bound what is inside are found by manifold3d's `CrossSection` (Clipper2), which also cuts them off at the
patch's sides. Polygons are all that it returns: an edge of theirs with both ends on one side of the patch is the
hand's, all others are the object's. So a contour that runs along a side is the hand's, as in the kernels.

Coordinates are those of the patch's frame, rounded to a lattice with steps of 2^-40 m (0.9e-12 m).
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...kernels.section.draw import HAND, OBJECT
from ...kernels.section.loops import PlaneLoops, have_near_corners
from ..contour_batch import ContourBatch, join_batches, object_part
from ..errors import MeshError

FILL_RULES = {"winding": "Positive", "even-odd": "EvenOdd"}
STEP = 2.0**-40  # of the lattice [m]
REACH_LARGEST = 2.0**20  # [m]; 2^60 steps: Clipper2 has room for 2^61, and float64 rounds to 2^7 of them there
UNIT = 2.0**-27  # of its unit: what `CrossSection` rounds to (measured), 8 decimal places as a power of 2
MITRE = 100.0  # in offsets: corners that stand out farther, those of less than a degree, are cut off there
ON_SIDE = 2.0  # steps; what is this near to a side of the patch lies on it
JITTER = 8  # bits of the steps that corners are moved by, either way: 2^-32 m (0.2e-9 m)
SLIT = 2.0 ** (JITTER + 2)  # steps: gaps and walls of up to twice this, 1.9e-9 m, come from moved corners
SLIT_LENGTH = 1e-6  # [m] of gaps and walls of hardly any width that matter
SLIVER = 8.0  # steps of the lattice; which way a polygon that is narrower in the mean goes around is rounding's to say
BLOCK_POINTS = 2**18  # points of loops that are worked on at a time, which takes some 100 bytes each


class Loops(NamedTuple):
    """Closed loops of sections, in the frames of their patches."""

    points: np.ndarray
    """Along u and v, the first of a loop not repeated at its end, float64, shape [point, 2]."""
    start: np.ndarray
    """Offsets into points, int64, shape [loop + 1]; no loop is empty."""
    section: np.ndarray
    """Section of each loop, ascending, int64, shape [loop]."""

    def chosen(self, mask: np.ndarray) -> "Loops":
        """Some of the loops."""
        if mask.all():
            return self
        count = np.diff(self.start)
        start = np.concatenate([[0], np.cumsum(count[mask])])
        return Loops(self.points[np.repeat(mask, count)], start, self.section[mask])

    def following(self) -> np.ndarray:
        """Index of the point that follows each around its loop, shape [point]."""
        after = np.arange(1, self.start[-1] + 1)
        after[self.start[1:] - 1] = self.start[:-1]
        return after

    def of_points(self) -> np.ndarray:
        """Number of each point's loop, shape [point]."""
        return np.repeat(np.arange(len(self.section)), np.diff(self.start))


class Planes(NamedTuple):
    """Frames of the patches of some sections."""

    frame: np.ndarray
    """Origin [m], u and v, array frame, shape [section, 3, 3]."""
    sides: np.ndarray | None
    """Half extents in steps of the lattice, shape [section, 2]; None if nothing is cut off."""


def regularised_contours(
    loops: PlaneLoops, patch: wp.array, *, solid: str, gap: float, bounded: bool, closes: bool
) -> ContourBatch:
    """The boundary of the regularised section in each patch (CC), or what of it lies within (OC), on the host.

    loops: of `plane_loops`; patch: those it was called with. solid: which winding numbers are inside, "winding" or
    "even-odd". gap: gaps and walls up to twice as wide count as none [m]; 0 where no faces lie on each other.
    bounded: whether contours end at the patches' sides; closes: whether they are closed along them, not for whole
    planes.

    A polyline that meets the patch's boundary starts where the object's contour enters the patch, or at corner 0 if
    nothing but the boundary is left; a loop starts at its lowest point along u, then v. Of a section those that meet
    the boundary come first, each group in the order of where they start. OC is cut out of CC. Raises MeshError for
    loops that reach farther than REACH_LARGEST.
    """
    host: list[Any] = [array.numpy() for array in (*loops, patch)]
    points, loop_start, section_start, frame, patches = host
    half = patches["half"].astype(np.float64).reshape(-1, 2)
    batches = []
    for first, stop in _blocks(loop_start[section_start], len(half)):
        start = loop_start[section_start[first] : section_start[stop] + 1]
        section = np.repeat(np.arange(stop - first), np.diff(section_start[first : stop + 1]))
        own = Loops(points[start[0] : start[-1]].reshape(-1, 2), start - start[0], section)
        sides = np.tile(np.rint(half / STEP), ((stop - first) // len(half), 1)) if bounded else None
        own, planes = _on_lattice(own, sides), Planes(frame[first:stop], sides)
        polygons = _regularised(own, planes, FILL_RULES[solid], gap)
        batch = _as_batch(polygons, planes, len(half))
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


def _on_lattice(loops: Loops, sides: np.ndarray | None) -> Loops:
    """The loops in whole steps of the lattice, without those beside the patches they are cut off at, see `Planes`."""
    if len(loops.section) == 0:
        return loops
    loops = loops._replace(points=np.rint(loops.points / STEP))
    low, high = (f.reduceat(loops.points, loops.start[:-1]) for f in (np.minimum, np.maximum))
    reach = float(np.maximum(high, -low).max()) * STEP
    if not reach <= REACH_LARGEST:
        raise MeshError(
            f"a mesh that crosses itself may reach {REACH_LARGEST:.3g} m from a patch at most, not {reach:.3g} m"
        )
    if sides is None:
        return loops._replace(points=_moved(loops.points, None, 0.0))
    own = sides[loops.section]
    loops = loops.chosen(((low < own) & (high > -own)).all(axis=1))  # others wind around no point of the rectangle
    of_point = loops.section[loops.of_points()]
    return loops._replace(points=_moved(loops.points, sides[of_point], ON_SIDE))


def _moved(points: np.ndarray, sides: np.ndarray | None, near: float) -> np.ndarray:
    """Points in general position, but exactly on a side of the patch if they are as near to it as that [steps].

    Each is moved by up to 2^JITTER steps along u and v, at random but always the same for a point. Where three lines
    all but meet in one, Clipper2 fills holes now and then: in 60 of 3,000 sections made of lines on a grid, in none
    after their corners were moved.
    """
    moved = points + _jitter(points)
    if sides is None:
        return moved
    return np.where(np.abs(np.abs(points) - sides) <= near, np.copysign(sides, points), moved)


def _jitter(points: np.ndarray) -> np.ndarray:
    """Whole numbers of up to 2^JITTER by size, at random but always the same for a point, shape [point, 2]."""
    u, v = points.astype(np.int64).astype(np.uint64).T
    word = u * np.uint64(0x9E3779B97F4A7C15) ^ v * np.uint64(0xC2B2AE3D27D4EB4F)
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB), (31, 1)):  # splitmix64's last steps
        word = (word ^ (word >> np.uint64(shift))) * np.uint64(factor)
    pair = np.stack([word, word >> np.uint64(32)], axis=1) & np.uint64(2 ** (JITTER + 1) - 1)
    return pair.astype(np.float64) - 2.0**JITTER


def _regularised(loops: Loops, planes: Planes, rule: str, gap: float) -> Loops:
    """The polygons that bound what is inside, in steps of the lattice; holes go around clockwise."""
    from manifold3d import CrossSection, FillRule  # 15 ms that simple meshes do without

    sides, points = planes.sides, loops.points * UNIT
    first = np.flatnonzero(np.diff(loops.section, prepend=-1, append=-1))
    regions: list[Any] = []
    for one, two in pairwise(first.tolist()):
        start = loops.start[one : two + 1].tolist()
        regions.append(CrossSection([points[a:b] for a, b in pairwise(start)], FillRule[rule]))
    section = loops.section[first[:-1]]
    doubtful = np.zeros(len(regions), bool) if gap else _have_near_corners(regions)
    for k, (one, two) in enumerate(pairwise(first.tolist())):
        end = None if sides is None else sides[section[k]]
        width = np.rint(gap / STEP) or (SLIT if doubtful[k] and _has_slits(regions[k]) else 0.0)
        if width:
            regions[k] = _healed(regions[k], width, end)
        if end is not None and (np.abs(points[loops.start[one] : loops.start[two]]) >= end * UNIT).any():
            regions[k] ^= CrossSection.square(2 * UNIT * end, center=True)
    return _as_loops(regions, section)


def _as_loops(regions: list[Any], section: np.ndarray) -> Loops:
    """The polygons of `CrossSection`s in steps of the lattice; section: number of each one's section."""
    polygons = [region.to_polygons() for region in regions]
    every = [polygon for own in polygons for polygon in own]
    start = np.concatenate([[0], np.cumsum([len(polygon) for polygon in every])]).astype(np.int64)
    points = np.concatenate(every) / UNIT if every else np.zeros((0, 2))
    return Loops(points, start, np.repeat(section, [len(own) for own in polygons]))


def _have_near_corners(regions: list[Any]) -> np.ndarray:
    """Whether each `CrossSection` may have slits: a corner that all but lies on another edge, or a narrow polygon."""
    loops = _as_loops(regions, np.arange(len(regions)))
    if len(loops.section) == 0:
        return np.zeros(len(regions), bool)
    after = loops.following()
    near = have_near_corners(loops.points, after, loops.section[loops.of_points()], len(regions), limit=2 * SLIT)
    p = loops.points - np.repeat(loops.points[loops.start[:-1]], np.diff(loops.start), axis=0)
    q = p[after]
    double_area = np.add.reduceat(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0], loops.start[:-1])
    length = np.add.reduceat(np.hypot(*(q - p).T), loops.start[:-1])
    near[loops.section[np.abs(double_area) <= 2 * SLIT * length]] = True
    return near


def _has_slits(region: Any) -> bool:
    """Whether a `CrossSection` has gaps or walls of hardly any width, which moved corners have made of what touches.

    Its boundary is shorter then, by twice their length, once it has grown or shrunk by more than the corners moved.
    """
    from manifold3d import JoinType

    polygons = region.to_polygons()
    if any(_mean_width(polygon) <= SLIVER * UNIT for polygon in polygons):
        return True
    least = _boundary(polygons) - SLIT_LENGTH / STEP * UNIT
    grown = (region.offset(by * UNIT, JoinType.Miter, MITRE).to_polygons() for by in (SLIT, -SLIT))
    return any(_boundary(other) < least for other in grown)


def _boundary(polygons: list[np.ndarray]) -> float:
    """Length of the boundary of polygons."""
    return sum(float(np.hypot(*(p - np.roll(p, -1, axis=0)).T).sum()) for p in polygons)


def _healed(region: Any, gap: float, sides: np.ndarray | None) -> Any:
    """A `CrossSection` without gaps and walls up to twice as wide as this; gap, sides: in steps of the lattice.

    Grown, it has no gaps, and shrunk again no walls; straight edges and corners come back to where they were. Slivers
    are left out before, since `offset` takes all for inside out if its lowest polygon is.
    """
    from manifold3d import CrossSection, JoinType

    for by in (gap, -2 * gap, gap, 0.0):
        wide = [polygon / UNIT for polygon in region.to_polygons() if _mean_width(polygon) > SLIVER * UNIT]
        region = CrossSection([_moved(polygon, sides, gap) * UNIT for polygon in wide])
        if by:
            region = region.offset(by * UNIT, JoinType.Miter, MITRE)
    return region


def _mean_width(polygon: np.ndarray) -> float:
    """Width of a strip as long as a polygon and of equal area."""
    p = polygon - polygon[0]
    q = np.roll(p, -1, axis=0)
    return float(2 * abs((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()) / (2 * np.hypot(*(q - p).T).sum()))


def _as_batch(polygons: Loops, planes: Planes, patch_count: int) -> ContourBatch:
    """Polygons as closed contours in the array's frame, started and ordered as `regularised_contours` says."""
    along = np.zeros(len(polygons.points), bool)  # whether the edge from each point to the next is on the patch's side
    if planes.sides is not None and len(polygons.section):
        end = planes.sides[polygons.section[polygons.of_points()]]
        beyond = np.concatenate([polygons.points >= end - 1, polygons.points <= 1 - end], axis=1)  # 1 step: rounding's
        along = np.any(beyond & beyond[polygons.following()], axis=1)
    touches, start = _starts(polygons, along)
    u, v = polygons.points[start].T
    order = np.lexsort([v, u, ~touches, polygons.section])
    first, count = polygons.start[:-1][order], np.diff(polygons.start)[order]
    line_start = np.concatenate([[0], np.cumsum(count + 1)]).astype(np.int64)
    line = np.repeat(np.arange(len(order)), count + 1)  # each from its start on, and with it again at its end
    index = first[line] + ((start[order] - first)[line] + np.arange(line_start[-1]) - line_start[line]) % count[line]
    section = polygons.section[order]
    of_point = section[line]
    place = polygons.points[index] * STEP
    origin, u, v = (planes.frame[of_point, k] for k in range(3))
    points = (origin + place[:, :1] * u + place[:, 1:] * v).astype(np.float32)
    kind = np.where(along, HAND, OBJECT).astype(np.uint8)[index]
    return _without_still_steps(points, kind, line_start, section, (len(planes.frame) // patch_count, patch_count))


def _starts(polygons: Loops, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Whether each polygon has an edge along the patch's boundary, and the index of the point that it starts at.

    along: whether the edge from each point to the next does, shape [point].
    """
    loop = polygons.of_points()
    enters = np.zeros_like(along)
    if len(along):
        after = polygons.following()
        enters[after] = along & ~along[after]
    touches, has_entry = np.zeros((2, len(polygons.section)), bool)
    touches[loop[along]] = True
    has_entry[loop[enters]] = True
    may_start = np.flatnonzero(enters | ~has_entry[loop])
    u, v = polygons.points[may_start].T
    may_start = may_start[np.lexsort([v, u, loop[may_start]])]
    return touches, may_start[np.unique(loop[may_start], return_index=True)[1]]


def _without_still_steps(
    points: np.ndarray, kind: np.ndarray, line_start: np.ndarray, section: np.ndarray, shape: tuple[int, int]
) -> ContourBatch:
    """Closed contours without steps of zero length in float32, nor polylines of nothing else; shape: poses, patches."""
    last = np.zeros(len(points), bool)
    last[line_start[1:] - 1] = True
    moves = ~last
    moves[:-1] &= (points[1:] != points[:-1]).any(axis=1)
    line = np.repeat(np.arange(len(section)), np.diff(line_start))
    drawn = np.bincount(line[moves], minlength=len(section)) > 0
    mask = moves | (last & drawn[line])
    start = np.concatenate([[0], np.cumsum(mask)])[line_start]
    start = np.concatenate([[0], start[1:][drawn]]).astype(np.int64)
    kind = kind[mask]
    kind[start[1:] - 1] = kind[start[1:] - 2]
    count = np.bincount(section[drawn] // shape[1], minlength=shape[0])
    return ContourBatch(
        points=points[mask],
        kind=kind,
        polyline_start=start,
        polyline_patch=(section[drawn] % shape[1]).astype(np.int32),
        polyline_closed=np.ones(len(start) - 1, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
    )
