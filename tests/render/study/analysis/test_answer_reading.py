"""Answers read from data that the real store wrote: as SQL of the documentation counts them; damage is refused."""

import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from answered_tables import PAPER, answer_row, paper_answers, plan_of, point

from palpate.render.errors import StudyError
from palpate.render.study.analysis import answer_reading
from palpate.render.study.analysis.answer_measures import choice_measures, ratio_measures, scale_measures
from palpate.render.study.analysis.answer_reading import read_answers
from palpate.render.study.run.answer_store import AnswerStore
from palpate.render.study.run.study_file import ABOUT_CONSENT, AnswerRow, IntervalRow

pytestmark = pytest.mark.exhaustive

ABOUT = '[[question_before]]\nname = "age"\ntext = "Age?"\nkind = "number"\noptional = true\n' + (
    '[[question_after]]\nname = "note"\ntext = "Anything else?"\nkind = "text"\noptional = true\n'
)
TEXT = PAPER.replace("[[stimulus]]", ABOUT + "[[stimulus]]", 1).replace("[[block]]", "[[block]]\npractice = 2", 1)
ROWS = [
    "110111111010 7 1",
    "101111100000 4 4",
    "101100000000 2 6",
    "110000000000 1 7",
    "001110111011 5 3",
    "001010101010 3 3",
]
P_OF_THE_DOCUMENTATION = """
SELECT code, block, avg(chosen = substr(block, 1, instr(block, '-') - 1) || '-cc') AS p, count(*) AS trials
FROM tidy_answers WHERE name = 'answer' AND design = '2ifc' AND NOT is_practice
GROUP BY code, block
"""
R_BY_SQL = """
SELECT code, block, avg(r) AS r
FROM intervals JOIN answers USING (code, block, trial, attempt)
WHERE outcome = 'played' AND name = 'answer' AND NOT answers.is_practice
GROUP BY code, block
"""


def interval_row(record, number, r, *, attempt=0, outcome="played"):
    return IntervalRow(
        block=record.block, block_position=0, trial=record.trial, attempt=attempt, interval=number,
        stimulus=record.stimuli[number], is_practice=record.is_practice, outcome=outcome, r=r,
    )  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Data of two participants, the second of whom has not finished, with practice and trials played again."""
    folder, rng = tmp_path_factory.mktemp("data"), np.random.default_rng(4)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate.render.study.run.study_file.sync", lambda *_: None)
        for code, rows, is_finished in (("P01", ROWS, True), ("P02", ROWS[::-1], False)):
            with AnswerStore(folder, plan_of(TEXT)) as store:
                store.begin(code)
                for own in paper_answers(code, rows):
                    record = own._replace(is_practice=0 <= own.trial < 2)
                    attempt = int(record.trial == 5)
                    for number, stimulus in enumerate(record.stimuli):
                        r = 1.0 + rng.random() if stimulus.endswith("cc") else None
                        if attempt:
                            store.add_interval(interval_row(record, number, r and 100.0))
                        is_lost = record.trial == 6 and number == 0
                        outcome = "stopped after 1.000 s" if is_lost else "played"
                        store.add_interval(interval_row(record, number, r, attempt=attempt, outcome=outcome))
                    store.add_answer(answer_row(record, attempt))
                if is_finished:
                    store.add_answer(replace(answer_row(point("P01", "after", "note", "a\0b\n=1+1")), kind="text"))
                    store.finish()
    return folder


@pytest.fixture
def data(written, tmp_path):
    """A copy that a test may change."""
    return shutil.copytree(written, tmp_path / "data")


def change(folder, *statements):
    with closing(sqlite3.connect(folder / "answers.sqlite")) as connection:
        for own in statements:
            connection.execute(own)
        connection.commit()


def query(folder, statement):
    with closing(sqlite3.connect(folder / "answers.sqlite")) as connection:
        return connection.execute(statement).fetchall()


def cells(measure, wanted=np.isfinite):
    """Values by participant and block."""
    return {
        (code, cell.name): float(value)
        for code, row in zip(measure.codes, measure.values, strict=True)
        for cell, value in zip(measure.cells, row, strict=True)
        if wanted(value)
    }


def test_p_is_that_of_the_documentations_sql(written):
    (own,) = choice_measures(read_answers(written))
    expected = {(code, block): p for code, block, p, _ in query(written, P_OF_THE_DOCUMENTATION)}
    assert cells(own) == pytest.approx(expected)
    assert len(expected) == 12
    assert own.counts.tolist() == [[10] * 6] * 2
    assert own.values[0].tolist() == pytest.approx([0.7, 0.5, 0.2, 0.0, 0.8, 0.5])  # ROWS without 2 for practice


def test_r_is_that_of_sql_alone(written):
    (own,) = ratio_measures(read_answers(written))
    expected = {(code, block): r for code, block, r in query(written, R_BY_SQL)}
    assert cells(own) == pytest.approx(expected)
    assert len(expected) == 12
    assert np.nanmax(own.values) < 2.0  # r of intervals that were played again was 100


def test_scales_are_those_that_were_given(written):
    confidence, difficulty = scale_measures(read_answers(written))
    assert confidence.values.tolist() == [[7, 4, 2, 1, 5, 3], [3, 5, 1, 2, 4, 7]]
    assert difficulty.values.tolist() == [[1, 4, 6, 7, 3, 3], [3, 3, 7, 6, 4, 1]]


def test_the_file_itself_can_be_named(written):
    assert read_answers(written / "answers.sqlite").answers == read_answers(str(written)).answers


def test_hostile_texts_come_back_as_the_store_keeps_them(written):
    (note,) = (own for own in read_answers(written).answers if own.block == "after")
    assert note.value == "a\ufffdb\n=1+1"  # no text of SQLite may hold a zero byte


def test_consent_and_empty_answers_are_read(tmp_path):
    with AnswerStore(tmp_path, plan_of(TEXT)) as store:
        store.begin("P01")
        block, trial, name = ABOUT_CONSENT
        for row in (
            AnswerRow(
                block=block,
                block_position=-1,
                design="",
                trial=trial,
                attempt=0,
                name=name,
                question="?",
                kind="choice",
                value=1,
            ),
            AnswerRow(
                block="before",
                block_position=-1,
                design="",
                trial=-1,
                attempt=0,
                name="age",
                question="?",
                kind="number",
                value=None,
            ),
        ):
            store.add_answer(row)
    table = read_answers(tmp_path)
    assert [own.value for own in table.answers] == [1, None]
    assert table.unfinished == table.codes == ("P01",)


def test_the_newest_plan_is_the_datas(written, data):
    longer = TEXT.replace("participants = 3", "participants = 5")
    with AnswerStore(data, plan_of(longer)):
        assert read_answers(data).plan.codes == ("P01", "P02", "P03", "P04", "P05")


def test_files_that_a_plan_names_may_be_gone(tmp_path):
    text = TEXT.replace('object = "{object}"\nstrategy', 'object = "gone/{object}.stl"\nstrategy')
    with AnswerStore(tmp_path, plan_of(text)) as store:
        store.begin("P01")
        store.add_answer(answer_row(paper_answers("P01", ROWS)[0]))
    assert read_answers(tmp_path).plan.stimuli[0].solid == "gone/cube.stl"


def test_data_without_an_answer_are_those_of_nobody(tmp_path):
    with AnswerStore(tmp_path, plan_of(TEXT)) as store:
        store.begin("P01")
    table = read_answers(tmp_path)
    assert (table.codes, table.unfinished, table.answers, table.ratios) == ((), (), (), ())


def test_a_transaction_that_never_ends_is_named(data, monkeypatch):
    monkeypatch.setattr(answer_reading, "BUSY_SECONDS", 0.01)
    with closing(sqlite3.connect(data / "answers.sqlite", isolation_level=None)) as connection:
        connection.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StudyError, match=r"cannot be read: another program has read or written it for 20 s"):
            read_answers(data)


def test_reading_changes_nothing_and_undoes_nothing_of_a_killed_process(data):
    script = (
        "import os, sqlite3, sys\nown = sqlite3.connect(sys.argv[1], isolation_level=None)\n"
        "own.execute('PRAGMA cache_size = 1')\nown.execute('BEGIN IMMEDIATE')\n"
        "own.execute(\"UPDATE answers SET label = 'x' || hex(zeroblob(3000))\")\nos._exit(0)\n"
    )
    expected = read_answers(data).answers
    subprocess.run([sys.executable, "-c", script, str(data / "answers.sqlite")], check=True)
    kept = {path.name: path.read_bytes() for path in data.iterdir() if path.is_file()}
    assert len(kept["answers.sqlite-journal"]) > 0
    assert read_answers(data).answers == expected
    assert {path.name: path.read_bytes() for path in data.iterdir() if path.is_file()} == kept


@pytest.mark.parametrize(
    ("statement", "message"),
    [
        ("PRAGMA user_version = 2", "has format version 2, this palpate knows up to 1: update it"),
        ("PRAGMA application_id = 7", "holds no data of a palpate study"),
        ("DELETE FROM plans", "holds no plan: nobody has taken part yet"),
        ("UPDATE plans SET text = 'title ='", "answers.sqlite:1: "),
        ("UPDATE plans SET text = x'00ff'", "answers.sqlite"),
        ("DROP TABLE answers", "cannot be read: no such table: answers"),
        ("UPDATE answers SET value = 'First' WHERE trial = 4", "value must be a whole number in 0..1, not 'First'"),
        ("UPDATE answers SET value = 2 WHERE trial = 4", "value must be a whole number in 0..1, not 2"),
        ("UPDATE answers SET value = -1 WHERE trial = 4", "value must be a whole number in 0..1, not -1"),
        ("UPDATE answers SET value = NULL WHERE trial = 4", "value must be a whole number in 0..1, not None"),
        ("UPDATE answers SET value = 9 WHERE name = 'difficulty'", "value must be a whole number in 1..7, not 9"),
        ("UPDATE answers SET value = 3.5 WHERE name = 'difficulty'", "value must be a whole number in 1..7, not 3.5"),
        ("UPDATE answers SET value = 3 WHERE name = 'note'", "value must be a text, not 3"),
        ("UPDATE answers SET value = x'ff' WHERE trial = 4", "a row cannot be read (value is b'\\xff')"),
        ("UPDATE answers SET kind = 'mood' WHERE trial = 4", "its kind is 'mood', that of the question choice"),
        ("UPDATE answers SET name = 'mood' WHERE trial = 4", "'mood' in block 'cube-1.0' (trial 4) is to no question"),
        ("UPDATE answers SET block = 'x' || block", "in block 'xcube-1.0' (trial 0) is to no question of its plan"),
        ("UPDATE answers SET seconds = 'fast'", "a row cannot be read (seconds is 'fast')"),
        ("UPDATE answers SET seconds = 9e999", "a row cannot be read (seconds is inf)"),
        ("UPDATE answers SET is_practice = 'no'", "a row cannot be read (is_practice is 'no')"),
        ("UPDATE answers SET stimuli = '[\"cube-cc\"'", "a row cannot be read (Expecting"),
        ("UPDATE answers SET stimuli = '5'", "a row cannot be read (stimuli is 5, and should be a list)"),
        ("UPDATE answers SET stimuli = '[]'", "in block 'cube-1.0' (trial 0): it has no stimuli"),
        ("UPDATE answers SET stimuli = '[\"cube-cc\", \"egg\"]'", "'egg' is no stimulus of the plan"),
        ("UPDATE answers SET comparison = 2 WHERE trial = 4", "comparison must be in 0..1, not 2"),
        ("UPDATE answers SET level = -1 WHERE trial = 4", "level must be in 0..0, not -1"),
        ("UPDATE answers SET code = 'Eve' WHERE code = 'P02'", "'Eve' is no participant of its plan"),
        ("UPDATE intervals SET r = 'long' WHERE r > 0", "a row cannot be read (r is 'long')"),
        ("UPDATE intervals SET r = 9e999 WHERE r > 0", "a row cannot be read (r is inf)"),
    ],
)  # fmt: skip
def test_damage_is_named_with_its_place(data, statement, message):
    change(data, statement)
    with pytest.raises(StudyError) as caught:
        read_answers(data)
    assert str(data / "answers.sqlite") in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_list_without_end_is_named(data):
    change(data, f"UPDATE answers SET stimuli = '{'[' * 100_000}'")
    with pytest.raises(StudyError, match="is damaged: a row cannot be read"):
        read_answers(data)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "holds no data of a palpate study"),
        (b"code,answer\nP01,1\n" * 90, r"is no study's data"),
    ],
)
def test_files_that_are_no_data_are_refused(tmp_path, content, message):
    (tmp_path / "answers.sqlite").write_bytes(content)
    with pytest.raises(StudyError, match=message):
        read_answers(tmp_path)


def test_pages_that_were_overwritten_are_refused(data):
    path = data / "answers.sqlite"
    content = bytearray(path.read_bytes())
    content[4096 * 4 :] = b"\xa5" * (len(content) - 4096 * 4)
    path.write_bytes(content)
    with pytest.raises(StudyError, match=r"answers\.sqlite cannot be read: it is damaged"):
        read_answers(data)
