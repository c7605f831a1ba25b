"""Tests of the paper: against values worked by hand, and in cases that say nothing."""

import numpy as np
import pytest

from palpate.render.reproduction.significance import holm, mean_zero, normality, paired


def test_holm_steps_down_and_never_falls():
    # Sorted 0.01, 0.02, 0.022 times 3, 2, 1: 0.03, 0.04, 0.022, and the last is raised to what stands before it.
    assert holm({"a": 0.02, "b": 0.01, "c": 0.022}) == pytest.approx({"a": 0.04, "b": 0.03, "c": 0.04})


def test_holm_ends_at_1_and_leaves_out_what_says_nothing():
    assert holm({"a": 0.6, "b": None, "c": 0.9}) == {"a": 1.0, "b": None, "c": 1.0}
    assert holm({}) == {}


def test_wilcoxon_of_few_pairs_is_exact():
    # Six differences of one sign: 2 of the 2^6 equally likely patterns of signs are as extreme.
    a = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert paired(a, np.zeros(6)) == pytest.approx(2 / 64)
    # Ranks of one sign 1 + 2: W = 3, which 5 patterns of each tail reach: {}, {1}, {2}, {3}, {1, 2}.
    assert paired(a, np.array([2.0, 4.0, 0.0, 0.0, 0.0, 0.0])) == pytest.approx(2 * 5 / 64)


def test_pairs_with_a_missing_value_are_left_out():
    a = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, np.nan, 9.0])
    b = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, np.nan])
    assert paired(a, b) == pytest.approx(2 / 64)


def test_t_test_of_a_known_sample():
    # mean 2, sd 1, n 3: t = 2 sqrt 3, and with two degrees of freedom p = 1 - t / sqrt(t^2 + 2).
    t = 2.0 * np.sqrt(3.0)
    assert mean_zero(np.array([1.0, 2.0, 3.0])) == pytest.approx(1.0 - t / np.sqrt(t**2 + 2.0))


def test_shapiro_tells_a_skewed_sample_from_an_even_one():
    even = np.linspace(-1.0, 1.0, 30)
    found, skewed = normality(even), normality(np.exp(4.0 * even))
    assert found is not None
    assert skewed is not None
    assert skewed < 0.001 < found


@pytest.mark.parametrize("values", [[], [1.0], [2.0, 2.0, 2.0, 2.0], [np.nan, np.nan, 3.0]])
def test_too_few_or_equal_values_say_nothing(values):
    values = np.array(values)
    assert normality(values) is None
    assert mean_zero(values) is None
    assert paired(values, values) is None
