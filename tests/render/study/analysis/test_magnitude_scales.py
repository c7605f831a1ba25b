"""Exponents of exact power laws come back, and estimates that have no logarithm are counted."""

import numpy as np
import pytest
from answered_tables import QUESTION, levels_text, number, plan_of, stimulus_text, table_of

from palpate.render.study.analysis.level_answers import magnitude_scales

VALUES = [8.0, 1.0, 2.0, 4.0]
BLOCK = (
    f'[[block]]\nname = "m"\ndesign = "magnitude"\nstimuli = ["s1", "s2", "s3", "s4"]\nrepetitions = 2\n{QUESTION}\n'
)


def estimates(code, function, *, block="m", values=VALUES, repetitions=2, modulus=None):
    """A number for each stimulus, each time."""
    return [
        number(
            code,
            block,
            trial,
            function(values[trial % len(values)]),
            [*([modulus] if modulus else []), f"s{trial % len(values) + 1}"],
        )
        for trial in range(len(values) * repetitions)
    ]


@pytest.fixture(scope="module")
def plan():
    return plan_of(levels_text(VALUES), BLOCK)


@pytest.mark.parametrize("exponent", [0.33, 1.0, 3.5, -0.5, 0.0])
def test_the_exponent_of_an_exact_power_law_comes_back_whatever_its_unit(plan, exponent):
    answers = [estimates("P01", lambda x: 10.0 * x**exponent), estimates("P02", lambda x: 0.03 * x**exponent)]
    (own,) = magnitude_scales(table_of(plan, *answers))
    assert own.exponents == pytest.approx([exponent] * 2, abs=1e-12)
    assert own.x.tolist() == [1, 2, 4, 8]
    assert own.means[0] == pytest.approx([10.0 * x**exponent for x in (1, 2, 4, 8)])
    assert (own.left_out, own.reason) == (0, "")


def test_the_exponent_is_the_slope_of_least_squares_by_hand(plan):
    answers = [
        number("P01", "m", trial, value, [name])
        for trial, (name, value) in enumerate([("s2", 1.0), ("s3", 10.0), ("s4", 10.0)])
    ]
    (own,) = magnitude_scales(table_of(plan, answers))
    # log2 of the values: 0, 1, 2; log10 of the estimates: 0, 1, 1. Slope: ((-1)(-2/3) + (1)(1/3)) / 2 = 1/2 a doubling.
    assert own.exponents == pytest.approx([0.5 / np.log10(2.0)])


def test_zeros_are_left_out_and_counted_and_empty_answers_and_practice_are_nothing(plan):
    answers = estimates("P01", lambda x: x)
    answers += [
        number("P01", "m", 8, 0, ["s1"]),
        number("P01", "m", 9, -3.5, ["s1"]),
        number("P01", "m", 10, None, ["s1"]),
    ]
    answers += [number("P01", "m", 11, 1e6, ["s1"], is_practice=True), number("P01", "m", -1, 5, name="age")]
    (own,) = magnitude_scales(table_of(plan, answers))
    assert own.left_out == 2
    assert own.exponents == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("stimuli", "reason"),
    [
        (stimulus_text("s1", "s2", "s3", "s4", s1=1.0, s3=2.0), "the plan gives no `value` to s2, s4"),
        (levels_text([0, 1, 2, 3]), "values must be above 0 for a power law; the least is 0"),
        (levels_text([-0.5, 1, 2, 3]), "values must be above 0 for a power law; the least is -0.5"),
        (levels_text([3, 3, 3, 3]), "estimates of 1 value; a line needs 2"),
    ],
)
def test_what_has_no_power_law_says_why(stimuli, reason):
    plan = plan_of(stimuli, BLOCK)
    (own,) = magnitude_scales(table_of(plan, estimates("P01", lambda x: x)))
    assert own.reason == reason
    assert np.isnan(own.exponents).tolist() == [True]
