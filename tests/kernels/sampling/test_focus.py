"""Focal points of a still contour, and what poses and motions are counted as."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle
from sampling_cases import drawn_room

from palpate.kernels.sampling.focus import FOCI_MOST
from palpate.render.errors import StrategyError
from palpate.render.sampling.strategy import SamplingStrategy

RING = circle(0.03, count=720)


def drawn(poses, device, strategy=None):
    """Positions and intensities of a motion of 90 poses a second, and its counts."""
    count = len(poses)
    room, *focus = drawn_room(
        batch_of(poses), np.arange(count) / 90, count / 90, strategy or SamplingStrategy(), device
    )
    return *focus, room.state.motion.numpy()[0]


def test_a_still_circle_is_drawn_in_equal_steps_from_pose_to_pose(device):
    position, intensity, count = drawn([[(RING, True)]] * 30, device)
    step = np.linalg.norm(np.diff(position[:, 0].astype(float), axis=0), axis=1)
    assert step == pytest.approx(np.full(len(step), 2 * np.pi * 0.03 / 270), rel=1e-3)
    assert set(intensity.ravel()) == {1.0}
    assert (count["samples"], count["drawn"], count["steps"]["silent"]) == (3334, 3334, 0)
    assert count["steps"]["jumps"].sum() == 0
    assert count["cycles"] == pytest.approx(3334 / 270)


def test_a_circle_that_moves_jumps_once_and_one_that_comes_back_re_enters(device):
    far = RING + np.array([0.05, 0.0, 0.0])
    _, _, count = drawn([[(RING, True)], [(far, True)], [], [(RING, True)]], device)
    assert count["steps"]["jumps"].tolist() == [0, 0, 1, 1]  # by cause: CAUSES
    assert count["steps"]["silent"] == 111


def test_two_circles_are_each_waited_for_while_the_other_is_drawn(device):
    pair = [(RING, True), (RING + np.array([0.07, 0.0, 0.0]), True)]
    _, _, count = drawn([pair] * 30, device)
    assert count["absence"] == pytest.approx(270, abs=1)
    assert count["steps"]["jumps"].tolist()[1:] == [0, 0, 0]
    assert count["steps"]["jumps"][0] == pytest.approx(3334 / 270, abs=1)


def test_a_strategy_has_no_more_foci_than_a_thread_has_room_for(device):
    position, _, _ = drawn([[(RING, True)]], device, SamplingStrategy(foci=FOCI_MOST))
    assert len(np.unique(position[50], axis=0)) == FOCI_MOST
    with pytest.raises(StrategyError, match="foci"):
        SamplingStrategy(foci=FOCI_MOST + 1)
