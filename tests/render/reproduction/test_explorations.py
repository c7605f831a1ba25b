"""r of blocks, in both readings of a palm wholly inside, and the explorations that it is of."""

import numpy as np
import pytest

from palpate.render import MeshObject, Palm, StrategyError, closed_contour, open_contour, render
from palpate.render.reproduction.explorations import (
    FeltLengths,
    StudySettings,
    block_ratios,
    explorer_motion,
    holm,
    measure_lengths,
    ratio_tests,
    ratio_values,
)
from palpate.render.reproduction.paper_numbers import BLOCK_COUNT, EXPLORATION_SECONDS


def felt(closed, opened):
    """Lengths of one explorer with one block a row."""
    shape = (1, *np.shape(closed))
    return FeltLengths("made", *(np.array(part, np.float32).reshape(shape) for part in (closed, opened)))


def test_r_is_a_ratio_of_means_and_a_palm_inside_counts_in_one_reading_only():
    found = block_ratios(felt([[0.3, 0.4, 0.0], [0.1, 0.1, 0.1]], [[0.1, 0.0, 0.0], [0.1, 0.1, 0.1]]))
    assert found.whole == pytest.approx(np.array([[7.0, 1.0]]))
    assert found.open == pytest.approx(np.array([[3.0, 1.0]]))


def test_a_block_without_open_contours_has_no_r_and_is_counted():
    found = block_ratios(felt([[0.4], [0.2]], [[0.0], [0.1]]))
    assert np.isnan(found.whole).tolist() == [[True, False]]
    summary = ratio_values({"made": found.whole})["made"]
    assert (summary["mean"], summary["sd"], summary["blocks"]) == (pytest.approx(2.0), None, 1)
    assert summary["blocks_without_contours"] == 1
    assert ratio_values({"none": np.full((1, 1), np.nan)})["none"]["mean"] is None


def test_blocks_are_tested_as_they_are_and_as_means_of_explorers():
    r = {"cube": 2.0 + 0.01 * np.arange(12.0).reshape(6, 2), "tube": 1.0 + 0.02 * np.arange(12.0).reshape(6, 2)}
    found = ratio_tests(r)
    assert found["by_block"] == {"cube - tube": pytest.approx(2 / 2**12)}
    assert found["by_explorer"] == {"cube - tube": pytest.approx(2 / 2**6)}


def test_lengths_are_those_of_both_renderings_of_the_same_motions():
    cube, settings, done = MeshObject.load("cube"), StudySettings(2, 1, Palm(0.07, 0.09)), []
    found = measure_lengths(cube, settings, done.append)
    assert done == [1, 2]
    assert found.closed.shape == found.open.shape == (2, BLOCK_COUNT, round(90 * EXPLORATION_SECONDS))
    motion = explorer_motion(cube, 1, 1)
    assert found.closed[1, 1] == pytest.approx(render(cube, settings.palm, motion, closed_contour()).length())
    assert found.open[1, 1] == pytest.approx(render(cube, settings.palm, motion, open_contour()).length(), abs=1e-6)


@pytest.mark.parametrize(
    ("explorers", "repetitions", "message"),
    [
        (0, 10, "explorers must lie in 1..1000, not 0"),
        (1001, 10, "explorers must lie in 1..1000, not 1001"),
        (18, -1, "repetitions must lie in 1..1000, not -1"),
        (1.5, 10, "explorers must be a whole number in 1..1000, not 1.5"),
        (True, 10, "explorers must be a whole number in 1..1000, not True"),
    ],
)
def test_counts_out_of_bounds_are_refused(explorers, repetitions, message):
    with pytest.raises(StrategyError, match=message):
        StudySettings(explorers, repetitions)


def test_holm_steps_down_and_never_falls():
    # Sorted 0.01, 0.02, 0.022 times 3, 2, 1: 0.03, 0.04, 0.022, and the last is raised to what stands before it.
    assert holm({"a": 0.02, "b": 0.01, "c": 0.022}) == pytest.approx({"a": 0.04, "b": 0.03, "c": 0.04})


def test_holm_ends_at_1_and_leaves_out_what_says_nothing():
    assert holm({"a": 0.6, "b": None, "c": 0.9}) == {"a": 1.0, "b": None, "c": 1.0}
    assert holm({}) == {}
