"""What a library's section still lacks: rings into the palm's frame, clipped and closed by shapely, all poses at once.

| ring's box and the palm         | OC                             | CC                                     |
|---------------------------------|--------------------------------|----------------------------------------|
| apart                           | nothing                        | nothing                                |
| inside the palm                 | as it is                       | as it is                               |
| otherwise                       | clip_by_rect, mended at starts | with the pose's others: polygons, clip |

Polygons: every ring by itself where no ring is a hole, shell and holes where one ring is a shell (both need rings that
are oriented), else by even-odd (build_area).
"""

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from palpate.datasets.rigid import rotate
from palpate.render.hands.hand import Palm

POLYGON, LINE, MULTI_LINE = 3, 1, 5  # GEOS type numbers


@dataclass(frozen=True)
class Polylines:
    """Ordered polylines of many poses, in the palm's frame (u, v); a closed one repeats its first point at its end."""

    points: np.ndarray
    """[m], float64, shape [point, 2]."""
    start: np.ndarray
    """Offsets into points, int64, shape [polyline + 1]."""
    pose: np.ndarray
    """Which pose, ascending or not, int64, shape [polyline]."""

    @property
    def size(self) -> np.ndarray:
        """Points of each polyline, shape [polyline]."""
        return np.diff(self.start)

    def lengths(self, pose_count: int) -> np.ndarray:
        """Total length of each pose's polylines [m], shape [pose]."""
        return np.bincount(self.pose, self._each_length(), minlength=pose_count)

    def counts(self, pose_count: int, *, longer_than: float) -> np.ndarray:
        """Number of each pose's polylines that are longer than so much [m], shape [pose]."""
        return np.bincount(self.pose[self._each_length() > longer_than], minlength=pose_count)

    def _each_length(self) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=1))])
        return total[self.start[1:] - 1] - total[self.start[:-1]]

    def select(self, wanted: np.ndarray) -> "Polylines":
        """Some of the polylines, by bool of shape [polyline]."""
        if wanted.all():
            return self
        size = self.size[wanted]
        return Polylines(self.points[np.repeat(wanted, self.size)], offsets(size), self.pose[wanted])


def offsets(size: np.ndarray) -> np.ndarray:
    """Counts to offsets, shape [n + 1]."""
    return np.concatenate([[0], np.cumsum(size)]).astype(np.int64)


def joined(parts: list[Polylines]) -> Polylines:
    """Polylines of several sources as one, in their order."""
    size = np.concatenate([part.size for part in parts])
    points, pose = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "pose"))
    return Polylines(points, offsets(size), pose)


@dataclass(frozen=True)
class PalmFrames:
    """Palms of many poses in float64: what a library needs of a plane."""

    centre: np.ndarray
    """[m], shape [pose, 3]."""
    axes: np.ndarray
    """Rows u, v, n of each palm, shape [pose, 3, 3]."""

    @classmethod
    def of(cls, pose: np.ndarray) -> "PalmFrames":
        """Frames of poses, shape [pose, 7]."""
        pose = pose.astype(np.float64)
        turn = pose[:, 3:] / np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        local = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        return cls(pose[:, :3], rotate(turn[:, None], local[None]))

    def flat(self, points: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Points of the array's frame [point, 3] in the frames of their poses [point], without height, [point, 2]."""
        return np.einsum("nij,nj->ni", self.axes[pose, :2], points - self.centre[pose])


def rings_of(arrays: list[np.ndarray], pose: list[int], *, repeats: bool) -> Polylines:
    """Rings as a library gives them, one array [point, 2] a ring; its first point is appended unless it `repeats`."""
    if not arrays:
        return Polylines(np.zeros((0, 2)), np.zeros(1, np.int64), np.zeros(0, np.int64))
    size = np.array([len(array) for array in arrays])
    points = np.concatenate(arrays).astype(np.float64)
    if not repeats:
        start = offsets(size)
        index = np.insert(np.arange(len(points)), start[1:], start[:-1])
        points, size = points[index], size + 1
    return Polylines(points, offsets(size), np.array(pose, np.int64))


def clipped(rings: Polylines, hand: Palm, *, closed: bool, turn: int) -> Polylines:
    """Rings of sections to what the strategy asks for: OC, or CC if `closed`.

    turn: how shells run, 1 counter-clockwise, -1 clockwise, 0 either way.
    """
    half = np.array([hand.width, hand.length]) / 2.0
    if not len(rings.pose):
        return rings
    low = np.minimum.reduceat(rings.points, rings.start[:-1])
    high = np.maximum.reduceat(rings.points, rings.start[:-1])
    near = ((low < half) & (high > -half)).all(axis=1)
    rings = rings.select(near)
    inside = ((low > -half) & (high < half))[near].all(axis=1)
    whole, cut = rings.select(inside), rings.select(~inside)
    if not len(cut.pose):
        return whole
    return joined([whole, _closed_parts(cut, half, turn) if closed else _open_parts(cut, half)])


def _shapely() -> ModuleType:
    import shapely  # needed by peers only

    return shapely


def lines_of(shapely: Any, polylines: Polylines) -> np.ndarray:
    """Geometry of each polyline."""
    return shapely.linestrings(polylines.points, indices=np.repeat(np.arange(len(polylines.pose)), polylines.size))


def polylines_from(shapely: Any, lines: np.ndarray, pose: np.ndarray) -> Polylines:
    """Polylines of line geometries."""
    size = shapely.get_num_coordinates(lines)
    return Polylines(shapely.get_coordinates(lines), offsets(size), pose)


def _open_parts(rings: Polylines, half: np.ndarray) -> Polylines:
    """Rings clipped to the palm; one that starts inside is cut there by shapely, which line_merge mends."""
    shapely = _shapely()
    parts = shapely.clip_by_rect(lines_of(shapely, rings), *-half, *half)
    starts_inside = (np.abs(rings.points[rings.start[:-1]]) < half).all(axis=1)
    split = starts_inside & (shapely.get_type_id(parts) == MULTI_LINE)
    parts[split] = shapely.line_merge(parts[split])
    lines, ring = shapely.get_parts(parts, return_index=True)
    real = shapely.get_type_id(lines) == LINE
    return polylines_from(shapely, lines[real], rings.pose[ring[real]])


def _closed_parts(rings: Polylines, half: np.ndarray, turn: int) -> Polylines:
    """Boundary of (region of each pose's rings) and the palm."""
    shapely = _shapely()
    polygons, pose = _regions(shapely, rings, turn)
    parts, polygon = shapely.get_parts(shapely.clip_by_rect(polygons, *-half, *half), return_index=True)
    real = shapely.get_type_id(parts) == POLYGON
    outlines, part = shapely.get_rings(parts[real], return_index=True)
    return polylines_from(shapely, outlines, pose[polygon[real][part]])


def _regions(shapely: Any, rings: Polylines, turn: int) -> tuple[np.ndarray, np.ndarray]:
    """Polygons, and the pose of each; a pose may have several."""
    pose, place, count = np.unique(rings.pose, return_inverse=True, return_counts=True)
    # Twice the area of each ring, negative where it runs clockwise, shape [ring]. It is taken from each ring's first
    # point, which is its last too, so the product across rings is 0.
    points = rings.points - np.repeat(rings.points[rings.start[:-1]], rings.size, axis=0)
    doubled = points[:-1, 0] * points[1:, 1] - points[1:, 0] * points[:-1, 1]
    area = turn * np.add.reduceat(np.append(doubled, 0.0), rings.start[:-1])
    shells = np.bincount(place, area > 0.0, minlength=len(pose)).astype(int)
    apart = (count == 1) | (shells == count)
    nested = (shells == 1) & (count > 1)
    rough = ~apart & ~nested
    found = []
    if apart.any():
        part = rings.select(apart[place])
        found.append((shapely.polygons(_outlines(shapely, part)), part.pose))
    if nested.any():
        part = rings.select(nested[place])
        order = np.lexsort((area[nested[place]] < 0.0, part.pose))  # the shell first
        kept, index = np.unique(part.pose, return_inverse=True)
        found.append((shapely.polygons(_outlines(shapely, part)[order], indices=index[order]), kept))
    if rough.any():
        part = rings.select(rough[place])
        order = np.argsort(part.pose, kind="stable")
        kept, index = np.unique(part.pose, return_inverse=True)
        lines = shapely.multilinestrings(lines_of(shapely, part)[order], indices=index[order])
        found.append((shapely.build_area(lines), kept))
    return np.concatenate([polygons for polygons, _ in found]), np.concatenate([owner for _, owner in found])


def _outlines(shapely: Any, rings: Polylines) -> np.ndarray:
    return shapely.linearrings(rings.points, indices=np.repeat(np.arange(len(rings.pose)), rings.size))


def stitched(segments: np.ndarray, pose: np.ndarray) -> Polylines:
    """Segments with equal ends [segment, 2, 2], of poses in ascending order [segment], joined into polylines."""
    if not len(segments):
        return rings_of([], [], repeats=True)
    shapely = _shapely()
    kept, index = np.unique(pose, return_inverse=True)
    lines = shapely.linestrings(segments)
    merged = shapely.line_merge(shapely.multilinestrings(lines, indices=index))
    parts, place = shapely.get_parts(merged, return_index=True)
    return polylines_from(shapely, parts, kept[place])
