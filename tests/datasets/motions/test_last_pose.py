"""When motions end, by hand and in exact arithmetic."""

import numpy as np
import pytest

from palpate.datasets.motions.hand_motion import PALM_DOWN, HandMotion
from palpate.datasets.motions.last_pose import INTERVALS_LOOKED_AT, end_of_motion, usual_interval


@pytest.mark.parametrize(
    ("time", "end"),
    [
        ([0.0, 0.0625, 0.125], 0.1875),  # a tracker at 16 Hz: as long as the interval before
        ([0.0, 0.0625, 0.125, 4.0], 4.0625),  # lost for a while
        ([0.0, 0.5, 1.0], 1.5),  # 2 Hz
        ([0.0, 4.0], 4.0),  # two poses chosen by hand: a motion of 4 s, never one of 8 s
        ([0.0, 4.0, 500.0], 500.0),
        ([0.0], 0.0),
    ],
)
def test_the_last_pose_lasts_one_usual_interval_if_that_is_a_tracker_s(time, end):
    assert end_of_motion(np.array(time)) == end
    if len(time) > 1:
        pose = [[0.0, 0.0, 0.2, *PALM_DOWN]] * len(time)
        assert HandMotion(time, pose).duration == end


def test_the_first_intervals_and_the_last_time_are_enough():
    time = np.concatenate([np.arange(INTERVALS_LOOKED_AT + 1) / 64, 100.0 + np.arange(1, 20_000)])
    assert usual_interval(time) == 1 / 64
    assert end_of_motion(time[: INTERVALS_LOOKED_AT + 1], time[-1]) == end_of_motion(time) == 20_099 + 1 / 64
