"""What is added to a study's data is there once, with its values; who may begin, go on, finish; clocks that jump."""

import hashlib
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from types import SimpleNamespace

import pytest
from study_answers import PLAN, TEXT, answer, interval

from palpate.render.errors import StudyError
from palpate.render.study.run import answer_store
from palpate.render.study.run.answer_store import AnswerStore


@pytest.fixture
def store(tmp_path):
    with AnswerStore(tmp_path / "data", PLAN) as own:
        yield own


def query(store, statement):
    """Rows, as a program that is not palpate reads them."""
    with closing(sqlite3.connect(store.path)) as connection:
        return connection.execute(statement).fetchall()


def begun_again(store, code="P01", plan=PLAN, **options):
    """The progress of a participant in a process that comes later."""
    store.close()
    with AnswerStore(store.folder, plan) as again:
        return again.begin(code, **options)


def test_an_answer_comes_back_as_it_was_given_in_the_order_of_the_answers(store):
    store.begin("P01")
    given = [
        answer(3),
        answer(1, "why"),
        answer(2, value=2.5),
        answer(4, value=None),
        answer(-1, value="12", block="after"),
    ]
    for row in given:
        store.add_answer(row)
    progress = begun_again(store, resume=True)
    assert list(progress.answers.values()) == given
    assert list(progress.answers) == [
        ("cube", 3, "answer"),
        ("cube", 1, "why"),
        *((row.block, row.trial, row.name) for row in given[2:]),
    ]
    assert [type(row.value) for row in progress.answers.values()] == [int, str, float, type(None), str]


def test_a_question_is_answered_once_and_the_refusal_says_what_is_saved(store):
    store.begin("P01")
    store.add_answer(answer(1))
    with pytest.raises(
        StudyError, match=r"the answer to 'answer' in trial 1 of block 'cube' of participant P01 is saved already: 1 at"
    ):
        store.add_answer(answer(1, value=0, attempt=1))
    store.add_interval(interval(1))
    with pytest.raises(StudyError, match="interval 0 of trial 1 of block 'cube' of participant P01 is saved already"):
        store.add_interval(interval(1))
    store.add_interval(interval(1, attempt=1))
    assert query(store, "SELECT value FROM answers") == [(1,)]


def test_the_next_attempt_of_a_trial_comes_after_those_that_were_played(store):
    store.begin("P01")
    for row in (interval(0), interval(1), interval(1, attempt=1, outcome="stopped: the page was closed")):
        store.add_interval(row)
    progress = begun_again(store, resume=True)
    assert [progress.next_attempt("cube", trial) for trial in range(3)] == [1, 2, 0]


def test_nothing_is_kept_of_who_does_not_agree_and_their_code_is_free(store):
    store.begin("P01")
    store.add_event("declined")
    store.forget()
    counts = [query(store, f"SELECT count(*) FROM {name}")[0][0] for name in ("participants", "sessions", "events")]
    assert counts == [0, 0, 0]
    assert store.begin("P01").answers == {}
    store.add_answer(answer())
    with pytest.raises(StudyError, match="participant P01 has answers, which are kept"):
        store.forget()
    assert query(store, "SELECT count(*) FROM answers") == [(1,)]


# Who may begin.


def test_who_has_begun_goes_on_only_if_that_is_asked_for(store):
    store.begin("P01")
    store.add_answer(answer())
    with pytest.raises(StudyError, match=r"P01 began at .* and has 1 answers: --resume goes on where they stopped"):
        begun_again(store)
    assert len(begun_again(store, resume=True).answers) == 1
    assert begun_again(store, code="P02", resume=True).answers == {}


def test_a_participant_is_run_by_one_store_at_a_time_and_others_beside(store):
    store.begin("P01")
    with AnswerStore(store.folder, PLAN) as other:
        with pytest.raises(StudyError, match="P01 is being run by another process"):
            other.begin("P01", resume=True)
        other.begin("P02")
        with pytest.raises(StudyError, match="this process runs participant P02 already"):
            other.begin("P03")
        other.add_answer(answer())
        store.add_answer(answer())
    assert query(store, "SELECT code FROM answers ORDER BY sequence") == [("P02",), ("P01",)]


# The plan.


def test_another_plan_is_refused_with_the_lines_that_differ(store):
    changed = replace(PLAN, text=TEXT.replace("seed = 3", "seed = 4"), seed=4)
    with pytest.raises(
        StudyError, match=r"STUDY.toml is another plan .*: line 2 was 'seed = 3', now 'seed = 4'\. Undo"
    ):
        AnswerStore(store.folder, changed)
    begun_again(store)


def test_a_plan_with_more_codes_and_comments_goes_on_and_both_texts_are_kept(store):
    more = replace(PLAN, text=TEXT + "# more people\n", codes=(*PLAN.codes, "P04"))
    assert begun_again(store, plan=more, code="P04").number == 3
    assert query(store, "SELECT text FROM plans ORDER BY rowid") == [(TEXT,), (more.text,)]
    with pytest.raises(StudyError, match="is another plan"):
        AnswerStore(store.folder, PLAN)  # P04 has a number, which the shorter list lacks


def test_codes_in_another_order_are_refused_because_numbers_would_change(store):
    with pytest.raises(StudyError, match="another plan"):
        AnswerStore(store.folder, replace(PLAN, text=TEXT + "#", codes=("P02", "P01", "P03")))


# Files of poses.


def test_poses_are_named_by_their_place_and_no_file_is_overwritten(store):
    store.begin("P01")
    first = store.poses_path(3, 12, 1, 0)
    assert first == store.folder / "poses" / "P01-b03-t012-i1-a0.h5"
    first.write_bytes(b"left by a killed process")
    second = store.poses_path(3, 12, 1, 0)
    assert second.name == "P01-b03-t012-i1-a0-2.h5"
    second.write_bytes(b"poses")
    store.add_interval(interval(poses_file=second.name))
    assert query(store, "SELECT poses_file, poses_sha256 FROM intervals") == [
        (second.name, hashlib.sha256(b"poses").hexdigest())
    ]


# Clocks.


class Clocks:
    """Stands for the module `time`."""

    def __init__(self, wall, monotonic):
        self.wall, self.steady = wall, monotonic

    def time(self):
        return self.wall

    def monotonic(self):
        return self.steady

    def pass_by(self, seconds, jump=0.0):
        self.wall += seconds + jump
        self.steady += seconds


@pytest.fixture
def clocks(monkeypatch):
    own = Clocks(1.8e9, 500.0)
    monkeypatch.setattr(answer_store, "time", SimpleNamespace(time=own.time, monotonic=own.monotonic))
    return own


def jumps(store):
    return query(store, "SELECT sequence, details FROM events WHERE name = 'clock_jump' ORDER BY sequence")


@pytest.mark.parametrize("jump", [1.5, -1.5, -3600.0, 1e8, -0.25])
def test_a_clock_that_jumps_is_an_event_before_the_row_and_order_does_not_follow_it(store, clocks, jump):
    store.begin("P01")
    for trial in range(4):
        clocks.pass_by(20.0, jump if trial == 2 and jump != -0.25 else 0.0)
        if trial == 2 and jump == -0.25:  # also a small step back
            clocks.wall -= 20.25
            clocks.steady -= 20.0
        store.add_answer(answer(trial))
    ((sequence, details),) = jumps(store)
    assert query(store, "SELECT trial FROM answers ORDER BY sequence") == [(0,), (1,), (2,), (3,)]
    assert query(store, f"SELECT trial FROM answers WHERE sequence = {sequence} + 1") == [(2,)]
    read = json.loads(details)
    before, after = answer_store.seconds_of(read["wall_before"]), answer_store.seconds_of(read["wall"])
    steady = read["monotonic"] - read["monotonic_before"]
    assert after - before - steady == pytest.approx(jump, abs=1e-5)


def test_an_event_of_a_jump_that_was_not_saved_is_saved_with_the_next_row(store, clocks, monkeypatch):
    store.begin("P01")
    clocks.pass_by(1.0, 10.0)
    real = answer_store._insert

    def failing(connection, table, values):
        if table == "answers":
            raise sqlite3.OperationalError("disk I/O error")
        return real(connection, table, values)

    with monkeypatch.context() as patch:
        patch.setattr(answer_store, "_insert", failing)
        with pytest.raises(StudyError, match="is not saved"):
            store.add_answer(answer())
    store.add_answer(answer())
    assert len(jumps(store)) == 1
