"""The order of a participant's blocks, and the trials of each design: functions of seed, participant and answers."""

from collections.abc import Generator, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .latin_square import balanced_square
from .staircase import Staircase
from .study_plan import Answer, PlannedBlock, PlannedTrial, Question, StudyPlan


class TrialCounts(NamedTuple):
    """Numbers of trials of a block; `least` and `most` are without practice, and differ for staircases only."""

    practice: int
    least: int
    most: int


class Condition(NamedTuple):
    """What a trial plays."""

    stimuli: tuple[str, ...]
    """In the order of the intervals."""
    comparison: int | None = None
    """The interval of the stimulus that is not the standard, where there is one."""


def key_order(question: Question, rng: np.random.Generator) -> tuple[int, ...]:
    """Number of the option that each key of a choice gives, drawn at random; empty: as they are listed."""
    return tuple(rng.permutation(len(question.options)).tolist()) if question.has_random_keys else ()


def rng_of(plan: StudyPlan, participant: int, block_number: int) -> np.random.Generator:
    """Random numbers of one participant's block, both numbered from 0; a block by its place in `plan.blocks`."""
    return np.random.default_rng([plan.seed, participant, block_number])


def block_numbers(plan: StudyPlan, participant: int) -> tuple[int, ...]:
    """The order of a participant's blocks, each by its place in `plan.blocks`.

    latin: row `participant`, modulo the number of rows, of the balanced square; random: by the plan's seed; fixed: as
    the plan lists them.
    """
    count = len(plan.blocks)
    if plan.block_order == "latin":
        square = balanced_square(count)
        return tuple(square[participant % len(square)].tolist())
    if plan.block_order == "random":
        # Block number `count` is no block's. None at all would give block 0's: NumPy pads short seeds with zeros.
        return tuple(rng_of(plan, participant, count).permutation(count).tolist())
    return tuple(range(count))


def trial_counts(block: PlannedBlock) -> TrialCounts:
    """Numbers of trials that a block has."""
    if block.design != "staircase":
        count = len(_conditions(block)) * block.repetitions
        return TrialCounts(block.practice, count, count)
    # R reversals need R + 1 moves in turns; fewest trials where the first is a step easier, after one wrong answer.
    moves = block.reversals + 1
    least = min((moves + 1) // 2 + moves // 2 * block.down, block.trials_max)
    return TrialCounts(block.practice, least * block.tracks, block.trials_max * block.tracks)


def trials_of(block: PlannedBlock, rng: np.random.Generator) -> Generator[PlannedTrial, Mapping[str, Answer], None]:
    """Yield a block's trials one after the other, each after it was sent the answers {question's name: answer} before.

    Practice comes first. Equal random numbers and answers give equal trials, so a resumed run sends the stored answers
    and goes on with the trial that was under way.
    """
    for condition in _practice(block, rng):
        yield _trial(block, rng, condition, is_practice=True)
    if block.design == "staircase":
        yield from _staircase_trials(block, rng)
        return
    conditions = _conditions(block) * block.repetitions
    order = rng.permutation(len(conditions)) if block.trial_order == "random" else range(len(conditions))
    for number in order:
        yield _trial(block, rng, conditions[number])


def _conditions(block: PlannedBlock) -> list[Condition]:
    """What each trial that differs from the others plays; not of a staircase."""
    if block.design == "magnitude" and block.modulus is not None:
        return [Condition((block.modulus[0], *own)) for own in block.sets]
    if block.design == "2ifc":
        return [Condition(order) for own in block.sets for order in (own, own[::-1])]
    if block.design == "constant":
        pairs = [own for own in block.sets if len(own) > 1]
        alone = [Condition(own) for own in block.sets if len(own) == 1]
        return alone + [own for pair in pairs for own in (Condition(pair, 1), Condition(pair[::-1], 0))]
    return [Condition(own) for own in block.sets]


def _practice(block: PlannedBlock, rng: np.random.Generator) -> Iterator[Condition]:
    """What each practice trial plays: all conditions before any comes again; of a staircase, from the easiest."""
    is_staircase = block.design == "staircase"
    conditions = [Condition(own) for own in block.sets] if is_staircase else _conditions(block)
    for first in range(0, block.practice, len(conditions)):
        count = min(len(conditions), block.practice - first)
        is_drawn = block.trial_order == "random" and not is_staircase
        order = rng.permutation(len(conditions))[:count] if is_drawn else range(count)
        for number in order:
            yield _turned(conditions[number].stimuli, rng) if is_staircase else conditions[number]


def _staircase_trials(
    block: PlannedBlock, rng: np.random.Generator
) -> Generator[PlannedTrial, Mapping[str, Answer], None]:
    """Trials of interleaved tracks: each trial is of one that has not ended, at random."""
    tracks = [Staircase(block) for _ in range(block.tracks)]
    while active := [number for number, own in enumerate(tracks) if not own.has_ended]:
        number = active[rng.integers(len(active))]
        track = tracks[number]
        condition = _turned(block.sets[track.level], rng)
        trial = _trial(block, rng, condition)
        answers = yield replace(trial, track=number, level=track.level, clipped=track.clipped)
        right = block.correct_option if condition.comparison is None else condition.comparison
        track.take(answers[block.question.name] == right)


def _turned(stimuli: tuple[str, ...], rng: np.random.Generator) -> Condition:
    """Stimuli with the last one, the comparison, at a place drawn at random."""
    if len(stimuli) == 1:
        return Condition(stimuli)
    place, others = int(rng.integers(len(stimuli))), stimuli[:-1]
    return Condition((*others[:place], stimuli[-1], *others[place:]), place)


def _trial(
    block: PlannedBlock, rng: np.random.Generator, condition: Condition, *, is_practice: bool = False
) -> PlannedTrial:
    return PlannedTrial(
        stimuli=condition.stimuli,
        questions=block.questions,
        key_orders=tuple(key_order(own, rng) for own in block.questions),
        is_practice=is_practice,
        comparison=condition.comparison,
    )
