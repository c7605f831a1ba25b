"""Lines of two files stand on one axis, each value that of the pose that is shown then."""

import numpy as np
import pytest

pytest.importorskip("viser")

from palpate.render.view.live.plots import on_one_axis  # after the skip


def test_values_of_the_second_file_are_those_of_the_time():
    first, second = np.arange(0, 1, 0.1), np.arange(0, 0.6, 0.25)
    time, lines = on_one_axis([(first, (first,)), (second, (second, -second))])
    assert time is first
    assert len(lines) == 3
    expected = [max((s for s in second if s <= t), default=np.nan) if t <= second[-1] else np.nan for t in first]
    np.testing.assert_allclose(lines[1], expected)
    np.testing.assert_allclose(lines[2], -np.array(expected))
