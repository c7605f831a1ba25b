"""Tables for other programs: the tidy one against SQL's view of the same data, the others against their values."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from answered_tables import (
    PAPER,
    QUESTION,
    answer_row,
    chosen,
    levels_text,
    number,
    option,
    paper_answers,
    plan_of,
    stimulus_text,
    table_of,
    text,
)

from palpate.render.study.analysis.answer_reading import read_answers
from palpate.render.study.analysis.result_columns import answer_columns, fit_columns, measure_columns, outcome_columns
from palpate.render.study.analysis.study_analysis import analyse_answers
from palpate.render.study.run.answer_store import AnswerStore

ALL_KINDS = plan_of(
    '[[question_before]]\nname = "age"\ntext = "?"\nkind = "number"\noptional = true\n',
    levels_text([1, 2]),
    stimulus_text("none"),
    f'[[block]]\nname = "c"\ndesign = "constant"\nstandard = "none"\ncomparisons = ["s1", "s2"]\n{QUESTION}\n',
    f'[[block]]\nname = "y"\ndesign = "constant"\ncomparisons = ["s1", "s2"]\noptions = ["no", "yes"]\n{QUESTION}\n',
    f'[[block]]\nname = "m"\ndesign = "magnitude"\nstimuli = ["s1", "s2"]\n{QUESTION}\n'
    'modulus = { stimulus = "s1", number = 10 }\n',
    '[[block]]\nname = "e"\ndesign = "exploration"\nsets = [["s1", "s2"]]\n'
    '[[block.question]]\nname = "answer"\ntext = "?"\nkind = "choice"\noptions = ["alike", "different"]\n'
    '[[block.question]]\nname = "why"\ntext = "?"\nkind = "text"\n',
)
GIVEN = [
    (number("P02", "before", -1, None, name="age"), ""),
    (option("P02", "c", 0, 0, ("First", "Second"), ("s1", "none"), comparison=0, is_practice=True), "constant"),
    (option("P02", "c", 1, 0, ("First", "Second"), ("none", "s2"), comparison=1), "constant"),
    (option("P02", "y", 0, 1, ("no", "yes"), ("s2",)), "constant"),
    (number("P02", "m", 0, 12, ("s1", "s2")), "magnitude"),
    (option("P02", "e", 0, 1, ("alike", "different"), ("s1", "s2")), "exploration"),
    (text("P02", "e", "why", '=1+1\n"x";', trial=0, stimuli=("s1", "s2")), "exploration"),
]


def test_the_tidy_table_is_that_of_sql(tmp_path):
    with AnswerStore(tmp_path, ALL_KINDS) as store:
        store.begin("P02")
        for record, design in GIVEN:
            store.add_answer(answer_row(record, design=design))
        path = store.path
    columns = answer_columns(read_answers(tmp_path))
    with closing(sqlite3.connect(path)) as connection:
        connection.row_factory = sqlite3.Row
        rows = connection.execute("SELECT * FROM tidy_answers").fetchall()
    names = [name for name in rows[0].keys() if name not in ("attempt", "sequence", "clipped")]  # noqa: SIM118
    for name in names:
        assert columns[name] == [row[name] for row in rows], name
    assert columns["chosen"] == [None, "s1", "none", None, None, None, None]
    assert columns["participant"] == [1] * 7


def test_what_was_chosen_follows_the_option_and_not_the_key():
    plan = plan_of(PAPER)
    left_is_second = chosen("P01", "cube-1.0", ("cube-oc", "cube-cc"), "10", keys=("ArrowRight", "ArrowLeft"))
    columns = answer_columns(table_of(plan, left_is_second))
    assert columns["chosen"] == ["cube-cc", "cube-oc"]
    assert columns["key"] == ["ArrowLeft", "ArrowLeft"]
    assert columns["label"] == ["Second", "Second"]
    assert (columns["first"], columns["second"]) == (["cube-oc", "cube-cc"], ["cube-cc", "cube-oc"])
    assert (columns["block_object"], columns["block_opacity"]) == (["cube"] * 2, ["1"] * 2)


def test_a_factor_that_is_called_position_leaves_the_position_of_blocks():
    plan = plan_of(
        stimulus_text("a", "b"),
        '[[block]]\nfor = { position = ["near", "far"] }\nname = "{position}"\ndesign = "2ifc"\n'
        f'pairs = [["a", "b"]]\n{QUESTION}\n',
    )
    columns = answer_columns(table_of(plan, chosen("P01", "far", ("a", "b"), "1")))
    assert (columns["block_position"], columns["block_position_level"]) == ([0], ["far"])


def test_nobody_has_tables_without_rows():
    table = table_of(plan_of(PAPER))
    analysis = analyse_answers(table)
    assert answer_columns(table) == measure_columns(analysis) == fit_columns(analysis) == {}
    assert all(p is None for p in outcome_columns(analysis)["p"])


ROWS = ["1101111011 5 3", "0111101110 4 4", "1100010110 3 5", "1110111011 5 2", "0001110100 2 6", "1101011010 4 4"]


def test_each_test_has_a_row_that_says_what_its_observations_are():
    columns = outcome_columns(
        analyse_answers(table_of(plan_of(PAPER), *(paper_answers(code, ROWS) for code in ("P01", "P02"))))
    )
    assert set(columns["observations"]) == {"participants", "cells", "answers"}
    assert set(columns["measure"]) == {"p_cc", "confidence", "difficulty"}
    assert {len(own) for own in columns.values()} == {len(columns["p"])}
    place = next(
        k
        for k, own in enumerate(columns["compares"])
        if own == "cube - tube" and columns["observations"][k] == "participants"
    )
    assert (columns["factor"][place], columns["n"][place], columns["statistic"][place]) == ("object", 2, "V")


def test_each_fit_has_a_row_and_says_why_there_is_none():
    plan = plan_of(
        levels_text([1, 2, 3, 4]),
        '[[block]]\nfor = { hand = ["left", "right"] }\nname = "{hand}"\ndesign = "constant"\n'
        f'comparisons = ["s1", "s2", "s3", "s4"]\noptions = ["no", "yes"]\nrepetitions = 10\n{QUESTION}\n',
    )
    shares = {"s1": 1, "s2": 3, "s3": 7, "s4": 9}
    answers = [
        option("P01", "left", 10 * place + k, int(k < yes), ("no", "yes"), (name,))
        for place, (name, yes) in enumerate(shares.items()) for k in range(10)
    ]  # fmt: skip
    answers += [option("P01", "right", 0, 1, ("no", "yes"), ("s1",))]
    columns = fit_columns(analyse_answers(table_of(plan, answers)))
    assert columns["block_hand"] == ["left", "right"]
    assert columns["mu"][0] == pytest.approx(2.5, abs=0.1)  # 1, 3, 7, 9 of 10 lie around it; lapses move it
    assert columns["mu_low"][0] < 2.5 < columns["mu_high"][0]
    assert columns["jnd"][0] == pytest.approx(0.6745 * columns["sigma"][0], rel=1e-3)
    assert columns["converged"] == [True, False]
    assert columns["is_increasing"] == [True, None]
    assert columns["note"][1].startswith("All answers are of one kind")
    assert (columns["mu"][1], columns["guess"], columns["clipped"]) == (None, [0.0, 0.0], [0, 0])
    assert not any(isinstance(own, np.generic) for name in columns for own in columns[name] if name != "converged")
