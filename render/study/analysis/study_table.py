"""A study's answers as values: what was asked in which block, and who answered what. No statistics, no files."""

from dataclasses import dataclass
from typing import NamedTuple

from ..plan.study_plan import Answer, StudyPlan


class AnswerRecord(NamedTuple):
    """One answer; practice included."""

    code: str
    block: str
    """Its name; "before" and "after" for questions around all blocks."""
    position: int
    """Place of the block in this participant's order, from 0; -1 around all blocks."""
    trial: int
    """From 0, practice included; -1: asked after the block, or around all blocks."""
    name: str
    """Of the question; that of each trial of a forced choice is `answer`."""
    kind: str
    """"choice", "scale", "number" or "text"."""
    value: Answer
    """Of a choice: the option's number, from 0; of a scale: the point, from 1; None: left empty."""
    label: str = ""
    """Of a choice: the option's text."""
    key: str = ""
    """That was pressed."""
    stimuli: tuple[str, ...] = ()
    """Of the trial, in the order of its intervals."""
    is_practice: bool = False
    track: int = 0
    level: int | None = None
    comparison: int | None = None
    """With a standard: the interval, from 0, of the other stimulus."""
    clipped: int = 0
    seconds: float | None = None
    """Reaction time [s]."""


class RatioRecord(NamedTuple):
    """The ratio r of one interval with closed contours that was played live, outside practice, and met open ones."""

    code: str
    block: str
    trial: int
    stimulus: str
    r: float


class SessionRecord(NamedTuple):
    """One process that ran a participant."""

    code: str
    array: str
    source: str
    """Where the hand's poses came from."""
    palpate: str
    """Its version."""
    began: str
    """ISO 8601, UTC."""


@dataclass(frozen=True, kw_only=True)
class StudyTable:
    """All that an analysis needs of a study: read from its data by `read_answers`, or made by a simulation."""

    plan: StudyPlan
    codes: tuple[str, ...]
    """Of the participants who have answered something, in the plan's order."""
    unfinished: tuple[str, ...] = ()
    """Those of them who have not answered everything."""
    answers: tuple[AnswerRecord, ...]
    """In the order in which they were given."""
    ratios: tuple[RatioRecord, ...] = ()
    sessions: tuple[SessionRecord, ...] = ()
    """Of the participants; a simulation has none."""
    replayed_count: int = 0
    """Intervals that were stopped, or belong to a trial that was played again."""

    def __repr__(self) -> str:
        return f"StudyTable({self.plan.title!r}, {len(self.codes)} participants, {len(self.answers)} answers)"
