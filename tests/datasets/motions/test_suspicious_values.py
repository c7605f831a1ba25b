"""Motions in other units or with quaternions in another order are named as such."""

import numpy as np
import pytest

from palpate.datasets.errors import RecordingWarning
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.motions.suspicious_values import (
    are_frames_in_ms,
    likely_time_unit,
    rounding,
    suspicious_directions,
)

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


@pytest.mark.parametrize(
    ("time", "are"),
    [
        ([0, 11, 22, 33], True),  # 90 Hz: 11.1 ms, rounded
        ([0, 33, 67, 100, 133], True),  # 30 Hz, rounded to the nearest
        ([0, 8, 16, 25], True),  # 120 Hz, rounded down
        ([0, 16, 33, 50], True),  # 60 Hz
        ([0, 14, 28, 42, 56], True),  # 72 Hz
        ([0, 4], False),
        ([0, 10, 20], False),
        ([0, 11, 22], False),
        ([0, 10, 20, 30], False),
        ([0, 5, 10, 15, 20], False),
        ([0, 8, 16, 24], False),
        ([0, 1, 2, 3, 4, 5], False),
        ([0, 30, 60, 90, 120], False),
        ([0, 11.5, 22.5, 33], False),
    ],
)
def test_few_frames_of_a_tracker_in_ms_are_told_from_seconds_that_a_person_chose(time, are):
    """Right values: k / rate in ms of trackers' rates, by hand."""
    assert are_frames_in_ms(np.array(time, float)) == are


def test_four_poses_in_ms_are_warned_of_and_four_in_seconds_are_not(recwarn):
    HandMotion([0, 10, 20, 30], [DOWN] * 4)
    assert not recwarn.list
    with pytest.warns(RecordingWarning, match="times are 11 s apart, which looks like milliseconds"):
        HandMotion([5000, 5011, 5022, 5033], [DOWN] * 4)


@pytest.mark.parametrize(
    ("quaternion", "decimals"),
    [
        ([0.71, 0, 0, 0.71], 2),  # sqrt(1 / 2) twice: norm 1.0041
        ([0.7, 0, 0, 0.7], 1),
        ([0.75, 0, 0, 0.75], None),  # norm 1.06, more than two decimals explain
        ([0.7131234, 0, 0, 0.7131234], None),
        ([0, 0, 0, 2], None),
    ],
)
def test_a_norm_that_rounded_cells_explain_is_named_as_such(quaternion, decimals):
    said = "" if decimals is None else f"; likely cause: rounded to {decimals} decimals: write six"
    assert rounding(np.array(quaternion, float)) == said


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
