"""A study's whole analysis as values: what the report shows, and what simulations ask."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..plan.study_plan import PlannedBlock
from .answer_measures import (
    Cell,
    Measure,
    QuestionAnswers,
    block_factors,
    choice_measures,
    open_answers,
    ratio_measures,
    scale_measures,
)
from .answer_reading import StudyTable
from .data_faults import data_faults
from .level_answers import LevelAnswers, MagnitudeScale, exponent_measures, level_answers, magnitude_scales
from .measure_tests import MeasureTests, analyse_measure
from .psychometric_fit import PsychometricFit, fit_psychometric


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
    """Of the fits: points of subjective equality and just noticeable differences, or thresholds."""
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
    """What was fitted, of each participant and block; a measure for each kind of question, as they mean other things.

    With a standard, constant stimuli give the point of subjective equality and the just noticeable difference; else
    they and staircases give thresholds.
    """
    kinds: dict[tuple[str, str, str], dict[str, PlannedBlock]] = {}
    for own in fits:
        block = own.answers.block
        named = [("threshold", "threshold", "mu")]
        if own.answers.lapses_both_ways:
            named = [("pse", "point of subjective equality", "mu"), ("jnd", "just noticeable difference", "jnd")]
        elif block.design == "staircase":
            named = [("threshold_staircase", "threshold by staircase", "mu")]
            if not own.answers.guess:  # of single intervals, where people differ in when they say yes
                named = [("threshold_staircase_yes", "threshold by staircase of yes and no", "mu")]
        for kind in named:
            kinds.setdefault(kind, {})[block.name] = block
    places = {(own.answers.code, own.answers.block.name): own for own in fits}
    measures = []
    for (name, title, of), blocks in kinds.items():
        found = [[_value(places.get((code, own)), of) for own in blocks] for code in table.codes]
        cells = tuple(Cell(own.name, block_factors(own)) for own in blocks.values())
        values = np.array(found, dtype=np.float64).reshape(len(table.codes), len(blocks))
        measures.append(Measure(name=name, title=title, codes=table.codes, cells=cells, values=values))
    return measures


def _value(own: FittedLevels | None, of: str) -> float:
    """A fitted value; nan where the threshold does not lie between the levels that were asked."""
    if own is None or own.fit is None or own.fit.mu.value is None:
        return np.nan
    x, value = own.answers.x, getattr(own.fit, of).value
    return value if value is not None and x[0] <= own.fit.mu.value <= x[-1] else np.nan
