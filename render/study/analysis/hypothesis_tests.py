"""Statistical tests of a study's measures, by SciPy and statsmodels, with the conventions of R.

Values come as arrays with one value for each participant. A missing value is nan: its pair is left out, and the note
of the test counts such pairs. p is None where a test says nothing, and the note says why. All p are two-sided.
"""

import gc
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from ...errors import StudyError


@dataclass(frozen=True, kw_only=True)
class StatisticalTest:
    """One test. p is None where the test says nothing, and `note` says why."""

    test: str
    """"Wilcoxon signed-rank test", "Shapiro-Wilk test"."""
    compares: str
    """What with what: "cube - tube", "p_cc - 0.5"."""
    n: int
    """Values, or pairs, that there were."""
    zeros: int = 0
    """Of them, those that a test by ranks leaves out because they are 0."""
    statistic: str = ""
    """Its symbol: "V", "W", "t", "chi2"."""
    value: float | None = None
    freedom: float | None = None
    """Degrees of freedom."""
    p: float | None = None
    """Two-sided, not corrected."""
    p_holm: float | None = None
    """Corrected for the tests of its family by Holm's method; None where it has no family."""
    effect: str = ""
    """Its name: "rank-biserial r", "Cohen's d_z"."""
    effect_size: float | None = None
    difference: float | None = None
    """Mean or median difference, in the measure's unit."""
    difference_low: float | None = None
    difference_high: float | None = None
    """95 % interval of it."""
    note: str = ""
    """Ties, zeros, a normal approximation; or why there is no p."""

    @property
    def p_final(self) -> float | None:
        """The p that counts: the corrected one, if there is one."""
        return self.p if self.p_holm is None else self.p_holm


ALIKE = 1e-10
"""Values whose distance is below this share of their size differ only by rounding, and count as ties."""
SIGNIFICANT = 0.05
"""Below it p speaks for a difference."""
CONFIDENCE = 0.95
"""Of every interval."""
EXACT_BELOW = 50
"""Differences from which on Wilcoxon's test uses a normal approximation, as wilcox.test of R does."""
SHAPIRO_LEAST, SHAPIRO_MOST = 3, 5000
"""Values that the coefficients of Shapiro and Wilk's test are known for."""
RANKS_LEAST = 6
"""Differences that Wilcoxon's test needs for p below 0.05: 2 of the 2^n patterns of signs are the most extreme."""
FEW_VALUES = "Sample size too small for normal approximation"
"""The warning of SciPy 1.13 about fewer than 10 values: it is withheld, as the test's note says more."""
EXPECTED_LEAST = 5.0
"""Expected count of each cell that the chi-square approximation asks for."""


class ProportionInterval(NamedTuple):
    """Clopper and Pearson's 95 % interval of a proportion, as binom.test of R gives it."""

    low: float
    high: float


class _Differences(NamedTuple):
    """What is left of pairs without those that lack a value."""

    values: np.ndarray
    """float64, shape [pair]: a - b; exactly 0 where a and b differ only by rounding."""
    tolerance: float
    """Differences that are closer to each other are ties."""
    notes: list[str]


def check_normality(values: np.ndarray, compares: str) -> StatisticalTest:
    """Shapiro and Wilk's test: a small p says that the values don't come from a normal distribution."""
    from scipy import stats  # 0.5 s that only analyses cost

    given = _as_floats(values, "values")
    found = given[np.isfinite(given)]
    notes = _count_notes(len(given) - len(found), "missing value", "left out")
    result = StatisticalTest(test="Shapiro-Wilk test", compares=compares, n=len(found), statistic="W")
    if len(found) < SHAPIRO_LEAST:
        return _without_p(result, f"the test needs {SHAPIRO_LEAST} values, and has {len(found)}", notes)
    if len(found) > SHAPIRO_MOST:
        return _without_p(result, f"the test is known for {SHAPIRO_MOST} values at most, not {len(found)}", notes)
    if np.ptp(found) <= ALIKE * np.abs(found).max():
        return _without_p(result, "all values are alike", notes)
    statistic, p = stats.shapiro(found)
    return replace(result, value=float(statistic), p=float(p), note="; ".join(notes))


def compare_with_centre_by_ranks(values: np.ndarray, centre: float, compares: str) -> StatisticalTest:
    """Wilcoxon's signed-rank test of one sample: whether values lie symmetrically around a centre.

    The difference is the pseudo-median of values - centre.
    """
    return _compare_by_ranks(_subtract(values, centre), compares)


def compare_pairs_by_ranks(a: np.ndarray, b: np.ndarray, compares: str) -> StatisticalTest:
    """Wilcoxon's signed-rank test of pairs: whether a - b lies symmetrically around 0.

    The difference is the pseudo-median of a - b.
    """
    return _compare_by_ranks(_subtract(a, b), compares)


def compare_with_centre_by_means(values: np.ndarray, centre: float, compares: str) -> StatisticalTest:
    """Student's t-test of one sample: whether the mean of values is a centre. The difference is mean - centre."""
    return _compare_by_means(_subtract(values, centre), compares, "one-sample t-test", "Cohen's d")


def compare_pairs_by_means(a: np.ndarray, b: np.ndarray, compares: str) -> StatisticalTest:
    """Student's t-test of pairs: whether the mean of a - b is 0. The difference is that mean."""
    return _compare_by_means(_subtract(a, b), compares, "paired t-test", "Cohen's d_z")


def compare_levels_by_ranks(matrix: np.ndarray, compares: str) -> StatisticalTest:
    """Friedman's test of three or more levels: whether participants rank the levels in similar orders.

    matrix: shape [participant, level]. A participant who lacks a value is left out. Kendall's W is the effect size: 0
    where participants agree on no order, 1 where all have the same.
    """
    from scipy import stats

    given = _as_floats(matrix, "matrix", dimensions=2)
    count = given.shape[1]
    if count < 3:
        raise StudyError(f"matrix must have 3 or more levels as columns, not {count}: compare two as pairs")
    rows = given[np.isfinite(given).all(axis=1)]
    notes = _count_notes(len(given) - len(rows), "participant", "with a missing value left out")
    result = StatisticalTest(
        test="Friedman test", compares=compares, n=len(rows), statistic="chi2", effect="Kendall's W"
    )
    if len(rows) < 2:
        return _without_p(result, f"the test needs 2 participants, and has {len(rows)}", notes)
    joined = np.array([join_ties(row, ALIKE * np.abs(row).max()) for row in rows])
    if not np.ptp(joined, axis=1).any():
        return _without_p(result, "each participant has the same value at all levels", notes)
    value, p = map(float, stats.friedmanchisquare(*joined.T))
    tied = sum(len(np.unique(row)) < count for row in joined)
    notes += _count_notes(tied, "participant", "with ties")
    return replace(
        result,
        value=value,
        freedom=count - 1,
        p=p,
        effect_size=value / (len(rows) * (count - 1)),
        note="; ".join([*notes, "chi-square approximation"]),
    )


def correct_family(tests: Sequence[StatisticalTest]) -> tuple[StatisticalTest, ...]:
    """The tests with `p_holm`: corrected by Holm's method for the number of those that have a p.

    A test alone is no family, and stays as it is.
    """
    from statsmodels.stats.multitest import multipletests

    places = [place for place, test in enumerate(tests) if test.p is not None]
    if len(places) < 2:
        return tuple(tests)
    gc.freeze()  # multipletests collects garbage at each call, which takes 0.3 s where many objects live
    try:
        corrected = multipletests([tests[place].p for place in places], method="holm")[1]
    finally:
        gc.unfreeze()
    found = {place: float(own) for place, own in zip(places, corrected, strict=True)}
    return tuple(replace(test, p_holm=found.get(place)) for place, test in enumerate(tests))


def compare_participants(successes: np.ndarray, counts: np.ndarray, compares: str) -> StatisticalTest:
    """Chi-square test of homogeneity: whether participants differ more than answers of one probability do.

    successes, counts: shape [participant], of how many answers so many were of one kind. A small p speaks for
    subgroups, or for participants with their own bias.
    """
    from scipy import stats

    successes, counts = _as_counts(successes, counts)
    asked = counts > 0
    notes = _count_notes(int((~asked).sum()), "participant", "without answers left out")
    table = np.array([successes[asked], counts[asked] - successes[asked]])
    result = StatisticalTest(
        test="chi-square test of homogeneity",
        compares=compares,
        n=table.shape[1],
        statistic="chi2",
        effect="Cramér's V",
    )
    if result.n < 2:
        return _without_p(result, f"the test needs 2 participants, and has {result.n}", notes)
    if not table.sum(axis=1).all():
        return _without_p(result, "all answers are alike", notes)
    value, p, freedom, expected = map(np.asarray, stats.chi2_contingency(table))
    few = int((expected < EXPECTED_LEAST).sum())
    if few:
        notes.append(f"{few} of {expected.size} expected counts are below 5: the chi-square approximation is poor")
    if freedom == 1:
        notes.append("with Yates's continuity correction")
    return replace(
        result,
        value=float(value),
        freedom=float(freedom),
        p=float(p),
        effect_size=float(np.sqrt(value / table.sum())),
        note="; ".join(notes),
    )


def compare_with_chance(successes: int, count: int, chance: float, compares: str) -> StatisticalTest:
    """The exact binomial test: whether a proportion of independent answers is that of chance.

    The difference is proportion - chance. Answers of several participants are not independent where these differ.
    """
    from scipy import stats

    if not 0.0 <= chance <= 1.0:
        raise StudyError(f"chance must lie in 0..1, not {chance}")
    low, high = bound_proportion(successes, count)
    result = StatisticalTest(
        test="exact binomial test", compares=compares, n=int(count), statistic="successes", effect="Cohen's h"
    )
    if count == 0:
        return _without_p(result, "there are no answers", [])
    proportion = successes / count
    return replace(
        result,
        value=float(successes),
        p=float(stats.binomtest(int(successes), int(count), chance).pvalue),
        effect_size=float(2.0 * (np.arcsin(np.sqrt(proportion)) - np.arcsin(np.sqrt(chance)))),
        difference=proportion - chance,
        difference_low=low - chance,
        difference_high=high - chance,
    )


def bound_proportion(successes: int, count: int) -> ProportionInterval:
    """Clopper and Pearson's 95 % interval of a proportion; 0..1 where there are no answers."""
    from statsmodels.stats.proportion import proportion_confint

    _as_counts(np.array([successes]), np.array([count]))
    if count == 0:
        return ProportionInterval(0.0, 1.0)
    low, high = proportion_confint(successes, count, alpha=1.0 - CONFIDENCE, method="beta")
    return ProportionInterval(float(low), float(high))


def join_ties(values: np.ndarray, tolerance: float) -> np.ndarray:
    """The values, where each that is within a tolerance of the next smaller one equals it."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    begins = np.diff(ordered, prepend=-np.inf) > tolerance
    joined = np.empty_like(values)
    joined[order] = ordered[begins][np.cumsum(begins) - 1]
    return joined


def _compare_by_ranks(pairs: _Differences, compares: str) -> StatisticalTest:
    """Wilcoxon's test of differences, with the pseudo-median and its interval: zeros are dropped from all of them."""
    from scipy import stats

    notes = list(pairs.notes)
    result = StatisticalTest(
        test="Wilcoxon signed-rank test",
        compares=compares,
        n=len(pairs.values),
        statistic="V",
        effect="rank-biserial r",
    )
    found = pairs.values[pairs.values != 0.0]
    count = len(found)
    zeros = result.n - count
    notes += _count_notes(zeros, "zero", "left out")
    if count == 0:
        return _without_p(result, "all differences are zero" if zeros else "there are no pairs", pairs.notes)
    sizes = join_ties(np.abs(found), pairs.tolerance)
    ranks = stats.rankdata(sizes)
    value = float(ranks[found > 0.0].sum())
    most = count * (count + 1) / 2
    groups = np.unique(sizes, return_counts=True)[1]
    tied = int(groups[groups > 1].sum())
    is_exact = count < EXACT_BELOW and not tied and not zeros
    if count < RANKS_LEAST:  # ties or not: a normal approximation would call 5 equal differences significant
        sums = np.array([np.dot(ranks, signs) for signs in product((0.0, 1.0), repeat=count)])
        p = min(1.0, 2.0 * float(np.mean(sums <= min(value, most - value) + ALIKE)))
    else:
        method = "exact" if is_exact else "approx"
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", FEW_VALUES, UserWarning)
            p = float(stats.wilcoxon(np.sign(found) * sizes, correction=True, method=method)[1])
    if not is_exact:
        notes += _count_notes(tied, "difference", "tied in size")
        notes += ["normal approximation with continuity correction"] * (count >= RANKS_LEAST)
    if count < RANKS_LEAST:
        notes.append(f"with fewer than {RANKS_LEAST} differences no exact p is below 0.05: there is no 95 % interval")
    low, centre, high = _pseudo_median(join_ties(found, pairs.tolerance), is_exact=is_exact)
    return replace(
        result,
        zeros=zeros,
        value=value,
        p=p,
        effect_size=2.0 * value / most - 1.0,
        difference=centre,
        difference_low=low,
        difference_high=high,
        note="; ".join(notes),
    )


def _compare_by_means(pairs: _Differences, compares: str, test: str, effect: str) -> StatisticalTest:
    """Student's t-test of differences against 0, with the mean and its interval."""
    from scipy import stats

    found = pairs.values
    count = len(found)
    result = StatisticalTest(test=test, compares=compares, n=count, statistic="t", effect=effect)
    if count < 2:
        return _without_p(result, f"the test needs 2 differences, and has {count}", pairs.notes)
    if np.ptp(found) <= pairs.tolerance:
        reason = "all differences are alike" if found.any() else "all differences are zero"
        return _without_p(result, reason, pairs.notes)
    mean, deviation = float(found.mean()), float(found.std(ddof=1))
    error = deviation / np.sqrt(count)
    value = mean / error
    reach = float(stats.t.ppf((1.0 + CONFIDENCE) / 2.0, count - 1)) * error
    return replace(
        result,
        value=float(value),
        freedom=count - 1,
        p=float(2.0 * stats.t.sf(abs(value), count - 1)),
        effect_size=mean / deviation,
        difference=mean,
        difference_low=float(mean - reach),
        difference_high=float(mean + reach),
        note="; ".join(pairs.notes),
    )


@cache
def _signed_rank_distribution(count: int) -> np.ndarray:
    """P(V <= v) of Wilcoxon's statistic of `count` differences without ties, float64, shape [v]."""
    ways = np.zeros(count * (count + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, count + 1):  # each rank is in the sum, or is not; all counts stay below 2^53, thus exact
        ways[rank:] += ways[:-rank].copy()
    return np.cumsum(ways) / 2.0**count


def _pseudo_median(found: np.ndarray, *, is_exact: bool) -> tuple[float | None, float, float | None]:
    """Hodges and Lehmann's estimate, between the bounds of its 95 % interval; None: too few differences for bounds.

    The estimate is the median of the Walsh averages: means of all pairs of differences, each with itself included. The
    bounds are those Walsh averages beyond which Wilcoxon's test would refuse a shift.
    """
    from scipy import stats

    count = len(found)
    first, second = np.triu_indices(count)
    averages = np.sort((found[first] + found[second]) / 2.0)
    tail = (1.0 - CONFIDENCE) / 2.0
    if is_exact:
        place = int(np.searchsorted(_signed_rank_distribution(count), tail))
    else:
        # A shift makes ties only of equal differences, so the deviation counts those, and not ties of their sizes.
        groups = np.unique(found, return_counts=True)[1].astype(float)
        variance = count * (count + 1) * (2 * count + 1) / 24 - (groups**3 - groups).sum() / 48
        reach = float(stats.norm.isf(tail) * np.sqrt(variance))
        place = int(np.floor(len(averages) / 2 - reach - 0.5)) + 1
    centre = float(np.median(averages))
    if place < 1 or count < RANKS_LEAST:
        return None, centre, None
    return float(averages[place - 1]), centre, float(averages[len(averages) - place])


def _subtract(a: np.ndarray, b: np.ndarray | float) -> _Differences:
    """a - b of pairs that have both; b may be one number for all."""
    one = _as_floats(a, "a")
    if np.ndim(b) == 0:
        if not np.isfinite(b):
            raise StudyError(f"centre must be a finite number, not {b}")
        other = np.full_like(one, float(b))
        missing = "missing value"
    else:
        other = _as_floats(np.asarray(b), "b")
        missing = "pair"
    if one.shape != other.shape:
        raise StudyError(f"a and b must have a value of each participant: {len(one)} and {len(other)} values")
    both = np.isfinite(one) & np.isfinite(other)
    one, other = one[both], other[both]
    ending = "with a missing value left out" if missing == "pair" else "left out"
    notes = _count_notes(int((~both).sum()), missing, ending)
    tolerance = ALIKE * max(np.abs(one).max(initial=0.0), np.abs(other).max(initial=0.0))
    values = one - other
    values[np.abs(values) <= tolerance] = 0.0
    return _Differences(values, float(tolerance), notes)


def _as_floats(values: np.ndarray, field: str, *, dimensions: int = 1) -> np.ndarray:
    """The values as float64; each is a number or nan."""
    found = np.asarray(values, dtype=float)
    if found.ndim != dimensions:
        raise StudyError(f"{field} must have {dimensions} dimension{'s' * (dimensions > 1)}, not {found.ndim}")
    if np.isinf(found).any():
        raise StudyError(f"{field} must hold finite numbers, or nan where one is missing, not inf")
    return found


def _as_counts(successes: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both as arrays of one shape, where each count has between 0 and all successes."""
    successes, counts = np.asarray(successes), np.asarray(counts)
    if successes.shape != counts.shape or successes.ndim != 1:
        raise StudyError(
            f"successes and counts must have one value for each participant, not shapes {successes.shape} "
            f"and {counts.shape}"
        )
    for own, count in zip(successes.tolist(), counts.tolist(), strict=True):
        if own != int(own) or count != int(count) or not 0 <= own <= count:
            raise StudyError(f"successes must be whole numbers in 0..count, not {own} of {count}")
    return successes.astype(np.int64), counts.astype(np.int64)


def _count_notes(count: int, noun: str, ending: str) -> list[str]:
    """A note that counts what was found; none where nothing was."""
    return [f"{count} {noun}{'s' * (count > 1)} {ending}"] if count else []


def _without_p(result: StatisticalTest, reason: str, notes: list[str]) -> StatisticalTest:
    return replace(result, note="; ".join([f"no test: {reason}", *notes]))
