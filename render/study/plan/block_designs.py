"""The order of a participant's blocks, and the trials of each design: functions of seed, participant and answers."""

from collections.abc import Generator, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from .study_plan import Answer, PlannedBlock, PlannedTrial, Question, StudyPlan


class Staircase:
    """One track of a staircase (H. Levitt, 1971, Transformed up-down methods in psychoacoustics).

    `down` correct answers in a row make it a step harder, one wrong answer a step easier, so that it converges to the
    level at which a share of 0.5 ** (1 / down) of the answers is correct. A reversal is a move in the other direction
    than the one before; the move that is one has the size of step after it. A move that goes beyond the first or the
    last level ends there, and counts as `clipped`; for reversals it is a move like the others.

    >>> from palpate.render.study.plan.study_plan import PlannedBlock, Question
    >>> question = Question(name="felt", text="Did you feel it?", kind="choice", options=("no", "yes"))
    >>> levels = (("loud",), ("middle",), ("soft",))
    >>> track = Staircase(
    ...     PlannedBlock(name="b", design="staircase", question=question, questions=(question,), sets=levels, down=1)
    ... )
    >>> track.take(is_correct=True)
    >>> track.level, track.reversals
    (1, 0)
    """

    def __init__(self, block: PlannedBlock) -> None:
        self._block = block
        self.level = block.start_level
        """Of the next trial."""
        self.reversals = 0
        self.clipped = 0
        """Moves that would have gone beyond the first or the last level."""
        self._trials = 0
        self._correct = 0  # in a row, at this level
        self._direction = 0  # of the move before: 1 is harder, -1 easier

    def __repr__(self) -> str:
        """One line."""
        return f"Staircase(level {self.level}, {self.reversals} reversals, {self._trials} trials)"

    @property
    def has_ended(self) -> bool:
        """Whether it has as many reversals or trials as the block asks for."""
        return self.reversals >= self._block.reversals or self._trials >= self._block.trials_max

    def take(self, is_correct: bool) -> None:
        """Take the answer of a trial at `level`."""
        self._trials += 1
        self._correct = self._correct + 1 if is_correct else 0
        if is_correct and self._correct < self._block.down:
            return
        self._correct = 0
        direction = 1 if is_correct else -1
        self.reversals += self._direction == -direction
        self._direction = direction
        steps = self._block.steps
        target = self.level + direction * steps[min(self.reversals, len(steps) - 1)]
        self.level = min(max(target, 0), len(self._block.sets) - 1)
        self.clipped += self.level != target


def balanced_square(count: int) -> np.ndarray:
    """Williams' design of `count` conditions, numbered from 0: int64, shape [row, position].

    `count` rows where it is even, else twice as many, as no single square is balanced then; one row for one condition.
    Each condition comes once in a row and equally often at each position, and each ordered pair of neighbours equally
    often. The first row is 0, 1, count - 1, 2, count - 2, ...; the others add 1, modulo `count`. Of an odd count, the
    second half of the rows are those of the first half, read backwards.
    """
    if count < 1:
        raise ValueError(f"count must be at least 1, not {count}")
    first = np.array([(place + 1) // 2 if place % 2 else -(place // 2) for place in range(count)])
    square = (first + np.arange(count)[:, np.newaxis]) % count
    if count % 2 and count > 1:
        square = np.concatenate([square, square[:, ::-1]])
    return square


def row_count(count: int) -> int:
    """Rows of the balanced square of `count` conditions: so many participants fill it once."""
    return count if count % 2 == 0 or count == 1 else 2 * count


def square_fault(condition_count: int, participant_count: int) -> str | None:
    """Describe why participants do not fill whole balanced squares, and the nearest that do; None where they do."""
    rows = row_count(condition_count)
    if participant_count > 0 and participant_count % rows == 0:
        return None
    below = participant_count // rows * rows
    nearest = f"{below} or {below + rows}" if below else f"{rows}"
    sentence = (
        f"the order of blocks is not balanced: a balanced Latin square of {condition_count} blocks has {rows} rows, "
        f"and {participant_count} participants fill no whole ones; the nearest that do are {nearest} participants"
    )
    others = [
        count
        for count in (condition_count - 1, condition_count + 1)
        if count > 1 and participant_count > 0 and participant_count % row_count(count) == 0
    ]
    if others:
        sentence += f", or {participant_count} with {' or '.join(map(str, others))} blocks"
    return sentence


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
