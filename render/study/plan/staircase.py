"""The transformed up-down rule after Levitt: which level the next trial of a track has."""

from .study_plan import PlannedBlock


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
