"""The order of a participant's blocks, and the trials of each design: functions of seed, participant and answers."""

from collections.abc import Generator, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from .latin_square import balanced_square
from .staircase import Staircase
from .study_plan import Answer, PlannedBlock, PlannedTrial, StudyPlan


class TrialCounts(NamedTuple):
    """Numbers of trials of a block; `least` and `most` are without practice, and differ for staircases only."""

    practice: int
    least: int
    most: int


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
    for stimuli in _practice(block, rng):
        yield _trial(block, rng, stimuli, is_practice=True)
    if block.design == "staircase":
        yield from _staircase_trials(block, rng)
        return
    conditions = _conditions(block) * block.repetitions
    order = rng.permutation(len(conditions)) if block.trial_order == "random" else range(len(conditions))
    for number in order:
        yield _trial(block, rng, conditions[number])


def _conditions(block: PlannedBlock) -> list[tuple[str, ...]]:
    """The stimuli of each trial that differs from the others, played in this order; not of a staircase."""
    if block.design == "magnitude" and block.modulus is not None:
        return [(block.modulus[0], *own) for own in block.sets]
    if block.design in ("2ifc", "constant"):
        return [order for own in block.sets for order in ((own, own[::-1]) if len(own) > 1 else (own,))]
    return list(block.sets)


def _practice(block: PlannedBlock, rng: np.random.Generator) -> Iterator[tuple[str, ...]]:
    """The stimuli of each practice trial: all conditions before any comes again; of a staircase, from the easiest."""
    is_staircase = block.design == "staircase"
    conditions = list(block.sets) if is_staircase else _conditions(block)
    for first in range(0, block.practice, len(conditions)):
        count = min(len(conditions), block.practice - first)
        is_drawn = block.trial_order == "random" and not is_staircase
        order = rng.permutation(len(conditions))[:count] if is_drawn else range(count)
        for number in order:
            yield _turned(conditions[number], rng)[0] if is_staircase else conditions[number]


def _staircase_trials(
    block: PlannedBlock, rng: np.random.Generator
) -> Generator[PlannedTrial, Mapping[str, Answer], None]:
    """Trials of interleaved tracks: each trial is of one that has not ended, at random."""
    tracks = [Staircase(block) for _ in range(block.tracks)]
    while active := [number for number, own in enumerate(tracks) if not own.has_ended]:
        number = active[rng.integers(len(active))]
        track = tracks[number]
        level = track.level
        stimuli, place = _turned(block.sets[level], rng)
        answers = yield _trial(block, rng, stimuli, track=number, level=level, clipped=track.clipped)
        right = place if len(stimuli) > 1 else block.correct_option
        track.take(answers[block.question.name] == right)


def _turned(stimuli: tuple[str, ...], rng: np.random.Generator) -> tuple[tuple[str, ...], int]:
    """Stimuli with the last one, the comparison, at a place drawn at random; and this place."""
    if len(stimuli) == 1:
        return stimuli, 0
    place = int(rng.integers(len(stimuli)))
    return (*stimuli[:-1][:place], stimuli[-1], *stimuli[:-1][place:]), place


def _trial(
    block: PlannedBlock,
    rng: np.random.Generator,
    stimuli: tuple[str, ...],
    *,
    is_practice: bool = False,
    track: int = 0,
    level: int | None = None,
    clipped: int = 0,
) -> PlannedTrial:
    mapped = next((own for own in block.questions if own.has_random_keys), None)
    return PlannedTrial(
        stimuli=stimuli,
        questions=block.questions,
        key_order=() if mapped is None else tuple(rng.permutation(len(mapped.options)).tolist()),
        is_practice=is_practice,
        track=track,
        level=level,
        clipped=clipped,
    )
