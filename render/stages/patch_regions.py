"""Sections: contours in the plane of their patch, grouped by region, and their area, middle and second moments."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from ...kernels.stages.lift import Lifted
from ...kernels.stages.regions import Regions, find_regions
from ..contour_batch import MADE, ContourBatch
from ..user_warnings import warn_user
from .registry import Setting


def regions_of(batch: ContourBatch, setting: Setting, per: str) -> Regions:
    """Regions of a batch on the setting's device; per: "region" or "patch", see `find_regions`."""
    lines = (batch.polyline_start, batch.polyline_patch, batch.polyline_closed, batch.pose_start)
    return find_regions(batch.points, *lines, setting.patches, per=per)


def batch_of_lifted(lifted: Lifted) -> ContourBatch:
    """A batch on a device of polylines that a stage made."""
    kind = wp.full(lifted.points.shape[0], MADE, dtype=wp.uint8, device=lifted.points.device)
    return ContourBatch(lifted.points, kind, *lifted[1:5])


@dataclass(frozen=True, eq=False)
class Sections:
    """The polylines of a batch in their patches' planes.

    Inside lies to the left seen from a patch's +n side, so an outer loop has a positive area and a hole a negative one.
    On a hand mesh the plane is that of its palm: contours are seen along its normal.
    """

    batch: ContourBatch
    setting: Setting

    @cached_property
    def pose(self) -> np.ndarray:
        """Which pose of the batch each polyline is of, shape [polyline]."""
        return np.repeat(np.arange(self.batch.pose_count), np.diff(self.batch.pose_start))

    @cached_property
    def local(self) -> np.ndarray:
        """Coordinates of the points along u, v and n of their patch [m], float64, shape [point, 3]."""
        count = np.diff(self.batch.polyline_start)
        pose, patch = np.repeat(self.pose, count), np.repeat(self.batch.polyline_patch, count)
        frames = self.setting.frames
        off = self.batch.points.astype(np.float64) - frames.origin[pose, patch]
        axes = (frames.u, frames.v, frames.n)
        return np.stack([np.einsum("ij,ij->i", off, axis[pose, patch]) for axis in axes], axis=1)

    @cached_property
    def closed(self) -> np.ndarray:
        """Whether each polyline is closed, bool, shape [polyline]."""
        return self.batch.polyline_closed.astype(bool)

    def loop(self, line: int) -> np.ndarray:
        """Points of a polyline in its plane [m], a closed one without its first repeated, shape [point, 2]."""
        first, stop = self.batch.polyline_start[line], self.batch.polyline_start[line + 1]
        return self.local[first : stop - int(self.closed[line]), :2]

    def lifted(self, pose: int, patch: int, flat: np.ndarray, height: float) -> np.ndarray:
        """Points of a patch's plane [m], shape [point, 2], in the array's frame, so high above it [m]."""
        f = self.setting.frames
        middle = f.origin[pose, patch] + height * f.n[pose, patch]
        return middle + flat[:, :1] * f.u[pose, patch] + flat[:, 1:] * f.v[pose, patch]

    @cached_property
    def _segments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First point and end of each segment, shape [segment, 3], and its polyline."""
        is_segment = np.ones(self.batch.point_count, bool)
        is_segment[self.batch.polyline_start[1:] - 1] = False
        here = np.flatnonzero(is_segment)
        line = np.repeat(np.arange(self.batch.polyline_count), np.diff(self.batch.polyline_start))[here]
        return self.local[here], self.local[here + 1], line

    def _summed(self, line: np.ndarray, value: np.ndarray) -> np.ndarray:
        out = np.zeros((self.batch.polyline_count, *value.shape[1:]))
        np.add.at(out, line, value)
        return out

    @cached_property
    def areas(self) -> np.ndarray:
        """Area [m2], first [m3] and second moments xx xy yy [m4] of closed polylines, 0 of open ones, [polyline, 6]."""
        a, b, line = self._segments
        (x, y), (p, q) = a[:, :2].T, b[:, :2].T
        cross = (x * q - p * y) * self.closed[line]
        parts = (1 / 2, (x + p) / 6, (y + q) / 6, (x * x + x * p + p * p) / 12)
        mixed = (2 * x * y + x * q + p * y + 2 * p * q) / 24
        parts += (mixed, (y * y + y * q + q * q) / 12)
        return self._summed(line, np.stack([cross * part for part in parts], axis=1))

    def groups(self, per: str) -> list[np.ndarray]:
        """Polylines that belong together, by pose and patch; per "region": an outer loop with its holes, or "patch".

        Holes go to the smallest outer loop around them. An open polyline, or a hole around which there is no loop, is
        a region of its own.
        """
        if self.batch.polyline_count == 0:
            return []
        key = self.pose * (int(self.batch.polyline_patch.max()) + 1) + self.batch.polyline_patch
        order = np.argsort(key, kind="stable")
        patches = np.split(order, np.flatnonzero(np.diff(key[order])) + 1)
        return patches if per == "patch" else [group for lines in patches for group in self._regions(lines)]

    def _regions(self, lines: np.ndarray) -> list[np.ndarray]:
        """Polylines of one patch by region."""
        area = self.areas[lines, 0]
        holes = lines[self.closed[lines] & (area < 0)]
        if len(holes) == 0 or len(lines) == 1:
            return [np.array([line]) for line in lines]
        outer = lines[self.closed[lines] & (area > 0)]
        owner = {int(line): int(line) for line in lines}
        for hole in holes.tolist():
            around = [k for k in outer.tolist() if holds(self.loop(k), self.loop(hole))]
            if around:
                owner[hole] = min(around, key=lambda k: (self.areas[k, 0], k))
        return [np.array([k for k in owner if owner[k] == own]) for own in dict.fromkeys(owner.values())]

    def filled(self, stage: str) -> list[np.ndarray]:
        """Regions that enclose an area, as groups; warns of polylines that are open and enclose none."""
        groups = self.groups("region")
        left_out = int(sum(np.count_nonzero(~self.closed[group]) for group in groups))
        if left_out:
            warn_user(
                f"{stage}: {left_out} of {self.batch.polyline_count} contours are open, enclose nothing and are left "
                'out: put "close" before it'
            )
        return [group for group in groups if self.closed[group].all() and self.areas[group, 0].sum() > 0]


def holds(loop: np.ndarray, inner: np.ndarray) -> bool:
    """Whether a loop winds around another that does not cross it: more of its vertices are inside than not."""
    return bool(2 * np.count_nonzero(windings(loop, inner)) > len(inner))


def windings(loop: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How often a loop goes around each point, int, shape [point]."""
    a, b = loop[None], np.roll(loop, -1, axis=0)[None]
    x, y = points[:, None, 0], points[:, None, 1]
    left = (b[..., 0] - a[..., 0]) * (y - a[..., 1]) - (x - a[..., 0]) * (b[..., 1] - a[..., 1])
    up = (a[..., 1] <= y) & (b[..., 1] > y) & (left > 0)
    down = (a[..., 1] > y) & (b[..., 1] <= y) & (left < 0)
    return np.count_nonzero(up, axis=1) - np.count_nonzero(down, axis=1)
