"""A study's plan as values: what stimuli there are, what blocks are made of them, and what people are asked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Literal

from ....datasets.storage.durable import NewFile
from ....device.playing.limits import Limits
from ...errors import StudyError
from ...objects.mesh.placement import Placement
from ...terminal import console
from ...validation import choose

Factors = Mapping[str, str | float]
"""Values of the keys of a table's `for`, by which an analysis compares; empty for a table that stands alone."""
QuestionKind = Literal["choice", "scale", "number", "text"]
Design = Literal["2ifc", "constant", "staircase", "magnitude", "rating", "exploration"]
BlockOrder = Literal["latin", "random", "fixed"]


@dataclass(frozen=True, kw_only=True)
class Question:
    """One thing that a participant is asked, and how it is answered by keys alone."""

    name: str
    """Of its column in the data; unique within its block."""
    text: str
    kind: QuestionKind
    options: tuple[str, ...] = ()
    """Of a choice: what each answer is called on the screen; the answer is the number of one, from 0."""
    point_count: int = 7
    """Of a scale: the answer is 1..point_count."""
    low_text: str = ""
    """Of a scale: words at point 1."""
    high_text: str = ""
    """Of a scale: words at the last point."""
    low: float | None = None
    """Of a number: the least that is taken."""
    high: float | None = None
    """Of a number: the largest that is taken."""
    is_optional: bool = False
    """Of a text or a number: an empty answer is taken."""
    has_random_keys: bool = False
    """Of a choice: which key gives which answer changes at random from trial to trial."""


Answer = int | float | str | None
"""Of a choice: the option's number; of a scale: 1..point_count; None: left empty."""


@dataclass(frozen=True, kw_only=True)
class PlannedStimulus:
    """What an interval plays: a prepared file, or an object that the hand explores live."""

    name: str
    duration: float
    """Of the interval [s]."""
    file: Path | None = None
    """Contour file, focal points or prepared frames; None: it is rendered live."""
    solid: str | None = None
    """Of a live one: built-in name or path of the object."""
    strategy: str = "cc"
    sampling: str | None = None
    shown: str | None = None
    """Object that the participant sees; None: `solid`, and nothing for a file."""
    placement: Placement = field(default_factory=Placement)
    """Of `solid` and of `shown`."""
    value: float | None = None
    """What psychometric functions are drawn over: level, frequency, size, in the plan's own unit."""
    factors: Factors = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PlannedBlock:
    """Trials of one design, one after the other."""

    name: str
    design: Design
    question: Question
    """Of each trial; for `rating` and `exploration` the first of `questions`."""
    questions: tuple[Question, ...]
    """Of each trial, in order: `question` alone but for `rating` and `exploration`."""
    instruction: str = ""
    """Text before the block."""
    sets: tuple[tuple[str, ...], ...] = ()
    """Names of the stimuli of a trial: pairs (2ifc), (standard, comparison) or (comparison,) (constant), one each
    (magnitude, rating), any number in this order (exploration). Of a staircase: of each level, from the easiest to the
    hardest: (standard, level) or (level,)."""
    repetitions: int = 1
    """Of each set; of 2ifc: of each of its two orders; of constant with a standard: of each order, too."""
    trial_order: Literal["random", "fixed"] = "random"
    practice: int = 0
    """Trials before the others, drawn from the same sets, whose answers do not count; of a staircase, from the easiest
    level on."""
    opacity: float = 1.0
    """Of the object that is seen; 0: none is."""
    shows_hand: bool = True
    gap: float = 1.0
    """Silence between the intervals of a trial [s]."""
    rest: float = 1.0
    """Least silence between an answer and the next trial [s]."""
    correct_option: int | None = None
    """Of a staircase of single intervals: the option that counts as correct ("yes"). Where a set has more than one
    stimulus, the last one is the comparison, and comes at a random place among the others: the option with the number
    of its interval, from 0, is correct."""
    start_level: int = 0
    """Of a staircase: number of the level of its first trial."""
    down: int = 2
    """Of a staircase: so many correct answers in a row make it one step harder (1 wrong answer: easier)."""
    steps: tuple[int, ...] = (1,)
    """Of a staircase: levels of a step before the first reversal, after it, and so on; the last one stays."""
    reversals: int = 8
    """Of a staircase: after so many it ends."""
    trials_max: int = 60
    """Of a staircase: after so many trials it ends, too."""
    tracks: int = 1
    """Of a staircase: so many of the same kind are interleaved at random."""
    modulus: tuple[str, float] | None = None
    """Of magnitude: a stimulus that is played before each one, and the number that it is called."""
    questions_after: tuple[Question, ...] = ()
    """Asked once, at the block's end."""
    factors: Factors = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class StudyPlan:
    """A whole study. `read_study` makes it of a STUDY.toml and refuses what cannot be run."""

    path: Path
    text: str
    """Of the file: it is kept with the data."""
    title: str
    codes: tuple[str, ...]
    """Of the participants, in order: the place of a code is the participant's number."""
    seed: int
    stimuli: tuple[PlannedStimulus, ...]
    blocks: tuple[PlannedBlock, ...]
    block_order: BlockOrder = "latin"
    consent: str = ""
    """Text that a participant agrees to; empty: nobody is asked."""
    data_statement: str = ""
    """What becomes of the data; kept with them."""
    welcome: str = ""
    goodbye: str = ""
    questions_before: tuple[Question, ...] = ()
    questions_after: tuple[Question, ...] = ()
    choice_keys: tuple[str, ...] = ()
    """Keys of choices, as browsers name them; empty: ArrowLeft and ArrowRight for two options, else digits from 1."""
    answer_seconds: float = 4.0
    """Expected time of an answer [s]: for the minutes that a run is expected to take."""
    hand: str = "palm"
    records_poses: bool = True
    """Each live interval is kept as a contour file with the hand's poses and latency."""
    noise_level: float = 0.0
    """Of the pink noise that the participant's page plays, 0..1 of full scale; 0: none."""
    limits: Limits = field(default_factory=Limits)
    texts: dict[str, str] = field(default_factory=dict)
    """Every other sentence that a participant reads, by its name in `TEXTS`."""

    def stimulus(self, name: str) -> PlannedStimulus:
        """A stimulus by its name."""
        return next(own for own in self.stimuli if own.name == name)

    def sentence(self, name: str, **values: object) -> str:
        """A text of the plan, or its default, with values put in."""
        return self.texts.get(name, TEXTS[name]).format(**values)


TEXTS = {
    "language": "en",
    "continue": "Press the space bar to go on.",
    "agree": "I agree",
    "decline": "I do not agree",
    "declined": "You did not agree, so nothing is recorded. Thank you.",
    "block": "Part {number} of {count}",
    "practice": "Trials for practice come first: {count}.",
    "practice_over": "The practice is over. Your answers count from now on.",
    "ready": "Hold your hand over the array.",
    "begin": "Press the space bar to begin.",
    "interval": "{number}",
    "gap": "",
    "modulus": "The first one is called {value:g}.",
    "rest": "The array rests. It goes on by itself.",
    "no_hand": "Hold your hand over the array.",
    "number": "Type a number, then press Enter.",
    "text": "Type your answer, then press Enter.",
    "out_of_range": "The number must be from {low:g} to {high:g}.",
    "stopped": "The study is paused. Please wait.",
    "lost": "The connection is lost. Please tell the experimenter.",
    "ended": "That was all. Thank you.",
    "ended_early": "The study stops here for today. Thank you.",
    "progress": "Trial {number} of {count}",
    "progress_open": "Trial {number}",
}
"""Sentences that a participant reads, by the names under which a plan's `[texts]` translates them.

`language` is the code of their language, as HTML names it.
"""


@dataclass(frozen=True, kw_only=True)
class PlannedTrial:
    """Intervals, then questions."""

    stimuli: tuple[str, ...]
    """Names, in the order of the intervals."""
    questions: tuple[Question, ...]
    key_orders: tuple[tuple[int, ...], ...] = ()
    """Of each question: number of the option that each key gives, in the order of the keys; empty: as they are
    listed."""
    is_practice: bool = False
    track: int = 0
    """Of a staircase: which of those that are interleaved."""
    level: int | None = None
    """Of a staircase: number of the level."""
    comparison: int | None = None
    """Of constant stimuli and staircases with a standard: the interval, from 0, of the stimulus that is not it."""
    clipped: int = 0
    """Of a staircase: moves of this track so far that would have gone beyond its first or its last level."""


# ---- plans of whole studies that palpate brings


EXAMPLES = ("paper", "pilot")
"""Names of the plans, in `examples/`."""


def example_text(name: str) -> str:
    """The text of an example's STUDY.toml.

    >>> from palpate.render.study.plan.study_plan import example_text
    >>> example_text("pilot").splitlines()[8]
    'title = "Infill density, pilot"'
    """
    return files(__package__).joinpath("examples", f"{name}.toml").read_text("utf-8")


def write_example(name: str, *, as_json: bool) -> None:
    """Write an example into the current folder; a file that is there is kept, and the command refused."""
    name = choose("example", name, EXAMPLES)
    path = Path(f"{name}.toml")
    try:
        with NewFile(path) as new:
            new.write(example_text(name).encode())
            new.publish(replaces=False)
    except FileExistsError as error:
        raise StudyError(f"{path} exists: move it away, or call this command in another folder") from error
    except OSError as error:
        raise StudyError(f"{path} cannot be written here: {error.strerror}") from error
    console.show_values({"plan": str(path)}, as_json=as_json, title="study example")
