"""Motions in other units or with quaternions in another order are named as such."""

import numpy as np
import pytest

from palpate.datasets.errors import RecordingWarning
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.motions.suspicious_values import likely_time_unit, suspicious_directions

DOWN = [0.0, 0.0, 0.2, 2**-0.5, 0.0, 0.0, 2**-0.5]  # 0.2 m above the array's centre, skin towards it


@pytest.mark.parametrize(
    ("interval", "pose_count", "said"),
    [
        (11.1, 10, "milliseconds; times are in seconds, 11.1 ms are 0.0111"),
        (11100.0, 3, "microseconds; times are in seconds, 11100 us are 0.0111"),
        (11111111.0, 2, "nanoseconds; times are in seconds, 1.11111e+07 ns are 0.0111111"),
        (11.1, 9, None),  # a few poses may be seconds apart
        (11100.0, 2, None),
        (0.9, 1000, None),
        (300.0, 1000, None),
    ],
)
def test_intervals_of_a_tracker_in_another_unit_are_named_by_it(interval, pose_count, said):
    assert likely_time_unit(interval, pose_count) == said


def test_six_rows_in_nanoseconds_are_warned_of():
    """Six rows 11,111,111 ns apart are a tracker at 90 Hz."""
    with pytest.warns(RecordingWarning, match="times are 1.11111e\\+07 s apart, which looks like nanoseconds"):
        HandMotion(11111111.0 * np.arange(6), [DOWN] * 6)


def test_poses_of_which_none_faces_the_array_are_named():
    """PALM_DOWN with w first, read as x y z w, turns the skin towards -x: 90 degrees from the array (exact)."""
    wrong_order = [*DOWN[:3], DOWN[6], *DOWN[3:6]]
    down, wrong = np.array([DOWN] * 5000, np.float32), np.array([wrong_order] * 5000, np.float32)
    assert list(suspicious_directions(down)) == []
    (sentence,) = suspicious_directions(wrong)
    assert sentence.startswith("no pose faces the array: ")
    assert "in all 5000 poses; quaternions in the order w x y z" in sentence
    wrong[4999] = down[0]
    assert list(suspicious_directions(wrong)) == []
