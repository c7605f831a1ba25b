"""Polylines of a pose matched with those of the pose before, by their middles and sizes."""

import numpy as np

MARKS_A_METRE = 1e7  # to which marks are rounded: else rounding would decide between polylines that lie on each other
NEARNESS = 0.02  # [m] a contour farther away than this, or larger by it, is another one: 1.8 m/s at 90 Hz


def marks_of(lines: list[np.ndarray]) -> np.ndarray:
    """Middle of each polyline and the root of its mean squared distance from there [m], to 1e-7, shape [polyline, 4].

    lines: vertices [m], each of shape [point, 3]. Every part counts by its length, so it does not matter where a loop
    starts, which way round it runs and how its vertices are spread; loops around the same middle differ in size.
    """
    points = np.concatenate(lines)
    first = np.cumsum([0, *[len(line) for line in lines[:-1]]])
    step = np.diff(points, axis=0)
    length = np.zeros(len(points))
    np.sqrt(np.einsum("ij,ij->i", step, step), out=length[:-1])
    length[first[1:] - 1] = 0.0  # from one polyline to the next
    total = np.maximum(np.add.reduceat(length, first), 1e-30)
    half = points.copy()
    half[:-1] += 0.5 * step
    middle = np.add.reduceat(length[:, None] * half, first) / total[:, None]
    off = half - np.repeat(middle, np.diff([*first, len(points)]), axis=0)
    square = np.add.reduceat(length * np.einsum("ij,ij->i", off, off), first) / total
    return np.rint(MARKS_A_METRE * np.column_stack([middle, np.sqrt(square)])) / MARKS_A_METRE


def matches_of(mark: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Number of the earlier polyline that each polyline is, -1 where there is none, shape [polyline].

    Two are the same if each is the other's nearest, by `marks_of`, within NEARNESS.
    """
    square = np.zeros((len(mark), len(before)))
    for own, other in zip(mark.T, before.T, strict=True):  # faster than one array with an axis of four
        off = own[:, None] - other
        off *= off
        square += off
    nearest = square.argmin(axis=1)
    here = np.arange(len(mark))
    same = (square.argmin(axis=0)[nearest] == here) & (square[here, nearest] <= NEARNESS**2)
    return np.where(same, nearest, -1)
