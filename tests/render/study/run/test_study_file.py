"""A study's data file that is another program's, damaged or newer is refused; a disk that is full loses nothing."""

import os
import shutil
import sqlite3
import struct
from contextlib import closing, suppress

import pytest
from disk_faults import file_size_limit
from study_answers import PLAN, answer, interval

from palpate.render.errors import StudyError
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.study_file import NAME


@pytest.fixture
def folder(tmp_path):
    """A study's data, with one answer."""
    with AnswerStore(tmp_path / "data", PLAN) as store:
        store.begin("P01")
        store.add_answer(answer())
    return tmp_path / "data"


def change(folder, statement):
    """Have another program change the file."""
    with closing(sqlite3.connect(folder / NAME, isolation_level=None)) as connection:
        connection.executescript(statement)


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        (
            "PRAGMA user_version = 2",
            "has format version 2, this palpate knows up to 1: a newer one made it; update palpate",
        ),
        ("PRAGMA user_version = 0", "is damaged: 'its version' is not as palpate made it; move it away"),
        ("PRAGMA application_id = 7", "holds no data of a palpate study: move it away, or name another folder"),
        ("DROP TABLE events", "is damaged: 'events' is not as palpate made it"),
        ("ALTER TABLE answers ADD COLUMN mood TEXT", "is damaged: 'answers' is not as palpate made it"),
        (
            "CREATE TRIGGER better AFTER INSERT ON answers BEGIN UPDATE answers SET value = 1; END",
            "has a trigger, 'better', which could change answers: remove it",
        ),
    ],
)
def test_a_file_that_is_no_studys_is_refused_and_left_as_it_is(folder, statement, reason):
    change(folder, statement)
    before = (folder / NAME).read_bytes()
    with pytest.raises(StudyError, match=reason):
        AnswerStore(folder, PLAN)
    assert (folder / NAME).read_bytes() == before


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty: move it away"),
        (b"code,answer\nP01,1\n" * 90, r"cannot be opened: it is damaged \(file is not a database\)"),
    ],
)
def test_a_file_that_is_no_database_is_refused(folder, content, reason):
    (folder / NAME).write_bytes(content)
    with pytest.raises(StudyError, match=reason):
        AnswerStore(folder, PLAN)
    assert (folder / NAME).read_bytes() == content


def test_a_journal_that_names_another_file_is_refused_and_that_file_stays(folder, tmp_path):
    victim = tmp_path / "thesis.tex"
    victim.write_text("x")
    magic, name = bytes.fromhex("d9d505f920a163d7"), bytes(victim)
    (folder / f"{NAME}-journal").write_bytes(name + struct.pack(">II", len(name), sum(name)) + magic)
    with pytest.raises(StudyError, match="names another file, which SQLite would remove"):
        AnswerStore(folder, PLAN)
    assert victim.exists()


def test_a_file_that_another_process_has_just_made_stays(folder, tmp_path, monkeypatch):
    real, other = os.link, tmp_path / "other"

    def late(*names):
        shutil.copy(folder / NAME, other)
        real(*names)

    monkeypatch.setattr(os, "link", late)
    AnswerStore(other, PLAN).close()
    assert (other / NAME).read_bytes() == (folder / NAME).read_bytes()


def test_a_file_that_is_replaced_while_it_is_open_gets_the_answer_at_the_next_try(folder):
    """As by a program that copies folders between machines: what is written to the older file would be lost."""
    with AnswerStore(folder, PLAN) as store:
        store.begin("P01", resume=True)
        shutil.copy(folder / NAME, folder / "copy")
        (folder / "copy").replace(folder / NAME)
        with pytest.raises(
            StudyError, match=r"is not saved: .*moved, removed or replaced while it was open: put it back"
        ):
            store.add_answer(answer(1))
        store.add_answer(answer(1))
    with closing(sqlite3.connect(folder / NAME)) as connection:
        assert connection.execute("SELECT trial FROM answers ORDER BY sequence").fetchall() == [(0,), (1,)]


# Writes that fail.


class FailingConnection:
    """A connection of which one statement fails, counted from 0, before or after it has done its work."""

    def __init__(self, connection, number, is_done):
        self._connection, self._left, self._is_done = connection, number, is_done

    def __getattr__(self, name):
        return getattr(self._connection, name)

    def execute(self, *words):
        self._left -= 1
        if self._left == -1 and not self._is_done:
            raise sqlite3.OperationalError("disk I/O error")
        result = self._connection.execute(*words)
        if self._left == -1:
            result.close()
            raise sqlite3.OperationalError("disk I/O error")
        return result


@pytest.mark.parametrize("is_done", [False, True], ids=["before", "after"])
def test_whichever_statement_fails_the_same_call_made_again_saves_the_row_once(folder, is_done):
    """A commit can fail at its very end, when the row is on the disk: it is then not refused as a second one."""
    saved = 0
    with AnswerStore(folder, PLAN) as store:
        store.begin("P01", resume=True)
        for number in range(12):
            trial = number + 1
            for add, row in ((store.add_interval, interval(trial)), (store.add_answer, answer(trial))):
                store._file._disconnect()
                store._file._connection = FailingConnection(store._file._connected(), number, is_done)
                with suppress(StudyError):
                    add(row)
                    saved += 1
                    continue
                add(row)
    assert 0 < saved < 16  # at the first try: fewer statements than the number of the one that fails
    with closing(sqlite3.connect(folder / NAME)) as connection:
        for table, first in (("intervals", 1), ("answers", 0)):
            rows = connection.execute(f"SELECT trial FROM {table} ORDER BY sequence").fetchall()
            assert rows == [(trial,) for trial in range(first, 13)]


def test_a_file_that_may_not_grow_loses_nothing_and_goes_on_when_it_may(folder):
    with AnswerStore(folder, PLAN) as store:
        store.begin("P01", resume=True)
        with file_size_limit((folder / NAME).stat().st_size):
            with pytest.raises(
                StudyError, match=r"the answer to 'why' in trial 1 of block 'cube' is not saved: .*free space"
            ):
                store.add_answer(answer(1, "why"))
            assert len(store._progress().answers) == 1
        store.add_answer(answer(1, "why"))
    with AnswerStore(folder, PLAN) as store:
        assert list(store.begin("P01", resume=True).answers.values()) == [answer(), answer(1, "why")]


@pytest.mark.parametrize("size", [1000, 20_000])
def test_a_file_that_cannot_be_made_whole_is_not_there(tmp_path, size):
    with file_size_limit(size), pytest.raises(StudyError, match=r"answers\.sqlite cannot be made: .*free space"):
        AnswerStore(tmp_path, PLAN)
    assert list(tmp_path.iterdir()) == []
    AnswerStore(tmp_path, PLAN).close()
