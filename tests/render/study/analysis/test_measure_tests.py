"""The tests of a measure against plain loops with SciPy, the founding paper's rule, and data that lack cells."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy import stats

from palpate.render.study.analysis.answer_measures import Cell, Measure
from palpate.render.study.analysis.measure_tests import (
    AGAINST,
    AMBIGUOUS,
    FOR,
    analyse_measure,
    compare_levels,
    matched_values,
)

OBJECTS, OPACITIES = ("cube", "tube", "dog"), (1.0, 0.7)
CELLS = tuple(Cell(f"{own}-{of}", {"object": own, "opacity": of}) for own, of in product(OBJECTS, OPACITIES))
TRIALS = 10


def proportions(values, *, cells=CELLS, trials=TRIALS):
    values = np.array(values, dtype=float)
    counts = np.where(np.isfinite(values), trials, 0)
    return Measure(
        name="p_cc", title="p", codes=tuple(f"P{k:02}" for k in range(len(values))), cells=tuple(cells), values=values,
        successes=np.nan_to_num(values * trials).round().astype(np.int64), counts=counts, chance=0.5,
    )  # fmt: skip


def points(values, *, cells=CELLS):
    values = np.array(values, dtype=float)
    codes = tuple(f"P{k:02}" for k in range(len(values)))
    return Measure(name="ease", title="ease", codes=codes, cells=tuple(cells), values=values)


@pytest.fixture(scope="module")
def drawn():
    """Points of 14 participants without ties, so that exact tests are exact."""
    return np.random.default_rng(8).normal(0.3, 1.0, (14, 6)) + np.array([0.8, 0.5, 0, 0, 0, 0])


def holm(p):
    """Holm's correction in a plain loop: the k-th smallest of m times m - k, never below one before."""
    found, least = {}, 0.0
    for k, place in enumerate(sorted(range(len(p)), key=lambda place: p[place])):
        least = max(least, min(1.0, p[place] * (len(p) - k)))
        found[place] = least
    return [found[place] for place in range(len(p))]


def mean_at(values, wanted):
    """Each participant's mean over the cells with a level, in a plain loop."""
    places = [place for place, cell in enumerate(CELLS) if wanted in cell.factors.values()]
    return np.array([sum(row[place] for place in places) / len(places) for row in values])


def test_pairs_of_levels_take_one_number_of_each_participant(drawn):
    found = compare_levels(points(drawn), "object")
    pairs = list(combinations(OBJECTS, 2))
    assert [own.compares for own in found.by_ranks] == [f"{one} - {other}" for one, other in pairs]
    p = [stats.wilcoxon(mean_at(drawn, one), mean_at(drawn, other), method="exact").pvalue for one, other in pairs]
    assert [own.p for own in found.by_ranks] == pytest.approx(p)
    assert [own.p_holm for own in found.by_ranks] == pytest.approx(holm(p))
    t = [stats.ttest_rel(mean_at(drawn, one), mean_at(drawn, other)).pvalue for one, other in pairs]
    assert [own.p for own in found.by_means] == pytest.approx(t)
    assert [own.p_holm for own in found.by_means] == pytest.approx(holm(t))
    assert {own.n for own in (*found.by_ranks, *found.by_means)} == {14}
    expected = stats.friedmanchisquare(*(mean_at(drawn, own) for own in OBJECTS))
    assert (found.omnibus.value, found.omnibus.p) == pytest.approx((expected.statistic, expected.pvalue))
    assert found.omnibus.compares == "ease by object"


def test_beside_stands_each_cell_of_a_participant_as_in_the_paper(drawn):
    (own,) = compare_levels(points(drawn), "opacity").by_cells
    expected = stats.wilcoxon(drawn[:, ::2].ravel(), drawn[:, 1::2].ravel(), method="exact")
    assert own.n == 42
    assert own.p == pytest.approx(expected.pvalue)


def test_chance_is_compared_with_participants_means_and_beside_with_cells(drawn):
    values = np.clip(0.5 + drawn / 20.0, 0.0, 1.0)
    found = analyse_measure(proportions(values))
    assert found.chance_by_ranks.n == found.chance_by_means.n == 14
    means = np.array([sum(row) / len(row) for row in values])
    assert found.chance_by_ranks.p == pytest.approx(stats.wilcoxon(means - 0.5, method="exact").pvalue)
    assert found.chance_by_means.p == pytest.approx(stats.ttest_1samp(means, 0.5).pvalue)
    assert found.chance_by_cells.n == found.normality.n == 84
    assert found.normality.p == pytest.approx(stats.shapiro(values.ravel()).pvalue)
    assert found.chance_by_ranks.compares == "p_cc - 0.5"


def test_cells_are_matched_by_all_other_factors_whatever_their_order():
    cells = [
        Cell("a", {"object": "cube", "opacity": 1.0}), Cell("b", {"object": "cube", "opacity": 0.7}),
        Cell("c", {"opacity": 0.7, "object": "tube"}), Cell("d", {"opacity": 1.0, "object": "tube"}),
    ]  # fmt: skip
    a, b = matched_values(points([[1, 2, 3, 4]], cells=cells), "object", "cube", "tube")
    assert (a.tolist(), b.tolist()) == ([[1, 2]], [[4, 3]])


def test_cells_that_have_no_partner_are_left_out_of_a_pair_of_levels():
    cells = [*CELLS[:4], CELLS[4]]  # the dog is opaque only
    own = points([[1, 2, 3, 4, 5], [2, 2, 2, 2, 9]], cells=cells)
    a, b = matched_values(own, "object", "cube", "dog")
    assert (a.tolist(), b.tolist()) == ([[1], [2]], [[5], [9]])
    a, b = matched_values(own, "opacity", 1.0, 0.7)
    assert (a.tolist(), b.tolist()) == ([[1, 3], [2, 2]], [[2, 4], [2, 2]])


def test_cells_that_repeat_their_levels_are_averaged():
    cells = [
        Cell("easy cube", {"object": "cube"}),
        Cell("hard cube", {"object": "cube"}),
        Cell("tube", {"object": "tube"}),
    ]
    a, b = matched_values(points([[1, 5, 2]], cells=cells), "object", "cube", "tube")
    assert (a.tolist(), b.tolist()) == ([[3]], [[2]])


def paper_rows():
    """Cells of 18 participants: 12 for, 3 against, 3 ambiguous by the rule of section 6.2."""
    high, low = [1.0, 0.9, 0.5, 0.7, 0.6], [0.0, 0.1, 0.5, 0.3, 0.4]
    rows = [[*high, 0.9]] * 6 + [[*high, 0.2]] * 3 + [[0.2, *high]] * 2 + [[0.5, 0.5, 0.5, 0.5, 0.6, 0.5]]
    rows += [[*low, 0.1], [*low, 0.9], [0.5, 0.5, 0.4, 0.5, 0.5, 0.5]]
    return [*rows, [0.9, 0.8, 0.7, 0.9, 0.2, 0.1], [0.1, 0.1, 0.1, 0.9, 0.9, 0.9], [0.5] * 6]


def test_tendencies_follow_the_founding_papers_rule():
    found = analyse_measure(proportions(paper_rows())).tendencies
    kinds = [own.tendency for own in found]
    # "at least 5 out of 6 at 0.5 or higher": a row of 0.5 and a single 0.6 or 0.4 satisfies the rule both ways.
    assert kinds == [FOR] * 11 + [AMBIGUOUS] + [AGAINST] * 2 + [AMBIGUOUS] * 4
    assert [found[place].above for place in (0, 6, 9, 12, 15)] == [6, 5, 5, 1, 4]
    assert found[0].mean == pytest.approx((1.0 + 0.9 + 0.5 + 0.7 + 0.6 + 0.9) / 6)


@pytest.mark.parametrize("count", range(1, 31))
def test_five_sixths_are_counted_exactly(count):
    cells = [Cell(str(k), {"hand": "left"}) for k in range(count)]  # one level: no pairs of levels
    least = next(k for k in range(count + 1) if 6 * k >= 5 * count)  # in whole numbers
    for above in (least - 1, least):
        values = [[0.9] * above + [0.1] * (count - above)]
        (own,) = analyse_measure(proportions(values, cells=cells)).tendencies
        assert (own.tendency == FOR) == (above == least), (above, count)


def test_each_participants_answers_are_one_family_of_binomial_tests():
    rows = [[0.9] * 6, [0.5] * 6, [0.4] * 6]
    found = analyse_measure(proportions(rows)).tendencies
    p = [stats.binomtest(successes, 60, 0.5).pvalue for successes in (54, 30, 24)]
    assert [own.binomial.p for own in found] == pytest.approx(p)
    assert [own.binomial.p_holm for own in found] == pytest.approx(holm(p))


@pytest.mark.parametrize("people", [0, 1, 2])
def test_nobody_and_few_participants_have_tests_without_p_or_none_below_the_bound(people):
    found = analyse_measure(proportions(np.full((people, 6), 0.9)))
    tests = [found.chance_by_ranks, found.chance_by_means, *found.factors[0].by_ranks, found.factors[0].omnibus]
    assert all(own.p is None or own.p >= 0.05 for own in tests)
    assert all(own.p is not None or own.note for own in tests)
    assert len(found.tendencies) == people
