"""Balanced Latin squares against a published one, and by counting."""

import itertools
from collections import Counter

import numpy as np
import pytest

from palpate.render.study.plan.block_designs import balanced_square, row_count, square_fault


@pytest.mark.parametrize(
    "published",
    [
        ["12", "21"],
        ["1243", "2314", "3421", "4132"],
        ["126354", "231465", "342516", "453621", "564132", "615243"],
    ],
    ids=len,
)
def test_even_squares_are_those_that_bradley_published(published):
    # J. V. Bradley (1958), Complete counterbalancing of immediate sequential effects in a Latin square design, J. Am.
    # Stat. Assoc. 53(282), 525-528: first row 1, 2, n, 3, n - 1, ...; each column counts on from there.
    rows = ["".join(str(condition + 1) for condition in row) for row in balanced_square(len(published))]
    assert rows == published


@pytest.mark.parametrize("count", range(1, 17))
def test_conditions_positions_and_neighbours_come_equally_often(count):
    square = balanced_square(count)
    assert square.shape == (row_count(count), count)
    assert (np.sort(square, axis=1) == np.arange(count)).all()
    times = row_count(count) // count
    assert all((np.bincount(column, minlength=count) == times).all() for column in square.T)
    pairs = Counter((int(one), int(next_)) for row in square for one, next_ in itertools.pairwise(row))
    assert pairs == {(one, other): times for one in range(count) for other in range(count) if one != other}


def test_fault_names_nearest_counts_of_participants_and_of_blocks():
    # 18 participants fill the 6 rows of six blocks, and neither the 10 rows of five nor the 14 rows of seven.
    assert square_fault(5, 18) == (
        "the order of blocks is not balanced: a balanced Latin square of 5 blocks has 10 rows, and 18 participants "
        "fill no whole ones; the nearest that do are 10 or 20 participants, or 18 with 6 blocks"
    )
    assert square_fault(7, 3) == (
        "the order of blocks is not balanced: a balanced Latin square of 7 blocks has 14 rows, and 3 participants "
        "fill no whole ones; the nearest that do are 14 participants"
    )


@pytest.mark.parametrize("conditions", range(2, 9))
@pytest.mark.parametrize("participants", range(1, 30))
def test_a_fault_is_found_where_counting_finds_one(conditions, participants):
    square = balanced_square(conditions)
    rows = square[np.arange(participants) % len(square)]
    columns = np.array([np.bincount(column, minlength=conditions) for column in rows.T])
    pairs = np.zeros((conditions, conditions), int)
    np.add.at(pairs, (rows[:, :-1], rows[:, 1:]), 1)
    is_balanced = np.ptp(columns) == 0 and np.ptp(pairs[~np.eye(conditions, dtype=bool)]) == 0
    assert (square_fault(conditions, participants) is None) == is_balanced
