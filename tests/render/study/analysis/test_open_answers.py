"""Answers without tests: what was asked where, how often, and what people wrote, however hostile."""

import pytest
from answered_tables import QUESTION, number, option, plan_of, point, stimulus_text, table_of, text

from palpate.render.study.analysis.answer_measures import open_answers

AROUND = (
    '[[question_before]]\nname = "age"\ntext = "Age?"\nkind = "number"\noptional = true\n'
    '[[question_before]]\nname = "hand"\ntext = "Hand?"\nkind = "choice"\noptions = ["left", "right", "both"]\n'
    '[[question_after]]\nname = "note"\ntext = "Note?"\nkind = "text"\noptional = true\n'
)
LOOK = (
    '[[block]]\nname = "look"\ndesign = "exploration"\nsets = [["a", "b"], ["b"]]\n'
    '[[block.question]]\nname = "felt"\ntext = "What did you feel?"\nkind = "text"\n'
    '[[block.question]]\nname = "sure"\ntext = "Sure?"\nkind = "scale"\n'
    '[[block.question]]\nname = "which"\ntext = "Which?"\nkind = "choice"\noptions = ["a", "b"]\n'
    '[[block.question_after]]\nname = "felt_all"\ntext = "All?"\nkind = "text"\n'
)
PAIRS = (
    f'[[block]]\nname = "pairs"\ndesign = "2ifc"\npairs = [["a", "b"]]\n{QUESTION}\n'
    '[[block.question_after]]\nname = "ease"\ntext = "?"\nkind = "scale"\n'
)
HOSTILE = [
    "\0",
    "line\nline\r\n",
    '=HYPERLINK("x")',
    "<script>alert(1)</script>",
    "| a | b |",
    "  ",
    "\ufffd\u202e",
    "x" * 100_000,
]


@pytest.fixture(scope="module")
def plan():
    return plan_of(AROUND, stimulus_text("a", "b"), LOOK, PAIRS)


def found_of(plan, *answers):
    return {(own.question.name, own.place): own for own in open_answers(table_of(plan, *answers))}


def test_questions_are_listed_as_they_are_asked_and_scales_and_trials_of_pairs_are_not(plan):
    assert list(found_of(plan)) == [
        ("age", "before all blocks"), ("hand", "before all blocks"), ("note", "after all blocks"),
        ("felt", "look: a, b"), ("which", "look: a, b"), ("felt", "look: b"), ("which", "look: b"),
        ("felt_all", "look"),
    ]  # fmt: skip


def test_numbers_are_summarised_with_those_that_were_left_empty(plan):
    answers = [
        number(code, "before", -1, value, name="age") for code, value in (("P01", 20), ("P02", 31), ("P03", None))
    ]
    (own,) = (found for (name, _), found in found_of(plan, answers).items() if name == "age")
    assert own.summary == "25.5 ± 7.8 (20 to 31), n = 2; 1 left empty"  # sd = 11 / sqrt(2)
    assert found_of(plan, answers[:1])["age", "before all blocks"].summary == "20.0 (20 to 20), n = 1"
    assert found_of(plan, answers[2:])["age", "before all blocks"].summary == "0 answers; 1 left empty"
    assert found_of(plan)["age", "before all blocks"].summary == "0 answers"


def test_numbers_without_measure_are_written_short(plan):
    answers = [number(code, "before", -1, value, name="age") for code, value in (("P01", 1e300), ("P02", 2e300))]
    assert found_of(plan, answers)["age", "before all blocks"].summary == "1.5e+300 ± inf (1e+300 to 2e+300), n = 2"


def test_choices_are_counted_in_the_order_of_the_options_those_of_nobody_too(plan):
    labels = ("left", "right", "both")
    answers = [
        option(code, "before", -1, value, labels, (), name="hand")
        for code, value in (("P01", 1), ("P02", 1), ("P03", 0))
    ]
    assert found_of(plan, answers)["hand", "before all blocks"].summary == "left 1, right 2, both 0"


def test_answers_to_an_exploration_belong_to_its_set(plan):
    answers = [
        text("P01", "look", "felt", "soft", trial=0, stimuli=("a", "b")),
        text("P01", "look", "felt", "hard", trial=1, stimuli=("b",)),
        option("P01", "look", 0, 1, ("a", "b"), ("a", "b"), name="which"), text("P01", "look", "felt_all", "fine"),
        point("P01", "look", "sure", 3, trial=0, stimuli=("a", "b")),
    ]  # fmt: skip
    found = found_of(plan, answers)
    assert found["felt", "look: a, b"].texts == (("P01", "soft"),)
    assert found["felt", "look: b"].texts == (("P01", "hard"),)
    assert found["which", "look: a, b"].summary == "a 0, b 1"
    assert found["which", "look: a, b"].texts == ()
    assert found["felt_all", "look"].texts == (("P01", "fine"),)


@pytest.mark.parametrize("written", HOSTILE, ids=range(len(HOSTILE)))
def test_texts_stay_as_they_were_written(plan, written):
    own = found_of(plan, text("P01", "after", "note", written))["note", "after all blocks"]
    assert own.texts == (("P01", written),)
    assert own.summary == "1 answer"


def test_texts_that_were_left_empty_are_counted_and_not_listed(plan):
    answers = [text(code, "after", "note", value) for code, value in (("P01", None), ("P02", ""), ("P03", "good"))]
    own = found_of(plan, answers)["note", "after all blocks"]
    assert own.summary == "1 answer; 2 left empty"
    assert own.texts == (("P03", "good"),)


def test_the_consent_is_no_open_question(plan):
    consent = option("P01", "before", -1, 1, ("I do not agree", "I agree"), (), name="consent")
    assert all(own.answers == () for own in open_answers(table_of(plan, consent)))
