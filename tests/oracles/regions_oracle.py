"""Regions of contours in the planes of their patches, polyline by polyline in NumPy, and the way back."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from palpate.kernels.section.draw import MADE
from palpate.render import ContourBatch
from palpate.render.stages.setting import Setting


@dataclass(frozen=True, eq=False)
class FlatLines:
    """The polylines of a batch on the host in their patches' planes."""

    batch: ContourBatch
    setting: Setting

    @cached_property
    def pose(self):
        """Which pose each polyline is of, shape [polyline]."""
        return np.repeat(np.arange(self.batch.pose_count), np.diff(self.batch.pose_start))

    @cached_property
    def local(self):
        """Coordinates of the points along u, v and n of their patch [m], float64, shape [point, 3]."""
        count = np.diff(self.batch.polyline_start)
        pose, patch = np.repeat(self.pose, count), np.repeat(self.batch.polyline_patch, count)
        frames = self.setting.frames
        off = self.batch.points.astype(np.float64) - frames.origin[pose, patch]
        parts = [off * axis[pose, patch] for axis in (frames.u, frames.v, frames.n)]
        return np.stack([part[:, 0] + part[:, 1] + part[:, 2] for part in parts], axis=1)

    @cached_property
    def closed(self):
        return self.batch.polyline_closed.astype(bool)

    def loop(self, line):
        """Points of a polyline in its plane [m], a closed one without its first repeated, shape [point, 2]."""
        first, stop = self.batch.polyline_start[line], self.batch.polyline_start[line + 1]
        return self.local[first : stop - int(self.closed[line]), :2]

    def lifted(self, pose, patch, flat, height):
        """Points of a patch's plane [m], shape [point, 2], in the array's frame, so high above it [m]."""
        f = self.setting.frames
        middle = f.origin[pose, patch] + height * f.n[pose, patch]
        return middle + flat[:, :1] * f.u[pose, patch] + flat[:, 1:] * f.v[pose, patch]

    @cached_property
    def _segments(self):
        """First point and end of each segment, shape [segment, 3], and its polyline."""
        is_segment = np.ones(self.batch.point_count, bool)
        is_segment[self.batch.polyline_start[1:][np.diff(self.batch.polyline_start) > 0] - 1] = False
        here = np.flatnonzero(is_segment)
        line = np.repeat(np.arange(self.batch.polyline_count), np.diff(self.batch.polyline_start))[here]
        return self.local[here], self.local[here + 1], line

    def _summed(self, line, value):
        out = np.zeros((self.batch.polyline_count, *value.shape[1:]))
        np.add.at(out, line, value)
        return out

    @cached_property
    def areas(self):
        """Area [m2], first [m3] and second moments xx xy yy [m4] of closed polylines, 0 of open ones, [polyline, 6]."""
        a, b, line = self._segments
        (x, y), (p, q) = a[:, :2].T, b[:, :2].T
        cross = (x * q - p * y) * self.closed[line]
        parts = (1 / 2, (x + p) / 6, (y + q) / 6, (x * x + x * p + p * p) / 12)
        mixed = (2 * x * y + x * q + p * y + 2 * p * q) / 24
        parts += (mixed, (y * y + y * q + q * q) / 12)
        return self._summed(line, np.stack([cross * part for part in parts], axis=1))

    @cached_property
    def strokes(self):
        """The same of the lines themselves: length [m], first [m2], second moments [m3], shape [polyline, 6]."""
        a, b, line = self._segments
        (x, y), (p, q) = a[:, :2].T, b[:, :2].T
        length = np.sqrt((p - x) * (p - x) + (q - y) * (q - y))
        parts = (1.0, (x + p) / 2, (y + q) / 2, (x * x + x * p + p * p) / 3)
        mixed = (2 * x * y + x * q + p * y + 2 * p * q) / 6
        parts += (mixed, (y * y + y * q + q * q) / 3)
        return self._summed(line, np.stack([length * part for part in parts], axis=1))

    @cached_property
    def heights(self):
        """Length times mean height above the patch's plane [m2], shape [polyline]."""
        a, b, line = self._segments
        return self._summed(line, np.linalg.norm(b - a, axis=1) * (a[:, 2] + b[:, 2]) / 2)

    def groups(self, per):
        """Polylines that belong together, by pose and patch; per "region": an outer loop with its holes, or "patch"."""
        key = list(zip(self.pose.tolist(), self.batch.polyline_patch.tolist(), strict=True))
        patches = [np.array([k for k, own in enumerate(key) if own == one]) for one in sorted(set(key))]
        return patches if per == "patch" else [group for lines in patches for group in self._regions(lines)]

    def _regions(self, lines):
        """Polylines of one patch by region."""
        area = self.areas[lines, 0]
        outer = lines[self.closed[lines] & (area > 0)]
        owner = {int(line): int(line) for line in lines}
        for hole in lines[self.closed[lines] & (area < 0)].tolist():
            around = [k for k in outer.tolist() if holds(self.loop(k), self.loop(hole))]
            if around:
                owner[hole] = min(around, key=lambda k: (self.areas[k, 0], k))
        return [np.array([k for k in owner if owner[k] == own]) for own in dict.fromkeys(owner.values())]


def holds(loop, inner):
    """Whether a loop winds around another that does not cross it: more of its vertices are inside than not."""
    return bool(2 * np.count_nonzero(windings(loop, inner)) > len(inner))


def windings(loop, points):
    """How often a loop goes around each point, int, shape [point]."""
    a, b = loop[None], np.roll(loop, -1, axis=0)[None]
    x, y = points[:, None, 0], points[:, None, 1]
    left = (b[..., 0] - a[..., 0]) * (y - a[..., 1]) - (x - a[..., 0]) * (b[..., 1] - a[..., 1])
    up = (a[..., 1] <= y) & (b[..., 1] > y) & (left > 0)
    down = (a[..., 1] > y) & (b[..., 1] <= y) & (left < 0)
    return np.count_nonzero(up, axis=1) - np.count_nonzero(down, axis=1)


class Stroke(NamedTuple):
    """A polyline that a stage made."""

    pose: int
    patch: int
    points: np.ndarray
    """[m], array frame, shape [point, 3]; a closed one does not repeat its first point here."""
    closed: bool


def batch_of_strokes(strokes, pose_count):
    """A batch of polylines that stages made, in their order within a pose and patch; those of no length are left out.

    Points that float32 makes equal to the one before are left out.
    """
    lines = []
    for one in sorted(strokes, key=lambda d: (d.pose, d.patch)):
        points = np.asarray(one.points, np.float32)
        if one.closed:
            points = np.concatenate([points, points[:1]])
        points = points[np.concatenate([[True], (points[1:] != points[:-1]).any(axis=1)])] if len(points) else points
        if len(points) > 1:
            lines.append((points, one))
    count = np.array([len(points) for points, _ in lines], np.int64)
    pose = np.array([one.pose for _, one in lines], np.int64)
    return ContourBatch(
        points=np.concatenate([np.zeros((0, 3), np.float32), *[points for points, _ in lines]]),
        kind=np.full(int(count.sum()), MADE, np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        polyline_patch=np.array([one.patch for _, one in lines], np.int32),
        polyline_closed=np.array([one.closed for _, one in lines], np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(np.bincount(pose, minlength=pose_count))]).astype(np.int64),
    )
