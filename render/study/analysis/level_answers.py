"""Answers by level, of constant stimuli and staircases: what psychometric functions are fitted to."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..plan.block_designs import Staircase
from ..plan.study_plan import PlannedBlock
from .answer_measures import Cell, Measure, block_factors, counted
from .answer_reading import AnswerRecord, StudyTable

FITTED_DESIGNS = ("constant", "staircase")


@dataclass(frozen=True, kw_only=True)
class LevelAnswers:
    """One participant's answers in one block; `reason` says why there are no levels to fit to, else it is empty."""

    code: str
    block: PlannedBlock
    x: np.ndarray
    """Values of the stimuli on the plan's scale, rising, float64."""
    successes: np.ndarray
    """int64: answers that chose the comparison, or the last option, or were correct."""
    counts: np.ndarray
    """int64: all answers."""
    guess: float
    """Share of successes where nothing is felt: 1 / intervals of a staircase, else 0."""
    lapses_both_ways: bool
    """Whether a lapse may be a success, as a comparison with a standard has two answers that are alike."""
    counted: str
    """What a success is."""
    reversals: tuple[tuple[float, ...], ...] = ()
    """Of a staircase: values at the reversals of each track, those of its larger first steps left out."""
    track_levels: tuple[tuple[float, ...], ...] = ()
    """Of a staircase: values of each track's trials, in their order."""
    clipped: int = 0
    """Of a staircase: moves of all tracks that would have gone beyond its levels."""
    reason: str = ""

    @property
    def reversal_mean(self) -> float | None:
        """The mean over the tracks of the mean value at reversals, an even number of them (Levitt 1971)."""
        means = [float(np.mean(own)) for own in self.reversals if own]
        return float(np.mean(means)) if means else None


class ReplayedTrack(NamedTuple):
    """One track of a staircase, after the answers that were given."""

    state: Staircase
    levels: list[int]
    """Of each trial."""
    turns: list[int]
    """Levels of the trials whose answer made a reversal."""


def replay_tracks(block: PlannedBlock, answers: Sequence[AnswerRecord]) -> list[ReplayedTrack]:
    """The tracks of a staircase block, in the order of their numbers; answers: one participant's to its trials."""
    tracks: dict[int, ReplayedTrack] = {}
    for own in answers:
        track = tracks.setdefault(own.track, ReplayedTrack(Staircase(block), [], []))
        before, level = track.state.reversals, own.level or 0
        track.state.take(_is_success(block, own))
        track.levels.append(level)
        if track.state.reversals > before:
            track.turns.append(level)
    return [tracks[number] for number in sorted(tracks)]


def level_answers(table: StudyTable) -> list[LevelAnswers]:
    """Of each participant and each block with constant stimuli or a staircase; practice counts for nothing."""
    by_block: dict[tuple[str, str], list[AnswerRecord]] = defaultdict(list)
    for own in counted(table):
        if own.name == "answer":
            by_block[own.code, own.block].append(own)
    blocks = [own for own in table.plan.blocks if own.design in FITTED_DESIGNS]
    return [
        _of_block(table, code, block, by_block[code, block.name])
        for block in blocks
        for code in table.codes
        if (code, block.name) in by_block
    ]


def _of_block(table: StudyTable, code: str, block: PlannedBlock, answers: Sequence[AnswerRecord]) -> LevelAnswers:
    values = {own.name: own.value for own in table.plan.stimuli}
    names = [own.stimuli[own.comparison if own.comparison is not None else -1] for own in answers]
    has_standard = any(len(names) > 1 for names in block.sets)
    right, text = _right_option(block), "correct answers"
    if right is not None:
        text = f"answers {block.question.options[right]!r}"
    if block.design == "constant" and has_standard:
        text = "answers for the comparison"
    successes = [_is_success(block, own) for own in answers]
    reason = ""
    lacking = sorted({own for own in names if values[own] is None})
    if lacking:
        reason = f"the plan gives no `value` to {', '.join(lacking)}"
    elif block.design == "constant" and not has_standard and len(block.question.options) != 2:
        reason = f"{len(block.question.options)} options are no yes and no"
    given = np.array([] if reason else [values[own] for own in names], dtype=np.float64)
    x, at = np.unique(given, return_inverse=True)
    tracks = replay_tracks(block, answers) if block.design == "staircase" and not reason else []
    of_level = [float(values[names[-1]] or 0) for names in block.sets] if tracks else []
    return LevelAnswers(
        code=code,
        block=block,
        x=x,
        successes=np.bincount(at, np.array(successes, float) if len(at) else None, len(x)).astype(np.int64),
        counts=np.bincount(at, minlength=len(x)),
        guess=1 / len(block.sets[0]) if block.design == "staircase" and has_standard else 0.0,
        lapses_both_ways=block.design == "constant" and has_standard,
        counted=text,
        reversals=tuple(tuple(of_level[level] for level in _settled(block, track)) for track in tracks),
        track_levels=tuple(tuple(of_level[level] for level in track.levels) for track in tracks),
        clipped=sum(track.state.clipped for track in tracks),
        reason=reason,
    )


def _settled(block: PlannedBlock, track: ReplayedTrack) -> list[int]:
    """Levels at which a track turned, without those of its larger first steps, and an even number of them."""
    settled = track.turns[len(block.steps) - 1 :]
    return settled[len(settled) % 2 :]


def _right_option(block: PlannedBlock) -> int | None:
    """The option that counts as a success where there is no standard."""
    return len(block.question.options) - 1 if block.design == "constant" else block.correct_option


def _is_success(block: PlannedBlock, own: AnswerRecord) -> bool:
    return own.value == (_right_option(block) if own.comparison is None else own.comparison)


# ---- Magnitude estimates: geometric means, and the exponent of the power law of each participant (Stevens 1957)


@dataclass(frozen=True, kw_only=True)
class MagnitudeScale:
    """The estimates of one block."""

    block: PlannedBlock
    codes: tuple[str, ...]
    x: np.ndarray
    """Values of the stimuli on the plan's scale, float64, rising."""
    means: np.ndarray
    """Geometric mean of each participant's estimates, shape [participant, stimulus]; nan where there is none."""
    exponents: np.ndarray
    """Slope of log estimate over log value, by least squares, shape [participant]; nan where there is no line."""
    left_out: int
    """Estimates that have no logarithm: 0, or below."""
    reason: str = ""
    """Why there is no exponent at all."""


def magnitude_scales(table: StudyTable) -> list[MagnitudeScale]:
    """One for each block of the design `magnitude`."""
    return [_scale(table, block) for block in table.plan.blocks if block.design == "magnitude"]


def exponent_measures(scales: list[MagnitudeScale]) -> list[Measure]:
    """The exponents as a measure, with a cell for each block."""
    if not scales:
        return []
    return [
        Measure(
            name="exponent",
            title="exponent of the power law",
            codes=scales[0].codes,
            cells=tuple(Cell(own.block.name, block_factors(own.block)) for own in scales),
            values=np.stack([own.exponents for own in scales], axis=1),
        )
    ]


def _scale(table: StudyTable, block: PlannedBlock) -> MagnitudeScale:
    values = {own.name: own.value for own in table.plan.stimuli}
    logs: dict[tuple[str, float], list[float]] = defaultdict(list)
    lacking, left_out = set[str](), 0
    for own in counted(table):
        if own.block != block.name or own.name != "answer" or not isinstance(own.value, int | float):
            continue
        value = values[own.stimuli[-1]]  # behind the modulus, if there is one
        if value is None:
            lacking.add(own.stimuli[-1])
        elif own.value <= 0:
            left_out += 1
        else:
            logs[own.code, value].append(float(np.log10(own.value)))
    x = np.array(sorted({value for _, value in logs}), dtype=np.float64)
    means = np.array([[np.mean(logs.get((code, value), [np.nan])) for value in x] for code in table.codes])
    means = means.reshape(len(table.codes), len(x))
    reason = ""
    if lacking:
        reason = f"the plan gives no `value` to {', '.join(sorted(lacking))}"
    elif len(x) < 2:
        reason = f"estimates of {len(x)} value{'s' * (len(x) != 1)}; a line needs 2"
    elif x[0] <= 0:
        reason = f"values must be above 0 for a power law; the least is {x[0]:g}"
    exponents = np.full(len(table.codes), np.nan)
    if not reason:
        for number, own in enumerate(means):
            found = np.isfinite(own)
            if found.sum() > 1:
                exponents[number] = np.polynomial.polynomial.polyfit(np.log10(x[found]), own[found], 1)[1]
    return MagnitudeScale(
        block=block, codes=table.codes, x=x, means=10**means, exponents=exponents, left_out=left_out, reason=reason
    )
