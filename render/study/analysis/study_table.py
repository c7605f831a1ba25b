"""A study's answers as values: what was asked in which block, and who answered what. No statistics, no files."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ..plan.study_plan import Answer

Level = str | float
"""A value of a factor."""


@dataclass(frozen=True, kw_only=True)
class StudiedStimulus:
    """A stimulus of the plan."""

    name: str
    factors: Mapping[str, Level] = field(default_factory=dict)
    """Its values of the keys of the plan's `for`."""
    value: float | None = None
    """On the plan's own scale."""


@dataclass(frozen=True, kw_only=True)
class StudiedBlock:
    """A block of the plan: a cell of the design."""

    name: str
    design: str
    factors: Mapping[str, Level] = field(default_factory=dict)
    """Its values of the keys of the plan's `for`; empty where the plan names it alone."""
    sets: tuple[tuple[str, ...], ...] = ()
    """Stimuli of a trial, as the plan lists them: of 2ifc a pair, whose second is the one that p counts; of constant
    stimuli (standard, comparison) or (comparison,); of a staircase those of each level."""
    question: str = ""
    """Text that was asked after each trial."""
    options: tuple[str, ...] = ()
    correct: str = ""
    """Of a staircase of single intervals: the option that is correct."""
    points: Mapping[str, int] = field(default_factory=dict)
    """Of each scale that is asked in or after the block: how many points it has."""
    trial_count: int | None = None
    """Of trials that count; None where answers decide."""


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
    """The ratio r of one interval that was played with closed contours, live."""

    code: str
    block: str
    trial: int
    stimulus: str
    r: float | None
    """None: no open contour was met."""


@dataclass(frozen=True, kw_only=True)
class StudyTable:
    """All that an analysis needs of a study: read from its data by `read_answers`, or made by a simulation."""

    title: str
    codes: tuple[str, ...]
    """Of the participants who have answered something, in the plan's order."""
    unfinished: tuple[str, ...] = ()
    """Those of them who have not answered everything."""
    blocks: tuple[StudiedBlock, ...]
    stimuli: tuple[StudiedStimulus, ...]
    answers: tuple[AnswerRecord, ...]
    """In the order in which they were given."""
    ratios: tuple[RatioRecord, ...] = ()
