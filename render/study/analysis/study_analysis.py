"""A study's whole analysis as values: what the report shows, and what simulations ask."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .answer_measures import block_factors, choice_measures, ratio_measures, scale_measures
from .data_faults import data_faults
from .level_answers import LevelAnswers, level_answers
from .magnitude_scales import MagnitudeScale, exponent_measures, magnitude_scales
from .measure_tests import MeasureTests, analyse_measure
from .measures import Cell, Measure
from .open_answers import QuestionAnswers, open_answers
from .psychometric_fit import PsychometricFit, fit_psychometric
from .study_table import StudyTable


@dataclass(frozen=True, kw_only=True)
class FittedLevels:
    """One participant's answers in one block, and the function that was fitted to them."""

    answers: LevelAnswers
    fit: PsychometricFit | None
    """None: there is nothing to fit to; `answers.reason` says why."""


@dataclass(frozen=True, kw_only=True)
class StudyAnalysis:
    """What an analysis finds."""

    table: StudyTable
    faults: tuple[str, ...]
    """What is odd about the data."""
    choices: tuple[MeasureTests, ...]
    ratios: tuple[MeasureTests, ...]
    scales: tuple[MeasureTests, ...]
    fits: tuple[FittedLevels, ...]
    thresholds: tuple[MeasureTests, ...]
    """Of the fits: the threshold, and how steep they are."""
    magnitudes: tuple[MagnitudeScale, ...]
    exponents: tuple[MeasureTests, ...]
    open: tuple[QuestionAnswers, ...]

    @property
    def tests(self) -> tuple[MeasureTests, ...]:
        """Of all measures."""
        return (*self.choices, *self.ratios, *self.scales, *self.thresholds, *self.exponents)


def analyse_answers(table: StudyTable) -> StudyAnalysis:
    """All measures of a study, with their tests and fits."""
    fits = [FittedLevels(answers=own, fit=_fit(own)) for own in level_answers(table)]
    magnitudes = magnitude_scales(table)
    return StudyAnalysis(
        table=table,
        faults=tuple(data_faults(table)),
        choices=_tested(choice_measures(table)),
        ratios=_tested(ratio_measures(table)),
        scales=_tested(scale_measures(table)),
        fits=tuple(fits),
        thresholds=_tested(_threshold_measures(table, fits)),
        magnitudes=tuple(magnitudes),
        exponents=_tested(exponent_measures(magnitudes)),
        open=tuple(open_answers(table)),
    )


def _tested(measures: Sequence[Measure]) -> tuple[MeasureTests, ...]:
    return tuple(analyse_measure(own) for own in measures)


def _fit(own: LevelAnswers) -> PsychometricFit | None:
    if own.reason:
        return None
    return fit_psychometric(own.x, own.successes, own.counts, guess=own.guess, ties_lapse_to_guess=own.lapses_both_ways)


def _threshold_measures(table: StudyTable, fits: Sequence[FittedLevels]) -> list[Measure]:
    """Threshold and just noticeable difference of each participant and block, where the fit gives them.

    Blocks whose functions count other answers are other measures: a point of subjective equality is no threshold of
    detection.
    """
    kinds = list(dict.fromkeys(own.answers.counted for own in fits))
    measures = []
    for number, kind in enumerate(kinds, 1):
        found = _measures_of_fits(table, [own for own in fits if own.answers.counted == kind])
        if len(kinds) > 1:
            found = [replace(own, name=f"{own.name}_{number}", title=f"{own.title} of {kind}") for own in found]
        measures += found
    return measures


def _measures_of_fits(table: StudyTable, fits: Sequence[FittedLevels]) -> list[Measure]:
    """Of functions that count the same answers."""
    blocks = list({own.answers.block.name: own.answers.block for own in fits}.values())
    places = {(own.answers.code, own.answers.block.name): own.fit for own in fits}
    cells = tuple(Cell(own.name, block_factors(own)) for own in blocks)

    def values(of: str) -> np.ndarray:
        found = [[_value(places.get((code, own.name)), of) for own in blocks] for code in table.codes]
        return np.array(found, dtype=np.float64).reshape(len(table.codes), len(blocks))

    titles = {"mu": ("threshold", "threshold"), "jnd": ("jnd", "just noticeable difference")}
    return [
        Measure(name=name, title=title, codes=table.codes, cells=cells, values=values(of))
        for of, (name, title) in titles.items()
    ]


def _value(fit: PsychometricFit | None, of: str) -> float:
    value = None if fit is None else getattr(fit, of).value
    return np.nan if value is None else value
