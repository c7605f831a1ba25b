"""The tests of one measure: its distribution, against chance, between the levels of each factor, and of participants.

A participant is one observation: values of one participant belong together, as an opinion or a habit moves them all.
So each test takes one number of each participant, a mean over the cells that are not compared. The founding paper
seems to have taken each participant's value in each cell as an observation of its own, which finds differences that
are none where participants differ; such tests are made beside, under `cells`, so that the paper can be compared with.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from .answer_measures import CellKey, Level, Measure, level_label
from .hypothesis_tests import (
    StatisticalTest,
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

AGREEING_SHARE = 5 / 6
"""Of a participant's cells on one side of chance, from which on the founding paper calls the tendency strong."""
FOR, AGAINST, AMBIGUOUS = "for", "against", "ambiguous"


@dataclass(frozen=True, kw_only=True)
class FactorTests:
    """What a measure says of one factor."""

    factor: str
    levels: tuple[Level, ...]
    is_crossed: bool
    """Whether each level stands with the same levels of all other factors."""
    omnibus: StatisticalTest | None
    """Whether any level differs, for three levels or more, over the cells that all of them share."""
    by_ranks: tuple[StatisticalTest, ...]
    """Of each pair of levels, one family for Holm's correction."""
    by_means: tuple[StatisticalTest, ...]
    """The same pairs by t-tests, a family of their own."""
    by_cells: tuple[StatisticalTest, ...]
    """The same pairs, each cell of a participant an observation: as in the founding paper."""


@dataclass(frozen=True, kw_only=True)
class ParticipantTendency:
    """Which way a participant answers."""

    code: str
    mean: float
    above: int
    """Cells at chance or above."""
    below: int
    """Cells at chance or below."""
    cells: int
    tendency: str
    """`for`, `against` or `ambiguous` by the founding paper's rule: 5 of 6 cells on one side of chance."""
    binomial: StatisticalTest
    """All answers against chance; the participants are one family for Holm's correction."""


@dataclass(frozen=True, kw_only=True)
class MeasureTests:
    """All tests of one measure; None where the measure has no chance level, or counts no answers."""

    measure: Measure
    normality: StatisticalTest
    """Of all cells of all participants, as in the founding paper."""
    chance_by_ranks: StatisticalTest | None
    chance_by_means: StatisticalTest | None
    chance_by_cells: StatisticalTest | None
    factors: tuple[FactorTests, ...]
    heterogeneity: StatisticalTest | None
    """Whether participants differ from each other more than by chance: p below 0.05 says so, not why."""
    tendencies: tuple[ParticipantTendency, ...]


def analyse_measure(measure: Measure) -> MeasureTests:
    """All tests of a measure. Values that lack leave a participant out where they are needed, which notes count."""
    values, chance, name = measure.by_participant(), measure.chance, measure.name
    against = f"{name} - {chance:g}" if chance is not None else ""
    return MeasureTests(
        measure=measure,
        normality=check_normality(measure.values.ravel(), name),
        chance_by_ranks=None if chance is None else compare_with_centre_by_ranks(values, chance, against),
        chance_by_means=None if chance is None else compare_with_centre_by_means(values, chance, against),
        chance_by_cells=None
        if chance is None
        else compare_with_centre_by_ranks(measure.values.ravel(), chance, against),
        factors=tuple(compare_levels(measure, factor) for factor in measure.factors),
        heterogeneity=None
        if measure.successes is None or measure.counts is None
        else compare_participants(measure.successes.sum(axis=1), measure.counts.sum(axis=1), name),
        tendencies=tuple(_tendencies(measure)),
    )


def compare_levels(measure: Measure, factor: str) -> FactorTests:
    """The tests between the levels of a factor: of each pair over the cells that are the same in all else."""
    levels = measure.factors[factor]
    means, cells = [], []
    for one, other in combinations(levels, 2):
        a, b = matched_values(measure, factor, one, other)
        compares = f"{level_label(factor, one)} - {level_label(factor, other)}"
        note = _unmatched_note(measure, factor, (one, other))
        means.append(_noted(compare_pairs_by_means(a.mean(axis=1), b.mean(axis=1), compares), note))
        cells.append(_noted(compare_pairs_by_ranks(a.ravel(), b.ravel(), compares), note))
    omnibus = None
    if len(levels) > 2:
        found = compare_levels_by_ranks(_level_means(measure, factor, levels), f"{measure.name} by {factor}")
        omnibus = _noted(found, _unmatched_note(measure, factor, levels))
    return FactorTests(
        factor=factor,
        levels=levels,
        is_crossed=len({frozenset(measure.cells_at(factor, level)) for level in levels}) == 1,
        omnibus=omnibus,
        by_ranks=compare_pairs(measure, factor),
        by_means=correct_family(means),
        by_cells=correct_family(cells),
    )


def compare_pairs(measure: Measure, factor: str) -> tuple[StatisticalTest, ...]:
    """Wilcoxon's test of each pair of levels, of participants' means over matched cells; one family for Holm."""
    tests = []
    for pair in combinations(measure.factors[factor], 2):
        a, b = (own.mean(axis=1) for own in matched_values(measure, factor, *pair))
        test = compare_pairs_by_ranks(a, b, " - ".join(level_label(factor, own) for own in pair))
        tests.append(_noted(test, _unmatched_note(measure, factor, pair)))
    return correct_family(tests)


def _shared_keys(measure: Measure, factor: str, levels: Sequence[Level]) -> list[CellKey]:
    """The levels of all other factors with which every one of these levels stands."""
    first, *others = (measure.cells_at(factor, level) for level in levels)
    return [key for key in first if all(key in own for own in others)]


def _unmatched_note(measure: Measure, factor: str, levels: Sequence[Level]) -> str:
    """What a test of levels that the design pairs nowhere must say; empty where it pairs them."""
    if _shared_keys(measure, factor, levels):
        return ""
    return "the levels share no cells: means over different cells are compared, which other factors may move"


def _noted(test: StatisticalTest, note: str) -> StatisticalTest:
    return replace(test, note="; ".join(filter(None, (test.note, note))))


def _level_means(measure: Measure, factor: str, levels: Sequence[Level]) -> np.ndarray:
    """Means over the cells that all levels share, or over all of each where they share none: [participant, level]."""
    shared = _shared_keys(measure, factor, levels)
    if not shared:
        return np.stack([measure.at_level(factor, level) for level in levels], axis=1)
    found = [measure.cells_at(factor, level) for level in levels]
    means = [[measure.values[:, own[key]].mean(axis=1) for key in shared] for own in found]
    return np.mean(means, axis=1).T


def matched_values(measure: Measure, factor: str, one: Level, other: Level) -> tuple[np.ndarray, np.ndarray]:
    """Values at two levels in cells that are the same in all other factors, each of shape [participant, cell].

    Cells that are the same in all factors are averaged. Where the design pairs no cells, each level's mean over all of
    its cells is one cell.
    """
    a, b = measure.cells_at(factor, one), measure.cells_at(factor, other)
    same = _shared_keys(measure, factor, (one, other))
    if not same:
        return measure.at_level(factor, one)[:, None], measure.at_level(factor, other)[:, None]
    one_values, other_values = (
        np.stack([measure.values[:, own[key]].mean(axis=1) for key in same], axis=1) for own in (a, b)
    )
    return one_values, other_values


def _tendencies(measure: Measure) -> Iterator[ParticipantTendency]:
    successes, counts, chance = measure.successes, measure.counts, measure.chance
    if successes is None or counts is None or chance is None:
        return
    tests = correct_family(
        [
            compare_with_chance(int(own.sum()), int(count.sum()), chance, f"{code} - {chance:g}")
            for code, own, count in zip(measure.codes, successes, counts, strict=True)
        ]
    )
    for code, values, test in zip(measure.codes, measure.values, tests, strict=True):
        found = values[np.isfinite(values)]
        above, below = int((found >= chance).sum()), int((found <= chance).sum())
        least = AGREEING_SHARE * len(found)
        is_for, is_against = len(found) > 0 and above >= least, len(found) > 0 and below >= least
        yield ParticipantTendency(
            code=code,
            mean=float(found.mean()) if len(found) else float("nan"),
            above=above,
            below=below,
            cells=len(found),
            tendency=AMBIGUOUS if is_for == is_against else FOR if is_for else AGAINST,
            binomial=test,
        )
