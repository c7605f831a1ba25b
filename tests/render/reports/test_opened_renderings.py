"""Which poses are shown: distinct ones by choice, or exactly those at the times that are asked for."""

import numpy as np
import pytest

from palpate.render.errors import StrategyError
from palpate.render.reports.opened_renderings import MOMENTS_MOST, MotionMoments, distinct_poses, poses_at

STILL = np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32)
LINE = np.array([[0.0, 0, 0], [0.02, 0, 0]])  # [m], a contour in the hand's frame


def moments(x, time=None):
    """Poses whose hands stand at these places along x [m]."""
    pose = np.tile(STILL, (len(x), 1))
    pose[:, 0] = x
    return MotionMoments(pose, time)


def carried(motion):
    """Contours that the hand carries along."""
    return lambda index: LINE + motion.pose[index, :3]


def test_a_hand_that_rests_is_shown_once():
    motion = moments(np.zeros(500))
    assert distinct_poses(np.ones(500), motion, carried(motion), 3).tolist() == [0]


def test_near_poses_are_not_shown_twice_though_they_are_worth_most():
    x = np.zeros(300)
    x[200:] = 0.1
    worth = np.where(np.arange(300) < 200, 1.0, 0.3)
    motion = moments(x)
    chosen = distinct_poses(worth, motion, carried(motion), 3)
    assert len(chosen) == 2
    assert chosen[0] < 200 <= chosen[1]


def test_the_same_pose_with_another_contour_is_another_moment():
    motion = moments(np.zeros(100))
    both = distinct_poses(np.ones(100), motion, lambda i: LINE + STILL[:3] + (0, 0.03 * (i < 50), 0), 3)
    assert len(both) == 2


def test_without_any_contour_the_first_pose_is_shown():
    motion = moments(np.zeros(10))
    assert distinct_poses(np.zeros(10), motion, carried(motion), 3).tolist() == [0]


def test_times_show_the_nearest_pose():
    motion = moments(np.zeros(4), np.array([1.0, 2.0, 4.0, 8.0]))
    assert poses_at([5.9, 1.4, 8.0], motion, "a.h5").tolist() == [0, 2, 3]
    assert poses_at([3, 1], moments(np.zeros(4)), "a.h5").tolist() == [1, 3]  # numbers of poses
    assert (motion.text(2), moments(np.zeros(4)).text(2)) == ("4.00 s", "pose 2")


@pytest.mark.parametrize(
    ("times", "timed", "message"),
    [
        ([8.1], True, "time 8.1 s is outside a.h5, which has times 1 to 8 s"),
        ([0.9], True, "outside a.h5"),
        ([float("nan")], True, "outside a.h5"),
        ([1.0, 1.2], True, "shows pose 0 again"),
        ([], True, f"1 to {MOMENTS_MOST} moments, not 0"),
        (range(7), False, f"1 to {MOMENTS_MOST} moments, not 7"),
        ([1.5], False, "has no times, so moments are numbers of poses, not 1.5"),
        ([4], False, "pose 4 is outside a.h5, which has poses 0 to 3"),
    ],
)
def test_times_that_cannot_be_shown_are_refused_with_value_and_bounds(times, timed, message):
    motion = moments(np.zeros(4), np.array([1.0, 2.0, 4.0, 8.0]) if timed else None)
    with pytest.raises(StrategyError, match=message):
        poses_at(times, motion, "a.h5")
