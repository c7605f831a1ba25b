"""A study's data file read as a `StudyTable`; nothing is written."""

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

from ....datasets.bounded_file import FileBoundError
from ....datasets.storage.sqlite_opening import open_database
from ...errors import StudyError
from ..plan.study_plan import StudyPlan
from ..plan.study_reading import read_stored_study
from ..run.store_rows import APPLICATION_ID, FORMAT_VERSION
from ..run.study_file import NAME, file_error
from .study_table import AnswerRecord, RatioRecord, StudyTable

BUSY_SECONDS = 5.0
"""How long reading waits for a participant's answer to be written, which takes milliseconds."""

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
        with closing(open_database(path, writes=False, busy_seconds=BUSY_SECONDS)) as connection:
            connection.execute("BEGIN")  # all rows are of one moment, though a participant takes part
            _require_study(connection, path)
            texts = connection.execute("SELECT text FROM plans ORDER BY rowid").fetchall()
            finished = dict(connection.execute("SELECT code, finished FROM participants ORDER BY number").fetchall())
            answers = [_answer_record(row) for row in connection.execute(_ANSWERS)]
            ratios = [RatioRecord(*row) for row in connection.execute(_RATIOS)]
    except (OSError, sqlite3.Error, FileBoundError) as error:
        raise file_error(path, error) from error
    except (ValueError, TypeError) as error:  # a list in a cell that is none
        raise StudyError(f"{path} is damaged: a row of answers cannot be read ({error})") from error
    if not texts:
        raise StudyError(f"{path} holds no plan: nobody has taken part yet")
    plan: StudyPlan = read_stored_study(texts[-1][0], path)
    having = {own.code for own in answers}
    codes = tuple(code for code in finished if code in having)
    return StudyTable(
        plan=plan,
        codes=codes,
        unfinished=tuple(code for code in codes if finished[code] is None),
        answers=tuple(answers),
        ratios=tuple(ratios),
    )


def _answer_record(row: tuple[Any, ...]) -> AnswerRecord:
    values = list(row)
    values[9] = tuple(map(str, json.loads(values[9])))
    values[10] = bool(values[10])
    return AnswerRecord(*values)


def _require_study(connection: sqlite3.Connection, path: Path) -> None:
    application, version = (
        int(connection.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("application_id", "user_version")
    )
    if application != APPLICATION_ID:
        raise StudyError(f"{path} holds no data of a palpate study")
    if version > FORMAT_VERSION:
        raise StudyError(f"{path} has format version {version}, this palpate knows up to {FORMAT_VERSION}: update it")
