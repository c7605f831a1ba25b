"""A study's data file read as a `StudyTable`; nothing is written.

Any program can change the file, so that every value is checked against its plan: an analysis counts on them.
"""

import math
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ....datasets.bounded_file import FileBoundError
from ....datasets.json_text import parse_json
from ....datasets.storage.sqlite_opening import open_database
from ...errors import StudyError
from ...validation import value_text
from ..plan.study_plan import Answer, PlannedBlock, Question, StudyPlan
from ..plan.study_reading import read_stored_study
from ..run.study_file import ABOUT_CONSENT, APPLICATION_ID, BUSY_SECONDS, FORMAT_VERSION, NAME, file_error


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


_TEXT, _WHOLE, _NUMBER, _NONE = (str,), (int,), (int, float), (type(None),)
_ANSWER_TYPES = {
    "code": _TEXT, "block": _TEXT, "block_position": _WHOLE, "trial": _WHOLE, "name": _TEXT, "kind": _TEXT,
    "value": (*_TEXT, *_NUMBER, *_NONE), "label": _TEXT, "key": _TEXT, "stimuli": _TEXT, "is_practice": _WHOLE,
    "track": _WHOLE, "level": (*_WHOLE, *_NONE), "comparison": (*_WHOLE, *_NONE), "clipped": _WHOLE,
    "seconds": (*_NUMBER, *_NONE),
}  # fmt: skip
_RATIO_TYPES = {"code": _TEXT, "block": _TEXT, "trial": _WHOLE, "stimulus": _TEXT, "r": _NUMBER}
_ANSWERS = """
SELECT code, block, block_position, trial, name, kind, value, label, key, stimuli, is_practice, track, level,
    comparison, clipped, seconds FROM answers ORDER BY sequence
"""
_RATIOS = """
SELECT intervals.code, intervals.block, intervals.trial, stimulus, r FROM intervals
WHERE outcome = 'played' AND NOT is_practice AND r IS NOT NULL AND EXISTS (
    SELECT 1 FROM answers WHERE answers.code = intervals.code AND answers.block = intervals.block
    AND answers.trial = intervals.trial AND answers.attempt = intervals.attempt
) ORDER BY sequence
"""
"""Of trials that were answered: an interval of an attempt that was played again counts for nothing."""
_SESSIONS = "SELECT code, array, source, palpate, began FROM sessions ORDER BY id"
_REPLAYED = """
SELECT count(*) FROM intervals WHERE outcome <> 'played' OR NOT EXISTS (
    SELECT 1 FROM answers WHERE answers.code = intervals.code AND answers.block = intervals.block
    AND answers.trial = intervals.trial AND answers.attempt = intervals.attempt)
"""
_SQLITE = b"SQLite format 3\0"
"""What a database begins with."""


def read_answers(folder: str | Path) -> StudyTable:
    """The answers of a study; folder: that of its data, or the data file itself.

    Raises:
        StudyError: There are no data, the file is damaged, or it is of a newer palpate.
    """
    path = Path(folder)
    path = path / NAME if path.is_dir() else path
    if not path.exists():
        raise StudyError(f"{path} is not there: name the folder with a study's data, or its plan")
    try:
        with path.open("rb") as file:
            if file.read(len(_SQLITE)) not in (_SQLITE, b""):
                raise StudyError(f"{path} is no study's data: name the folder with them, or the study's plan")
        with closing(open_database(path, writes=False, busy_seconds=BUSY_SECONDS)) as connection:
            connection.execute("BEGIN")  # all rows are of one moment, though a participant takes part
            _require_study(connection, path)
            texts = connection.execute("SELECT text FROM plans ORDER BY rowid").fetchall()
            finished = dict(connection.execute("SELECT code, finished FROM participants ORDER BY number").fetchall())
            answers = [_answer_record(row) for row in connection.execute(_ANSWERS)]
            sessions = [SessionRecord(*map(str, row)) for row in connection.execute(_SESSIONS)]
            replayed = int(connection.execute(_REPLAYED).fetchone()[0])
            ratios = [RatioRecord(*_typed(row, _RATIO_TYPES)) for row in connection.execute(_RATIOS)]
    except (OSError, sqlite3.Error, FileBoundError) as error:
        raise file_error(path, error) from error
    except (ValueError, TypeError) as error:  # a list of stimuli that is none
        raise StudyError(f"{path} is damaged: a row cannot be read ({error})") from error
    if not texts:
        raise StudyError(f"{path} holds no plan: nobody has taken part yet")
    plan: StudyPlan = read_stored_study(str(texts[-1][0]), path)
    fault = next(_unplanned(plan, answers), None)
    if fault:
        raise StudyError(f"{path} is damaged: {fault}")
    having = {own.code for own in answers}
    codes = tuple(code for code in finished if code in having)
    return StudyTable(
        plan=plan,
        codes=codes,
        unfinished=tuple(code for code in codes if finished[code] is None),
        answers=tuple(answers),
        ratios=tuple(ratios),
        sessions=tuple(own for own in sessions if own.code in having),
        replayed_count=replayed,
    )


def _answer_record(row: tuple[Any, ...]) -> AnswerRecord:
    values = _typed(row, _ANSWER_TYPES)
    stimuli = parse_json(values[9])
    if not isinstance(stimuli, list):
        raise ValueError(f"stimuli is {value_text(stimuli)}, and should be a list")
    values[9], values[10] = tuple(map(str, stimuli)), bool(values[10])
    return AnswerRecord(*values)


def _typed(row: Sequence[Any], types: Mapping[str, tuple[type, ...]]) -> list[Any]:
    """A row's values; refuses those of another type, and numbers without end, which SQLite takes in any column."""
    for (name, own), value in zip(types.items(), row, strict=True):
        if not isinstance(value, own) or (isinstance(value, float) and not math.isfinite(value)):
            raise ValueError(f"{name} is {value_text(value)}")
    return list(row)


def _unplanned(plan: StudyPlan, answers: Sequence[AnswerRecord]) -> Iterator[str]:
    """Sentences about answers that the plan's study cannot have given."""
    codes, stimuli = set(plan.codes), {own.name for own in plan.stimuli}
    blocks = {own.name: own for own in plan.blocks}
    asked = {(block, False, own.name): own for block, own in _around(plan)}
    for block in plan.blocks:
        asked |= {(block.name, True, own.name): own for own in block.questions}
        asked |= {(block.name, False, own.name): own for own in block.questions_after}
    for own in answers:
        question = asked.get((own.block, own.trial >= 0, own.name))
        what = f"{own.code}'s answer to {value_text(own.name)} in block {value_text(own.block)} (trial {own.trial})"
        is_consent = (own.block, own.trial, own.name) == ABOUT_CONSENT
        if own.code not in codes:
            yield f"{value_text(own.code)} is no participant of its plan"
        elif question is None and not is_consent:
            yield f"{what} is to no question of its plan"
        elif question is not None:
            fault = _fault(own, question, blocks.get(own.block), stimuli)
            if fault:
                yield f"{what}: {fault}"


def _around(plan: StudyPlan) -> Iterator[tuple[str, Question]]:
    """The questions around all blocks, each with what stands for its block."""
    yield from (("before", own) for own in plan.questions_before)
    yield from (("after", own) for own in plan.questions_after)


def _fault(own: AnswerRecord, question: Question, block: PlannedBlock | None, stimuli: set[str]) -> str:
    """What the plan rules out about an answer to one of its questions; empty for nothing."""
    low, high = (1, question.point_count) if question.kind == "scale" else (0, len(question.options) - 1)
    value = own.value
    unknown = next((name for name in own.stimuli if name not in stimuli), None)
    if own.kind != question.kind:
        return f"its kind is {value_text(own.kind)}, that of the question {question.kind}"
    if question.kind in ("choice", "scale") and not (isinstance(value, int) and low <= value <= high):
        return f"value must be a whole number in {low}..{high}, not {value_text(value)}"
    if isinstance(value, str) != (question.kind == "text") and value is not None:
        return f"value must be a {question.kind}, not {value_text(value)}"
    if unknown is not None:
        return f"{value_text(unknown)} is no stimulus of the plan"
    if own.trial >= 0 and not own.stimuli:
        return "it has no stimuli"
    if own.comparison is not None and not 0 <= own.comparison < len(own.stimuli):
        return f"comparison must be in 0..{len(own.stimuli) - 1}, not {own.comparison}"
    if own.level is not None and block is not None and not 0 <= own.level < len(block.sets):
        return f"level must be in 0..{len(block.sets) - 1}, not {own.level}"
    return ""


def _require_study(connection: sqlite3.Connection, path: Path) -> None:
    application, version = (
        int(connection.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("application_id", "user_version")
    )
    if application != APPLICATION_ID:
        raise StudyError(f"{path} holds no data of a palpate study")
    if version > FORMAT_VERSION:
        raise StudyError(f"{path} has format version {version}, this palpate knows up to {FORMAT_VERSION}: update it")
