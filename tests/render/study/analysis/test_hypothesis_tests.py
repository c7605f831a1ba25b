"""Statistical tests: against published examples with R's numbers, SciPy's own functions, and what must not change p."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from published_examples import TESTS, table_of_examples
from scipy import stats

from palpate.render.errors import StudyError
from palpate.render.study.analysis.hypothesis_tests import (
    StatisticalTest,
    bound_proportion,
    check_normality,
    compare_levels_by_ranks,
    compare_pairs_by_means,
    compare_pairs_by_ranks,
    compare_participants,
    compare_with_centre_by_means,
    compare_with_centre_by_ranks,
    compare_with_chance,
    correct_family,
)

pytestmark = pytest.mark.exhaustive

NAN = np.nan
PAIRED = pytest.mark.parametrize("compare", [compare_pairs_by_ranks, compare_pairs_by_means])
FEW = settings(max_examples=25, deadline=None)
TENTHS = st.integers(0, 10).map(lambda own: own / 10.0)
"""Proportions of 10 answers: many ties and zeros, and differences that are not exact in binary."""


def pairs_of(size):
    return st.tuples(arrays(float, size, elements=TENTHS), arrays(float, size, elements=TENTHS))


@pytest.mark.parametrize("example", TESTS, ids=lambda own: own.name)
def test_published_examples_have_the_numbers_of_r(example):
    found = example.ours()
    for name, number in example.numbers.items():
        assert found[name] == pytest.approx(number, rel=example.tolerance, abs=example.tolerance), name


def test_the_page_of_measured_statistics_lists_these_tests():
    page = Path(__file__).parents[4] / "docs/measured/study-statistics.md"
    assert table_of_examples(TESTS) in page.read_text(encoding="utf-8")


# Wilcoxon ------------------------------------------------------------------------------------------------------------


@given(st.integers(1, 60).flatmap(pairs_of))
@FEW
def test_wilcoxon_is_that_of_scipy_for_tables_with_ties_and_zeros(pair):
    a, b = pair
    found = compare_pairs_by_ranks(a, b, "a - b")
    steps = np.round(10.0 * a) - np.round(10.0 * b)  # whole numbers have exact ties
    steps = steps[steps != 0.0]
    if len(steps) < 2:
        assert found.p == (1.0 if len(steps) else None)
        return
    is_exact = len(steps) == len(a) < 50 and len(np.unique(np.abs(steps))) == len(steps)
    method = "exact" if is_exact else "approx" if len(steps) > 5 else stats.PermutationMethod()  # all 2^n of them
    expected = stats.wilcoxon(steps, correction=True, method=method)
    assert found.p == pytest.approx(min(1.0, expected.pvalue), rel=1e-9)
    assert found.value == stats.rankdata(np.abs(steps))[steps > 0.0].sum()


def test_of_scipys_warnings_only_that_of_few_values_is_withheld(monkeypatch):
    """SciPy 1.13.1 warns so in stats/_wilcoxon.py, below 10 values; later ones do not. The test's note says it here."""

    def warning(*given, **options):
        warnings.warn("Sample size too small for normal approximation.", stacklevel=2)
        warnings.warn("invalid value encountered", RuntimeWarning, stacklevel=2)
        return 0.0, 0.5

    monkeypatch.setattr(stats, "wilcoxon", warning)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        found = compare_with_centre_by_ranks(np.array([1.0, 1.0, 2.0, 3.0, 4.0, 5.0, -6.0]), 0.0, "it")
    assert [str(own.message) for own in warned] == ["invalid value encountered"]
    assert found.p == 0.5
    assert "normal approximation with continuity correction" in found.note


def test_values_that_differ_by_rounding_are_ties_and_zeros():
    # 0.1 + 0.2 is not 0.3 in binary, and 0.7 - 0.6 is not 0.4 - 0.3.
    found = compare_pairs_by_ranks(np.array([0.1 + 0.2, 0.7, 0.4, 0.9]), np.array([0.3, 0.6, 0.3, 0.2]), "a - b")
    assert "1 zero left out; 2 differences tied in size" in found.note
    assert found.value == 6.0


def test_effects_are_the_share_of_ranks_and_the_mean_in_deviations():
    # Ranks of 3, -1, 2: the sum of those above 0 is 5, of those below 1; r = (5 - 1) / 6.
    values = np.array([3.0, -1.0, 2.0])
    assert compare_with_centre_by_ranks(values, 0.0, "x").effect_size == pytest.approx(4.0 / 6.0)
    means = compare_with_centre_by_means(values, 0.0, "x")
    assert means.effect_size == pytest.approx(values.mean() / values.std(ddof=1))
    assert (means.effect, compare_pairs_by_means(values, np.zeros(3), "x").effect) == ("Cohen's d", "Cohen's d_z")


def test_interval_of_the_pseudo_median_ends_where_the_test_begins_to_refuse():
    values = np.random.default_rng(3).normal(0.4, 1.0, 20)
    found = compare_with_centre_by_ranks(values, 0.0, "x")
    for end, outwards in ((found.difference_low, -1e-6), (found.difference_high, 1e-6)):
        assert compare_with_centre_by_ranks(values, end + outwards, "x").p < 0.05
        assert compare_with_centre_by_ranks(values, end - outwards, "x").p > 0.05


# What must change nothing, or only a sign ----------------------------------------------------------------------------


@PAIRED
@given(pair=pairs_of(12), seed=st.integers(0, 99))
@FEW
def test_the_order_of_participants_changes_nothing(compare, pair, seed):
    order = np.random.default_rng(seed).permutation(12)
    found, mixed = compare(*pair, "a - b"), compare(pair[0][order], pair[1][order], "a - b")
    for name in ("value", "p", "effect_size", "difference", "difference_low", "difference_high"):
        assert getattr(mixed, name) == pytest.approx(getattr(found, name), abs=1e-9)
    assert mixed.note == found.note


@given(arrays(float, (9, 4), elements=TENTHS))
@FEW
def test_friedman_is_that_of_scipy(matrix):
    found = compare_levels_by_ranks(matrix, "levels")
    if found.p is not None:
        expected = stats.friedmanchisquare(*np.round(10.0 * matrix).T)
        assert (found.value, found.p) == pytest.approx((expected.statistic, expected.pvalue), abs=1e-9)


# Where a test says nothing -------------------------------------------------------------------------------------------

NOTHING = {
    "shapiro, two values": (check_normality, [1.0, 2.0, NAN], "needs 3 values, and has 2; 1 missing value left out"),
    "shapiro, alike": (check_normality, [0.3, 0.1 + 0.2, 0.3], "all values are alike"),
    "shapiro, too many": (check_normality, np.arange(5001.0), "known for 5000 values at most, not 5001"),
    "wilcoxon, none": (compare_with_centre_by_ranks, [NAN], "there are no pairs; 1 missing value left out"),
    "wilcoxon, zeros": (compare_with_centre_by_ranks, [0.0, 0.0, 0.0], "all differences are zero"),
    "t, one value": (compare_with_centre_by_means, [1.0], "needs 2 differences, and has 1"),
    "t, alike": (compare_with_centre_by_means, [0.3, 0.1 + 0.2], "all differences are alike"),
    "t, zeros": (compare_with_centre_by_means, [0.0, 0.0], "all differences are zero"),
    "friedman, one": (compare_levels_by_ranks, [[1.0, 2.0, 3.0], [1.0, NAN, 2.0]], "needs 2 participants, and has 1"),
    "friedman, alike": (compare_levels_by_ranks, [[0.3, 0.1 + 0.2, 0.3], [2.0, 2.0, 2.0]], "same value at all levels"),
}


@pytest.mark.parametrize("case", NOTHING)
def test_a_test_that_says_nothing_has_no_p_and_says_why(case):
    compare, values, reason = NOTHING[case]
    centre = [0.0] if "centre" in compare.__name__ else []
    found = compare(np.array(values), *centre, "x")
    assert (found.p, found.value, found.effect_size, found.difference) == (None, None, None, None)
    assert found.note.startswith("no test: ")
    assert reason in found.note


# Families, counts ----------------------------------------------------------------------------------------------------


def test_holm_counts_only_tests_that_have_a_p():
    tests = [StatisticalTest(test="t", compares=str(p), n=9, p=p) for p in (0.01, None, 0.04, 0.03)]
    found = correct_family(tests)
    assert [own.p_holm for own in found] == [pytest.approx(0.03), None, pytest.approx(0.06), pytest.approx(0.06)]
    assert [replace(own, p_holm=None) for own in found] == tests
    assert correct_family([]) == ()
    assert correct_family(tests[1:2]) == (tests[1],)


@pytest.mark.parametrize(("successes", "count"), [(0, 10), (3, 10), (10, 10), (682, 925)])
def test_interval_of_a_proportion_leaves_a_fortieth_to_each_side(successes, count):
    low, high = bound_proportion(successes, count)
    # By the interval's definition: at its ends, so many successes or more, or fewer, have the probability 2.5 %.
    assert stats.binom.sf(successes - 1, count, low) == pytest.approx(0.025 if successes else 1.0)
    assert stats.binom.cdf(successes, count, high) == pytest.approx(0.025 if successes < count else 1.0)


REFUSED = {
    "lengths": (lambda: compare_pairs_by_ranks(np.zeros(3), np.zeros(2), "x"), "3 and 2 values"),
    "infinite": (lambda: check_normality(np.array([1.0, np.inf]), "x"), "values must hold finite numbers"),
    "dimensions": (lambda: check_normality(np.zeros((2, 2)), "x"), "values must have 1 dimension, not 2"),
    "centre": (lambda: compare_with_centre_by_means(np.zeros(2), NAN, "x"), "centre must be a finite number, not nan"),
    "two levels": (lambda: compare_levels_by_ranks(np.zeros((4, 2)), "x"), "3 or more levels as columns, not 2"),
    "chance": (lambda: compare_with_chance(1, 2, 1.5, "x"), "chance must lie in 0..1, not 1.5"),
    "more than asked": (lambda: bound_proportion(3, 2), "successes must be whole numbers in 0..count, not 3 of 2"),
    "half an answer": (lambda: compare_participants(np.array([0.5]), np.array([1]), "x"), "not 0.5 of 1"),
    "shapes": (lambda: compare_participants(np.zeros(2), np.zeros(3), "x"), "one value for each participant"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_malformed_is_refused_with_its_value_and_bound(case):
    call, message = REFUSED[case]
    with pytest.raises(StudyError, match=message):
        call()
