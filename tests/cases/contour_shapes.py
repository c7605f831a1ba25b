"""Small contour batches made by hand, for tests."""

import numpy as np

from palpate.render import ContourBatch


def batch_of(poses):
    """A batch from a list of poses, each a list of (points, closed)."""
    lines = [line for pose in poses for line in pose]
    points = [np.vstack([p, p[:1]]) if closed else np.asarray(p) for p, closed in lines]
    count = [len(p) for p in points]
    return ContourBatch(
        points=np.concatenate([*points, np.zeros((0, 3))]).astype(np.float32),
        kind=np.zeros(sum(count), np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum(count)]).astype(np.int64),
        polyline_patch=np.zeros(len(lines), np.int32),
        polyline_closed=np.array([closed for _, closed in lines], np.uint8),
        pose_start=np.concatenate([[0], np.cumsum([len(pose) for pose in poses])]).astype(np.int64),
    )


def circle(radius, centre=(0.0, 0.0, 0.2), count=64, turn=0.0):
    """Corners of a regular polygon in a plane z = const, counter-clockwise, the first at an angle of `turn`."""
    angle = turn + 2 * np.pi * np.arange(count) / count
    return np.asarray(centre) + radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def square(side, centre=(0.0, 0.0, 0.2)):
    """Corners of a square in a plane z = const, counter-clockwise."""
    corners = 0.5 * side * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return np.asarray(centre) + corners


def still(count):
    """Poses that do not move: palm down 0.2 m above the array."""
    return np.tile(np.array([0, 0, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]), (count, 1))
