"""Contours of any field on patches: marching squares on a grid over each patch, exact along cut edges.

The nodes of a grid are asked whether they are inside, one bit each; contours run through the cells whose corners
differ; where they cross an edge between two nodes, the surface is found to ROOT_WIDTH. So a contour's points lie on the
surface, and between them it is straight. At tips it gets a point more, and nodes that a tip passes are moved onto it
(march_tip, march_follow). What else is thinner than a cell may be missed, what is narrower may be joined or parted: at
an ambiguous cell (inside and outside at opposite corners) its middle decides.

The contract is the geometry's (docs/develop/geometry.md), where a node on the surface counts as outside; the
grid's outer nodes lie on the patch's boundary, ON inside of it, and ON below its plane, so a solid that ends at either
is treated as a mesh is. A cut edge's key is its place along the boundary, counter-clockwise from corner 0, for those
there; inside the tile, row and column of its lower node. No edge is cut twice, so no point is made twice.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
import warp as wp

from ..contours import Contours, room_for
from ..fields.field import Field
from ..offsets import PointLimitError, last_of
from ..one_device import on_one_device
from ..patch import ON
from .follow import follow_tips, keep_slots
from .grid import Grids, MovedNodes, lay_grids, place_grids
from .lines import count_points, write_lines
from .sample import Samples, find_roots, resolve_cells, sample_nodes
from .tip import LEAST, FoundTips, find_tips
from .walk import Trails, walk_sections

CPU_TILES = 1 << 17  # of a chunk: what is read again is still in the cache
GPU_TILES = 1 << 23  # 32 MiB of bits
GRAIN_MOST = 0.25  # of a step: details of a coarser field cannot be distinguished from its grain
SLOTS_MOST = 1 << 26  # cut edges of a chunk of several poses, 40 bytes each


@on_one_device
def march_patches(
    field: Field,
    pose: wp.array,
    patch: wp.array,
    *,
    step: float,
    bounds: np.ndarray,
    bounded: bool,
    closes: bool,
    limit: int | None = None,
) -> Contours:
    """Contours of a field on patches, for all poses, on the device of the poses and of the field's data.

    pose: wp.transform, hand frame -> array frame, shape [pose, 1], or each patch's own, [pose, patch].
    patch: Patch, shape [patch]. step: each side is divided into ceil(side / step) cells [m].
    bounds: lowest and highest coordinates of the solid [m], shape [2, 3]; nothing beyond is looked at.
    bounded: on the patches; else in their whole planes, as far as `bounds` reach. closes: along the patches' boundaries
    (CC), which needs them bounded; else open pieces (OC) begin where they enter a patch.

    The solid must lie within its bounds. Details thinner than a cell may be missed. Points are on the surface as far as
    float32 goes, each polyline within half a step of it where it is smooth and a step at tips of 20 degrees or more.
    Raises ValueError for a step that is not positive, too fine (4096 cells along a side) or, unbounded, for infinite
    bounds; PointLimitError as soon as there are more points than `limit`, with those there were by then.
    """
    bounds = np.asarray(bounds, np.float64)
    if closes and not bounded:
        raise ValueError("closed contours need bounded patches")
    half = patch.numpy()["half"].astype(np.float64).reshape(-1, 2)
    middle = None
    if not bounded:
        if not np.isfinite(bounds).all():
            raise ValueError("contours in the whole plane need a solid of finite bounds")
        middle = bounds.mean(axis=0)
        half = np.full_like(half, 0.5 * float(np.linalg.norm(bounds[1] - bounds[0])) + step - float(ON))
    grids = lay_grids(half, step, pose.device)
    march = _March(field, pose, patch, grids, bounds, middle, closes, limit, least=max(LEAST, field.grain / step))
    return _join_chunks(list(march.chunks()), pose.device)


class Traced(NamedTuple):
    """Polylines of a chunk of sections."""

    trails: Trails
    point: wp.array  # of each slot [m]
    found: FoundTips


@dataclass
class _March:
    """Chunks of poses, one after the other; counts what there is so far."""

    field: Field
    pose: wp.array
    patch: wp.array
    grids: Grids
    bounds: np.ndarray
    middle: np.ndarray | None
    closes: bool
    limit: int | None
    least: float  # height of the lowest tip [grid step]
    point_count: int = 0
    polyline_count: int = 0

    @property
    def spare(self) -> int:
        """Slots of a section for the corners of its patch."""
        return 4 if self.closes else 0

    def chunks(self) -> Iterator[Contours]:
        """Contours chunk by chunk; chunks with too many cut edges are halved."""
        tiles = CPU_TILES if self.pose.device.is_cpu else GPU_TILES
        size = max(1, tiles // max(self.grids.patch_of.shape[0], 1))
        count = self.pose.shape[0]
        ranges = [(first, min(first + size, count)) for first in range(0, count, size)][::-1]
        while ranges:
            first, stop = ranges.pop()
            contours = self.chunk(first, stop)
            if contours is None:
                middle = (first + stop) // 2
                ranges += [(middle, stop), (first, middle)]
            else:
                yield contours

    def chunk(self, first: int, stop: int) -> "Contours | None":
        """Contours of poses first..stop; None if they are too many for one go."""
        patch_count = self.patch.shape[0]
        lattice = place_grids(
            self.pose, self.patch, self.grids, first * patch_count, (stop - first) * patch_count, middle=self.middle
        )
        bits = sample_nodes(self.field, lattice, self.grids, self.bounds)
        samples = resolve_cells(self.field, lattice, self.grids, bits, spare=self.spare)
        if last_of(samples.cut_start) > SLOTS_MOST and stop - first > 1:
            return None
        traced = self.trace(lattice, samples)
        if traced.found.far_count:
            samples, traced = self.traced_again(lattice, bits, samples.cut_start, traced)
        trails, point, found = traced
        counts = count_points(trails, point, found.tip)
        point_base, polyline_base = self.point_count, self.polyline_count
        self.point_count += counts.point_count
        self.polyline_count += counts.polyline_count
        if self.limit is not None and self.point_count > self.limit:
            raise PointLimitError(self.point_count, self.limit)
        return write_lines(
            trails,
            point,
            found.tip,
            counts,
            samples.cut_start,
            patch_count=patch_count,
            point_base=point_base,
            polyline_base=polyline_base,
        )

    def trace(self, lattice: wp.array, samples: Samples) -> Traced:
        """Polylines of a chunk, their points, and the tips beyond their steps; waits for the device."""
        trails = walk_sections(samples, self.grids, last_of(samples.cut_start), closes=self.closes)
        point = wp.empty(trails.code.shape[0], dtype=wp.vec3, device=lattice.device)
        find_roots(self.field, lattice, self.grids, trails.code, trails.section, MovedNodes(), point)
        if self.least > GRAIN_MOST:
            return Traced(trails, point, FoundTips(point, 0))
        return Traced(
            trails, point, find_tips(self.field, lattice, self.grids, trails, point, MovedNodes(), least=self.least)
        )

    def traced_again(
        self, lattice: wp.array, bits: wp.array, cut_start: wp.array, before: Traced
    ) -> tuple[Samples, Traced]:
        """The same with nodes moved onto far tips; as before where no node is moved."""
        moved = follow_tips(self.field, lattice, self.grids, bits, cut_start, before.found)
        samples = resolve_cells(self.field, lattice, self.grids, bits, spare=self.spare)
        trails = walk_sections(samples, self.grids, last_of(samples.cut_start), closes=self.closes)
        keep = partial(keep_slots, trails.section, moved, cut_start, samples.cut_start)
        point = wp.empty(trails.code.shape[0], dtype=wp.vec3, device=lattice.device)
        keep(before.point, point)
        find_roots(self.field, lattice, self.grids, trails.code, trails.section, moved, point)
        found = find_tips(self.field, lattice, self.grids, trails, point, moved, least=self.least)
        tip = wp.clone(point) if found.tip is point else found.tip
        keep(before.found.tip, tip)
        return samples, Traced(trails, point, found._replace(tip=tip))


def _join_chunks(parts: list[Contours], device: wp.Device) -> Contours:
    """Contours of consecutive chunks as one: offsets already go on."""
    if len(parts) == 1:
        return parts[0]
    out = room_for(0, 0, device)
    out.pose_start = wp.zeros(1, dtype=wp.int64, device=device)
    for name in (
        ("points", "kind", "polyline_start", "polyline_patch", "polyline_closed", "pose_start") if parts else ()
    ):
        pieces = [getattr(part, name) for part in parts]
        shared = int(name.endswith("_start"))  # an offset that ends one chunk begins the next
        size = sum(p.shape[0] - shared for p in pieces) + shared
        joined, place = wp.empty(size, dtype=pieces[0].dtype, device=device), 0
        for piece in pieces:
            wp.copy(joined, piece, dest_offset=place, count=piece.shape[0])
            place += piece.shape[0] - shared
        setattr(out, name, joined)
    return out
