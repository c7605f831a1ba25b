"""Lines of two files stand on one axis, each value that of the pose that is shown then."""

import numpy as np
import pytest

pytest.importorskip("viser")

from palpate.render.view.live.plots import _lines_of, on_one_axis  # after the skip
from palpate.render.view.series import PoseWindow


def test_values_of_the_second_file_are_those_of_the_time():
    first, second = np.arange(0, 1, 0.1), np.arange(0, 0.6, 0.25)
    time, lines = on_one_axis([(first, (first,)), (second, (second, -second))])
    assert time is first
    assert len(lines) == 3
    expected = [max((s for s in second if s <= t), default=np.nan) if t <= second[-1] else np.nan for t in first]
    np.testing.assert_allclose(lines[1], expected)
    np.testing.assert_allclose(lines[2], -np.array(expected))


def test_times_and_numbers_never_share_an_axis():
    """0.1 s is no pose number 0: files of both kinds stand on an axis of numbers."""
    timed = PoseWindow(0, np.arange(4) / 90, *np.zeros((3, 4)))
    numbered = PoseWindow(2, np.arange(2.0, 6.0), *np.zeros((3, 4)))
    assert timed.places(by_time=False).tolist() == [0, 1, 2, 3]
    assert numbered.places(by_time=False).tolist() == [2, 3, 4, 5]


def test_a_line_is_dots_so_that_nothing_joins_what_a_gap_parts():
    """uPlot draws a line on past NaN; a dot at NaN is none."""
    for series in _lines_of(["a", "b"]):
        assert series["width"] == 0
        assert series["points"]["show"] is True
