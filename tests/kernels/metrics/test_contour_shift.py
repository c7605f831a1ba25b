"""Shifts of contours from pose to pose, against each point tested by itself."""

import itertools

import numpy as np
import pytest
import warp as wp
from insertion_oracle import moves_far

from palpate.kernels.contours import Contours
from palpate.kernels.metrics.contour_shift import find_shifts


def found(poses, compared, distance, device):
    """poses: a list of polylines for each."""
    lines = [line for pose in poses for line in pose]
    points = np.concatenate([*lines, np.zeros((0, 3))]).astype(np.float32)
    starts = [np.cumsum([0, *map(len, rows)]) for rows in (lines, poses)]
    contours = Contours()
    contours.points = wp.array(points, dtype=wp.vec3, device=device)
    contours.polyline_start, contours.pose_start = (wp.array(start, dtype=wp.int64, device=device) for start in starts)
    contours.polyline_closed = wp.zeros(len(lines), dtype=wp.uint8, device=device)
    of_which, far = (
        wp.array(compared, dtype=wp.uint8, device=device),
        wp.zeros(len(poses), dtype=wp.uint8, device=device),
    )
    find_shifts(contours, of_which, far, limit=distance - distance / 8, spacing=distance / 4)
    return far.numpy().astype(bool)


def contours(rng, shift):
    """A few polylines, open and closed ones, of long and short segments, and of none; moved by some distance [m]."""
    lines = []
    for _ in range(rng.integers(0, 4)):
        angle = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(1, 60)))
        ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * rng.uniform(0.001, 0.04)
        closed = np.concatenate([ring, ring[:1]]) if rng.random() < 0.5 else ring
        lines.append((closed + rng.normal(0, shift, 3) + [0, 0, 0.2]).astype(np.float32))
    return lines


@pytest.mark.parametrize("distance", [0.3e-3, 2e-3])
def test_every_point_is_looked_at(distance, device):
    rng = np.random.default_rng(3)
    poses = []
    for _ in range(10 if distance < 1e-3 else 60):
        these = contours(rng, 0.01)
        aside = rng.normal(0, 0.6 * distance, 3).astype(np.float32)
        order = [line[::-1] if rng.random() < 0.3 else line for line in (line + aside for line in these)]
        poses += [these, [order[k] for k in rng.permutation(len(order))]]
    wanted = [moves_far(a, b, distance) for a, b in itertools.pairwise(poses)]
    far = found(poses, np.ones(len(poses)), distance, device)
    assert len(wanted) / 12 < sum(wanted) < len(wanted) - 5
    np.testing.assert_array_equal(far, [*wanted, False])
    np.testing.assert_array_equal(found(poses, np.zeros(len(poses)), distance, device), False)


def test_contours_that_appear_do_not_count_and_those_that_disappear_do(device):
    line = np.array([[0, 0, 0.2], [0.01, 0, 0.2]], np.float32)
    near, other = [line], [line + np.float32(0.02)]
    assert found([near, [*near, *other]], [1, 1], 1e-3, device).tolist() == [False, False]
    assert found([[*near, *other], near], [1, 1], 1e-3, device).tolist() == [True, False]
    assert found([near, []], [1, 1], 1e-3, device).tolist() == [False, False]  # silence is no step
    assert found([[], []], [1, 1], 1e-3, device).tolist() == [False, False]
