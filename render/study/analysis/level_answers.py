"""Answers by level, of constant stimuli and staircases: what psychometric functions are fitted to."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..plan.staircase import Staircase
from ..plan.study_plan import PlannedBlock
from .answer_measures import counted
from .study_table import AnswerRecord, StudyTable

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
    """Of a staircase: moves that would have gone beyond its levels."""
    reason: str = ""

    @property
    def reversal_mean(self) -> float | None:
        """The mean over the tracks of the mean value at reversals, an even number of them (Levitt 1971)."""
        means = [float(np.mean(own)) for own in self.reversals if own]
        return float(np.mean(means)) if means else None


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
    right, text = block.correct_option, "correct answers"
    if block.design == "constant":
        right, text = len(block.question.options) - 1, f"answers {block.question.options[-1]!r}"
        if has_standard:
            text = "answers for the comparison"
    elif right is not None:
        text = f"answers {block.question.options[right]!r}"
    successes = [own.value == (right if own.comparison is None else own.comparison) for own in answers]
    reason = ""
    lacking = sorted({own for own in names if values[own] is None})
    if lacking:
        reason = f"the plan gives no `value` to {', '.join(lacking)}"
    elif block.design == "constant" and not has_standard and len(block.question.options) != 2:
        reason = f"{len(block.question.options)} options are no yes and no"
    given = np.array([] if reason else [values[own] for own in names], dtype=np.float64)
    x, at = np.unique(given, return_inverse=True)
    tracks: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    if block.design == "staircase" and not reason:
        for own, is_correct in zip(answers, successes, strict=True):
            tracks[own.track].append((own.level or 0, is_correct))
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
        reversals=tuple(tuple(of_level[own] for own in _reversal_levels(block, track)) for track in tracks.values()),
        track_levels=tuple(tuple(of_level[level] for level, _ in track) for track in tracks.values()),
        clipped=sum({own.track: own.clipped for own in answers}.values()),
        reason=reason,
    )


def _reversal_levels(block: PlannedBlock, answers: Sequence[tuple[int, bool]]) -> list[int]:
    """Levels at which a track turned, without those of its larger first steps, and an even number of them.

    answers: level, and whether it was correct, of each trial of the track.
    """
    track, turns = Staircase(block), list[int]()
    for level, is_correct in answers:
        before = track.reversals
        track.take(is_correct)
        if track.reversals > before:
            turns.append(level)
    settled = turns[len(block.steps) - 1 :]
    return settled[len(settled) % 2 :]
