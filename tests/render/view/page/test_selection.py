"""Poses that a page holds, and what would fit."""

from palpate.render.view.page.selection import spread, what_fits


def test_a_spread_has_both_ends_and_no_pose_twice():
    assert spread(range(5, 50, 5), 3) == [5, 25, 45]
    assert spread(range(4), 10) == [0, 1, 2, 3]
    assert spread(range(7, 8), 10) == [7]


def test_what_fits_is_a_part_of_the_range():
    assert what_fits(range(100, 1000, 3), 0.5) == 'every=6, or poses="100:550" with every=3'
    assert what_fits(range(10), 0.05) == ""
    assert what_fits(range(3), 0.7) == 'every=2, or poses="0:2"'
