"""Rows and tables of a study's data agree, in the source and in the document."""

import re
import sqlite3
from contextlib import closing
from dataclasses import fields
from pathlib import Path

import pytest

from palpate.render.study.run.store_rows import SCHEMA, AnswerRow, IntervalRow, SessionSetup, json_text, storable

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


def test_the_document_has_every_column_of_every_table_in_its_section():
    sections = re.split(r"^### `(\w+)`.*$", PAGE.read_text(), flags=re.MULTILINE)
    documented = {
        name: [own for line in re.findall(r"^\| (.+?) \|", text, re.MULTILINE) for own in re.findall(r"`(\w+)`", line)]
        for name, text in zip(sections[1::2], sections[2::2], strict=True)
    }
    assert documented == columns()


def test_lists_become_json_and_other_values_stay():
    assert [storable(own) for own in ((1, 0), (), "ü", 2**62, True, None)] == ["[1, 0]", "[]", "ü", 2**62, True, None]


def test_json_holds_no_constants_that_are_not_json():
    assert json_text({"a": [float("inf"), 1.5]}) == '{"a": [null, 1.5]}'
