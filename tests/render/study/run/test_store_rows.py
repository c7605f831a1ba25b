"""Rows and tables of a study's data agree, in the source and in the document."""

import re
import sqlite3
from contextlib import closing
from dataclasses import fields
from pathlib import Path

import pytest
from page_blocks import blocks_of
from study_answers import PLAN, answer, interval

from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.study_file import SCHEMA, AnswerRow, IntervalRow, SessionSetup

PAGE = Path(__file__).parents[4] / "docs" / "formats" / "study-data.md"


def columns():
    """Columns of every table and view, in order."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(SCHEMA)
        names = [
            name
            for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type IN ('table', 'view')")
            if not name.startswith("sqlite_")
        ]
        return {name: [own[1] for own in connection.execute(f"PRAGMA table_info({name})")] for name in names}


@pytest.mark.parametrize(
    ("table", "row"), [("intervals", IntervalRow), ("answers", AnswerRow), ("sessions", SessionSetup)]
)
def test_each_field_of_a_row_has_a_column(table, row):
    assert {own.name for own in fields(row)} <= set(columns()[table])


def documented_columns():
    """Columns that the document names: of small tables in one table with their names, of others in sections."""
    found = {}
    for name, text in re.findall(r"^### `(\w+)`.*?\n(.+?)(?=^##|\Z)", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        found[name] = re.findall(r"`(\w+)`", " ".join(re.findall(r"^\| (.+?) \|", text, re.MULTILINE)))
    for name, cell in re.findall(r"^\| `(\w+)` \| ([^|]+) \| [^|]+ \|$", PAGE.read_text(), re.MULTILINE):
        found.setdefault(name, []).extend(re.findall(r"`(\w+)`", cell))
    return found


def test_the_document_has_every_column_of_every_table():
    assert documented_columns().keys() == columns().keys()
    assert {name: sorted(own) for name, own in documented_columns().items()} == {
        name: sorted(own) for name, own in columns().items()
    }


def test_the_documents_queries_give_shares_and_remove_a_participant(tmp_path):
    with AnswerStore(tmp_path, PLAN) as store:
        store.begin("P03")
        for trial in range(6):
            store.add_interval(interval(trial))
            store.add_answer(answer(trial, stimuli=("cube-cc", "cube-oc"), value=int(trial == 5)))
        store.add_event("stopped")
        path = store.path
    share, *removal = [
        statement
        for block in blocks_of(PAGE)
        for statement in block.text.strip().split("\n\n" if "avg" in block.text else ";\n")
    ]
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        assert connection.execute(share).fetchall() == [("P03", "cube", 0.75, 4)]
        for statement in removal:
            connection.execute(statement)
        tables = [name for name in columns() if name not in ("study", "plans", "stimuli")]
        assert [connection.execute(f"SELECT count(*) FROM {name}").fetchone() for name in tables] == [(0,)] * len(
            tables
        )
