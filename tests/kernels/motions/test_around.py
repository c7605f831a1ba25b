"""Poses on splines: the bits of the model in NumPy, but where they are listed as doubtful."""

import numpy as np

from palpate.datasets.motions.exploration import control_count, control_turns, spline_poses
from palpate.datasets.motions.exploration_strokes import ControlPoints, control_points
from palpate.kernels.motions.around import place_on_splines, spline_ranges

BOX = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])


def placed(control, rate, first, count, device):
    """Poses first..first + count of each motion."""
    turn = np.concatenate([control_turns(control.quaternion), np.zeros((1, 3))])
    ranges = spline_ranges(control.start[:-1], rate, first)
    start = np.cumsum([0, *count])
    pose, doubtful = place_on_splines(control.position, control.quaternion, turn, ranges, start, device=device)
    return pose.numpy(), np.sort(doubtful.numpy())


def model(control, motion, rate, first, count):
    rows = slice(control.start[motion], control.start[motion + 1])
    own = ControlPoints(control.position[rows], control.quaternion[rows], np.array([0, 1]))
    return spline_poses(own, (first + np.arange(count)) / rate).astype(np.float32)


def test_bits_are_those_of_the_model_but_where_they_are_doubtful(device):
    rate, first, count = np.array([90.0, 90.0, 7.3, 4e4]), np.array([0, 500, 3, 100]), [15_000, 2200, 150, 8_000]
    ends = (first + count) / rate
    control = control_points(np.repeat(BOX[None], 4, axis=0), [1, 2, 3, 4], [control_count(end) for end in ends])
    pose, doubtful = placed(control, rate, first, count, device)
    wanted = np.concatenate([model(control, k, rate[k], first[k], count[k]) for k in range(4)])
    sure = np.setdiff1d(np.arange(len(pose)), doubtful)
    np.testing.assert_array_equal(pose[sure], wanted[sure])
    assert len(doubtful) < 20


def test_numbers_between_two_of_float32_are_doubtful_and_a_hand_at_rest_is_not(device):
    half = np.float64(np.float32(0.1)) + 0.5 * np.spacing(np.float32(0.1))
    for x, doubts in ((half, 2), (0.1, 0)):
        quaternion = np.tile([0.5, -0.5, 0.5, 0.5], (6, 1))
        control = ControlPoints(np.full((6, 3), x), quaternion, np.array([0, 6]))
        pose, doubtful = placed(control, np.array([10.0]), np.array([0]), [2], device)
        assert len(doubtful) == doubts
        np.testing.assert_array_equal(pose[:, 3:], quaternion[:2])


def test_no_pose_is_none(device):
    control = control_points(BOX[None], [1], [10])
    pose, doubtful = placed(control, np.array([90.0]), np.array([0]), [0], device)
    assert len(pose) == len(doubtful) == 0
