"""The tables of STUDY.toml as pydantic models: what each key may be. A value that is refused raises PlanFault.

`read_study` takes the lists of tables within a table (questions) apart before, and reports keys that no model has.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, model_validator

from ....datasets.known_names import likely_name
from ...objects.mesh.placement import SIZE_LARGEST, UP_AXES
from ...sweeps.plan.axes import ANGLE, PLACE, SIZE_SMALLEST
from ...sweeps.plan.values import ChoiceCheck, NumberCheck, VectorCheck, checked_items, refuse, within
from ...validation import value_text

DESIGN_NAMES = ("2ifc", "constant", "staircase", "magnitude", "rating", "exploration")
QUESTION_KINDS = ("choice", "scale", "number", "text")
NAME_MOST, TEXT_MOST, LIST_MOST = 64, 20_000, 1000
OPTIONS_MOST = 9
"""Of a choice, and points of a scale: the digits from 1 are their keys."""
NAMED_KEYS = ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "PageUp", "PageDown", "Home", "End", "Enter")
"""Keys with names, as browsers name them; every other one is called by its character."""
TRIAL_QUESTION = "answer"
"""Name of the question of each trial, where a design has one alone."""
RESERVED_BLOCKS = ("before", "after", "consent")
"""Blocks that the data know beside those of the plan."""


@dataclass(frozen=True)
class SentenceCheck:
    """Checks a text that people read."""

    least: int = 1
    most: int = TEXT_MOST

    def __call__(self, value: object) -> str:
        """The text."""
        if not isinstance(value, str):
            refuse(f"must be a text, not {value_text(value)}")
        if not self.least <= len(value) <= self.most:
            refuse(f"must have {self.least}..{self.most} characters, not {len(value)}")
        return value


@dataclass(frozen=True)
class PatternCheck:
    """Checks a text of certain characters."""

    pattern: str
    form: str
    """Of the value, in words."""

    def __call__(self, value: object) -> str:
        """The text."""
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            refuse(f"must be {self.form}, not {value_text(value)}")
        return value


@dataclass(frozen=True)
class ListCheck:
    """Checks a list, of which each item is different."""

    item: Callable[[Any], Any]
    least: int
    most: int
    items: str
    """What the items are, in words."""
    is_distinct: bool = True

    @property
    def form(self) -> str:
        """Of the value, in words."""
        span = f"{self.least}..{self.most}" if self.least < self.most else f"{self.least}"
        return f"a list of {span} {self.items}"

    def __call__(self, value: object) -> list[Any]:
        """The items."""
        if not isinstance(value, list) or not self.least <= len(value) <= self.most:
            refuse(f"must be {self.form}, not {value_text(value)}")
        items = checked_items(self.item, value)
        for k, own in enumerate(items):
            if self.is_distinct and own in items[:k]:
                refuse(f"{value_text(own)} stands twice in the list", (k,))
        return items


@dataclass(frozen=True)
class FlagCheck:
    """Checks true or false."""

    form: ClassVar[str] = "true or false"

    def __call__(self, value: object) -> bool:
        """The value."""
        if not isinstance(value, bool):
            refuse(f"must be {self.form}, not {value_text(value)}")
        return value


NAME = PatternCheck(
    rf"\w(?:[\w .+%-]{{0,{NAME_MOST - 2}}}[\w.+%-])?",
    f"a name of at most {NAME_MOST} letters, digits, blanks and -_.+%, which begins with a letter or digit",
)
"""Of a stimulus or a block."""
COLUMN = PatternCheck(rf"[^\W\d_]\w{{0,{NAME_MOST - 1}}}", "a name of letters, digits and _ that begins with a letter")
"""Of a question: it is a column of the data."""
CODE = PatternCheck(r"[A-Za-z0-9_-]{1,16}", "a code of at most 16 letters, digits, - and _")
NUMBER = NumberCheck(-1e12, 1e12)
SENTENCE, LABEL = SentenceCheck(), SentenceCheck(most=200)
OPTION_LABELS = ListCheck(LABEL, 2, OPTIONS_MOST, "different texts")
STIMULI = ListCheck(NAME, 1, LIST_MOST, "names of stimuli")


def check_pair(value: object) -> list[str]:
    """The names of two different stimuli."""
    names = ListCheck(NAME, 2, 2, "names of stimuli", is_distinct=False)(value)
    if names[0] == names[1]:
        refuse(f"must be two different stimuli, not {value_text(value)}")
    return names


def check_key(value: object) -> str:
    """A key, as browsers name it."""
    if isinstance(value, str) and len(value) == 1 and value.isprintable():
        return value
    if not isinstance(value, str):
        refuse(f"must be a key: one character, or one of {', '.join(NAMED_KEYS)}; not {value_text(value)}")
    return ChoiceCheck(NAMED_KEYS)(value)


@dataclass(frozen=True)
class ModulusCheck:
    """Checks the stimulus that is played first, and the number that it is called."""

    form: ClassVar[str] = '{ stimulus = "NAME", number = 100 }'

    def __call__(self, value: object) -> tuple[str, float]:
        """Name and number."""
        if not isinstance(value, dict) or set(value) != {"stimulus", "number"}:
            refuse(f"must be {self.form}, not {value_text(value)}")
        with within("stimulus"):
            name = NAME(value["stimulus"])
        with within("number"):
            return name, NUMBER(value["number"])


def _by(check: Callable[[object], Any]) -> BeforeValidator:
    """A key's check."""
    return BeforeValidator(check)


def _require_span(low: float | None, high: float | None) -> None:
    """Refuse a highest number that is not above the lowest."""
    if low is not None and high is not None and low >= high:
        refuse(f"must be above low, {low:g}, not {high:g}", ("high",))


Flag = Annotated[bool, _by(FlagCheck())]
Sentence = Annotated[str, _by(SENTENCE)]
LongText = Annotated[str, _by(SentenceCheck(least=0))]
Label = Annotated[str, _by(SentenceCheck(least=0, most=200))]
Name = Annotated[str, _by(NAME)]
SourceText = Annotated[str, _by(SentenceCheck(most=4096))]
Stimuli = Annotated[list[str], _by(STIMULI)]
OptionLabels = Annotated[list[str], _by(OPTION_LABELS)]
Seconds = Annotated[float, _by(NumberCheck(0.0, 3600.0, "s"))]
Count = Annotated[int, _by(NumberCheck(1, 1000, whole=True))]
AnyNumber = Annotated[float, _by(NUMBER)]


class StrictTable(BaseModel):
    """Keys that are not fields are refused; attribute docstrings are what docs/formats/study-plan.md says."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, use_attribute_docstrings=True)


class StudyKeys(StrictTable):
    """The keys beside the tables."""

    title: Annotated[str, _by(LABEL)]
    """What the study is called"""
    participants: Annotated[int | None, _by(NumberCheck(1, 999, whole=True))] = None
    """How many there are: their codes are P01, P02, ..."""
    codes: Annotated[list[str] | None, _by(ListCheck(CODE, 1, 999, "different codes"))] = None
    """The participants' codes, instead of `participants`"""
    seed: Annotated[int, _by(NumberCheck(0, 10**9, whole=True))] = 1
    """All that is random follows from it, the participant's number and the block's"""
    block_order: Annotated[Literal["latin", "random", "fixed"], _by(ChoiceCheck(("latin", "random", "fixed")))] = (
        "latin"
    )
    """Balanced Latin square over the participants, a random order for each, or as written"""
    hand: SourceText = "palm"
    """What touches live stimuli: palm, planes, skin, or the file of a hand"""
    records_poses: Flag = True
    """Each live interval is kept as a contour file with poses and latency"""
    answer_seconds: Annotated[float, _by(NumberCheck(0.1, 3600.0, "s"))] = 4.0
    """Expected time of an answer [s], for the minutes that the run sheet expects"""
    choice_keys: Annotated[list[str], _by(ListCheck(check_key, 2, OPTIONS_MOST, "different keys"))] = []
    """Keys of choices; left out: the arrows left and right for two options, else the digits from 1"""
    noise_level: Annotated[float, _by(NumberCheck(0.0, 1.0))] = 0.0
    """Of the pink noise that masks the array, of full scale; 0: none"""
    consent: LongText = ""
    """What a participant agrees to, first of all; left out: nobody is asked"""
    data_statement: LongText = ""
    """What becomes of the data; kept with them"""
    welcome: LongText = ""
    """First screen"""
    goodbye: LongText = ""
    """Last screen"""


class StimulusKeys(StrictTable):
    """The keys of every stimulus."""

    name: Name
    """What blocks call it"""
    duration: Annotated[float, _by(NumberCheck(1e-3, 3600.0, "s"))]
    """Of its interval [s]"""
    value: AnyNumber | None = None
    """What psychometric functions are drawn over, in a unit of the plan's own"""
    shown: SourceText | None = None
    """Object that is seen; left out: `object`, and nothing for a file"""
    scale: Annotated[float, _by(NumberCheck(1e-9, 1e9))] = 1.0
    """Factor on the object's coordinates"""
    up: Annotated[str, _by(ChoiceCheck(UP_AXES))] = "z"
    """Axis of the object's file that points up"""
    fit: Annotated[float | None, _by(NumberCheck(SIZE_SMALLEST, SIZE_LARGEST, "m"))] = None
    """Longest side of the object [m]"""
    rotate: Annotated[list[float], _by(VectorCheck(3, ANGLE))] = [0.0, 0.0, 0.0]
    """Turns of the object about x, y, z [degree]"""
    at: Annotated[list[float] | None, _by(VectorCheck(3, PLACE))] = None
    """Where the object's middle goes [m]"""


class LiveStimulusKeys(StimulusKeys):
    """An object that the hand explores."""

    object: SourceText
    """Built-in name or file"""
    strategy: SourceText = "cc"
    """Intersection strategy: name or JSON file"""
    sampling: SourceText | None = None
    """Sampling strategy: name or JSON file; left out: `stm`"""


class PreparedStimulusKeys(StimulusKeys):
    """A file that is played."""

    file: SourceText
    """Contour file, focal points or prepared frames"""


class QuestionKeys(StrictTable):
    """The keys of every question."""

    name: Annotated[str, _by(COLUMN)]
    """Its column in the data"""
    text: Sentence
    """What is asked"""
    kind: Annotated[Literal["choice", "scale", "number", "text"], _by(ChoiceCheck(QUESTION_KINDS))]
    """How it is answered"""


class ChoiceKeys(QuestionKeys):
    """One of several options; the answer is its number, from 0."""

    options: OptionLabels
    """What the answers are called"""
    random_keys: Flag = False
    """Which key gives which answer changes from trial to trial"""


class ScaleKeys(QuestionKeys):
    """A point of a scale; the answer is its number, from 1."""

    points: Annotated[int, _by(NumberCheck(2, OPTIONS_MOST, whole=True))] = 7
    """How many there are"""
    low_text: Label = ""
    """Words at the first point"""
    high_text: Label = ""
    """Words at the last point"""


class NumberKeys(QuestionKeys):
    """A number that is typed."""

    low: AnyNumber | None = None
    """The least that is taken"""
    high: AnyNumber | None = None
    """The largest that is taken"""
    optional: Flag = False
    """An empty answer is taken"""

    @model_validator(mode="after")
    def _check_span(self) -> Self:
        _require_span(self.low, self.high)
        return self


class TextKeys(QuestionKeys):
    """A text that is typed."""

    optional: Flag = False
    """An empty answer is taken"""


class BlockKeys(StrictTable):
    """The keys of every block."""

    name: Name
    """Its name in the data"""
    design: Annotated[
        Literal["2ifc", "constant", "staircase", "magnitude", "rating", "exploration"], _by(ChoiceCheck(DESIGN_NAMES))
    ]
    """What its trials are"""
    instruction: LongText = ""
    """Text before the block"""
    trial_order: Annotated[Literal["random", "fixed"], _by(ChoiceCheck(("random", "fixed")))] = "random"
    """Of the trials"""
    practice: Annotated[int, _by(NumberCheck(0, 1000, whole=True))] = 0
    """Trials before the others, whose answers do not count"""
    opacity: Annotated[float, _by(NumberCheck(0.0, 1.0))] = 1.0
    """Of the object that is seen; 0: none is"""
    hand: Flag = True
    """The participant sees their hand"""
    gap: Annotated[float, _by(NumberCheck(0.0, 60.0, "s"))] = 1.0
    """Silence between the intervals of a trial [s]"""
    rest: Seconds = 1.0
    """Least silence between an answer and the next trial [s]"""

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """Stimuli of each trial, or of each level of a staircase."""
        raise NotImplementedError


class RepeatedBlockKeys(BlockKeys):
    """A block whose trials are known beforehand."""

    repetitions: Count = 1
    """Of each trial"""


class AskedBlockKeys(BlockKeys):
    """A block with one choice in each trial."""

    question: Sentence
    """What is asked after each trial"""
    options: OptionLabels = ["First", "Second"]
    """What the answers are called; with standard 2, in the order of the intervals"""
    random_keys: Flag = False
    """Which key gives which answer changes from trial to trial"""


class StandardBlockKeys(AskedBlockKeys):
    """A block whose trials have two intervals only with a standard."""

    standard: Name | None = None
    """The other interval's stimulus; left out: a trial has one interval, and `options` are needed"""

    @model_validator(mode="after")
    def _check_options(self) -> Self:
        if self.standard is None and "options" not in self.model_fields_set:
            refuse('is missing: without standard, a trial has one interval: options = ["yes", "no"]', ("options",))
        if self.standard is not None and len(self.options) != 2:
            refuse(f"must be 2 with standard, one for each interval, not {len(self.options)}", ("options",))
        return self


class ForcedChoiceKeys(RepeatedBlockKeys, AskedBlockKeys):
    """Two intervals, and which one: each pair in both orders."""

    pairs: Annotated[list[list[str]], _by(ListCheck(check_pair, 1, LIST_MOST, "pairs of stimuli"))]
    """What is compared; `repetitions` counts each of the two orders"""

    options: Annotated[list[str], _by(ListCheck(LABEL, 2, 2, "different texts"))] = ["First", "Second"]
    """What the answers are called, in the order of the intervals"""

    @model_validator(mode="after")
    def _check_pairs(self) -> Self:
        for k, pair in enumerate(self.pairs):
            if pair[::-1] in self.pairs[:k]:
                refuse(f"{value_text(pair)} stands twice: each pair is played in both orders", ("pairs", k))
        return self

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """Pairs."""
        return [tuple(pair) for pair in self.pairs]


class ConstantKeys(RepeatedBlockKeys, StandardBlockKeys):
    """Constant stimuli: each comparison, alone or beside the standard in both orders."""

    comparisons: Stimuli
    """Stimuli that are judged; with standard, `repetitions` counts each of the two orders"""

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """The standard, if there is one, and a comparison."""
        return [(self.standard, own) if self.standard else (own,) for own in self.comparisons]


class StaircaseKeys(StandardBlockKeys):
    """Adaptive: after correct answers a harder level, after a wrong one an easier one."""

    levels: Annotated[list[str], _by(ListCheck(NAME, 2, LIST_MOST, "names of stimuli"))]
    """Stimuli, the easiest first"""
    correct: Annotated[str | None, _by(LABEL)] = None
    """The option that is correct; needed without standard, refused with it: there the level's interval is correct"""
    start: Annotated[int, _by(NumberCheck(0, LIST_MOST, whole=True))] = 0
    """Level of the first trial, from 0"""
    down: Annotated[int, _by(NumberCheck(1, 10, whole=True))] = 2
    """Correct answers in a row that make it harder"""
    steps: Annotated[
        list[int],
        _by(ListCheck(NumberCheck(1, LIST_MOST, whole=True), 1, 20, "whole numbers above 0", is_distinct=False)),
    ] = [1]
    """Levels of a step before the first reversal, after it, and so on; the last one stays"""
    reversals: Annotated[int, _by(NumberCheck(1, 100, whole=True))] = 8
    """After so many it ends"""
    trials_max: Count = 60
    """After so many trials of a track it ends, too"""
    tracks: Annotated[int, _by(NumberCheck(1, 10, whole=True))] = 1
    """Staircases of the same kind that are interleaved"""

    @model_validator(mode="after")
    def _check_levels(self) -> Self:
        last = len(self.levels) - 1
        if self.start > last:
            refuse(f"must lie in 0..{last}, the levels, not {self.start}", ("start",))
        if self.standard in self.levels:
            refuse(f"must not contain the standard, {self.standard!r}: no answer to it is correct", ("levels",))
        if self.standard is not None and self.correct is not None:
            refuse("goes without standard: with it, the interval that is not the standard is correct", ("correct",))
        if self.standard is None and self.correct is None:
            refuse(f"is missing: without standard, one of {value_text(self.options)} is correct", ("correct",))
        if self.standard is None and self.correct not in self.options:
            meant = likely_name(self.correct, self.options)
            refuse(f"must be one of {value_text(self.options)}, not {self.correct!r}{meant}", ("correct",))
        return self

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """The standard, if there is one, and the level's stimulus."""
        return [(self.standard, own) if self.standard else (own,) for own in self.levels]


class MagnitudeKeys(RepeatedBlockKeys):
    """Magnitude estimation: a number for each stimulus."""

    stimuli: Stimuli
    """Stimuli that are judged"""
    question: Sentence
    """What is asked after each trial"""
    modulus: Annotated[tuple[str, float] | None, _by(ModulusCheck())] = None
    """A stimulus that is played before each one, and the number that it is called"""
    low: AnyNumber | None = 0.0
    """The least number that is taken"""
    high: AnyNumber | None = None
    """The largest number that is taken"""

    @model_validator(mode="after")
    def _check_numbers(self) -> Self:
        _require_span(self.low, self.high)
        return self

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """One each."""
        return [(own,) for own in self.stimuli]


class RatingKeys(RepeatedBlockKeys):
    """Each stimulus on one or more scales, `[[block.question]]`."""

    stimuli: Stimuli
    """Stimuli that are judged"""

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """One each."""
        return [(own,) for own in self.stimuli]


class ExplorationKeys(RepeatedBlockKeys):
    """Stimuli explored one after the other, then questions of any kind, `[[block.question]]`."""

    sets: Annotated[
        list[list[str]],
        _by(
            ListCheck(
                ListCheck(NAME, 1, 20, "names of stimuli", is_distinct=False),
                1,
                LIST_MOST,
                "lists of stimuli",
                is_distinct=False,
            )
        ),
    ]
    """The stimuli of each trial, in this order"""

    @property
    def trial_sets(self) -> list[tuple[str, ...]]:
        """As they are."""
        return [tuple(own) for own in self.sets]


QUESTION_KEYS: dict[str, type[QuestionKeys]] = dict(
    zip(QUESTION_KINDS, (ChoiceKeys, ScaleKeys, NumberKeys, TextKeys), strict=True)
)
"""By kind."""
DESIGN_KEYS: dict[str, type[BlockKeys]] = dict(
    zip(
        DESIGN_NAMES,
        (ForcedChoiceKeys, ConstantKeys, StaircaseKeys, MagnitudeKeys, RatingKeys, ExplorationKeys),
        strict=True,
    )
)
"""By design."""
