"""Poses that a page holds: ranges, each n-th, and what would fit."""

from types import SimpleNamespace

import pytest

from palpate.render import StrategyError
from palpate.render.view.page.selection import choose_rows, spread, what_fits

SCENE = SimpleNamespace(pose_count=100, path="tube.h5")


@pytest.mark.parametrize(
    ("poses", "every", "chosen"),
    [
        (None, None, range(100)),
        ("10:20", None, range(10, 20)),
        ("90:", 3, range(90, 100, 3)),
        (":5", None, range(5)),
        ((3, None), 50, range(3, 100, 50)),
        ((98, 100), 1, range(98, 100)),
    ],
)
def test_ranges_and_each_nth(poses, every, chosen):
    assert choose_rows(SCENE, poses, every) == chosen


@pytest.mark.parametrize(
    ("poses", "every", "message"),
    [
        ("90:101", None, "poses 90:101 are not all in tube.h5, which has poses 0:100"),
        ("-1:5", None, "poses -1:5 are not all in"),
        ("7:7", None, "poses 7:7 are none"),
        ("7", None, "must be a range FIRST:STOP, as 100:200"),
        (5, None, "must be a range FIRST:STOP"),
        ("a:b", None, "must be a range of whole numbers"),
        ((1.5, float("inf")), None, "must be a range of whole numbers"),
        (None, 0, "every must be a whole number of at least 1, not 0"),
        (None, 2.5, "every must be a whole number of at least 1"),
        (None, True, "every must be a whole number of at least 1"),
    ],
)
def test_what_is_no_range_is_refused(poses, every, message):
    with pytest.raises(StrategyError, match=message):
        choose_rows(SCENE, poses, every)


def test_a_spread_has_both_ends_and_no_pose_twice():
    assert spread(range(5, 50, 5), 3) == [5, 25, 45]
    assert spread(range(4), 10) == [0, 1, 2, 3]
    assert spread(range(7, 8), 10) == [7]


def test_what_fits_is_a_part_of_the_range():
    assert what_fits(range(100, 1000, 3), 0.5) == 'every=6, or poses="100:550" with every=3'
    assert what_fits(range(10), 0.05) == ""
    assert what_fits(range(3), 0.7) == 'every=2, or poses="0:2"'
