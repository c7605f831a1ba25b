"""Sections of a report: their sentences, without the pictures, whose drawing has tests of its own."""

import numpy as np
import pytest
from answered_tables import PAPER, paper_answers, plan_of, table_of

from palpate.render.study.analysis import report_sections as sections
from palpate.render.study.analysis.result_texts import all_tests
from palpate.render.study.analysis.study_analysis import analyse_answers

ROW = "1111100000 4 4"


@pytest.fixture
def drawn(monkeypatch):
    """Nothing: each picture takes a third of a second."""
    for name in [own for own in vars(sections) if own.startswith("draw_")]:
        monkeypatch.setattr(sections, name, lambda *values, **options: None)


def report_of(count, unfinished=()):
    plan = plan_of(PAPER.replace("participants = 3", "participants = 8"))
    answers = [paper_answers(code, [ROW] * 6) for code in plan.codes[:count]]
    return sections.report_sections(analyse_answers(table_of(plan, *answers, unfinished=unfinished)))


def test_a_report_of_one_participant_is_in_the_singular_and_says_that_nothing_can_be_found(drawn):
    first, choices = report_of(1, unfinished=["P01"])[:2]
    assert first.text.startswith("1 of 8 participants has taken part; 0 have answered everything. ")
    assert "Fewer than 6 participants have taken part: whatever they answered, no p" in first.text
    assert "6 cells of 1 participant with 10 answers each." in choices.text
    groups = (
        "0 participants have five sixths of their cells at chance or above, 0 at chance or below, and 1 is ambiguous."
    )
    assert groups in choices.text  # each cell is at chance, and so on both sides


def test_six_participants_are_enough_for_a_report_without_that_warning(drawn):
    first = report_of(6)[0]
    assert first.text.startswith("6 of 8 participants have taken part; 6 have answered everything. ")
    assert "Fewer than" not in first.text


def test_every_test_of_a_report_has_a_row_that_says_what_it_assumes(drawn):
    plan = plan_of(PAPER.replace("participants = 3", "participants = 8"))
    rng = np.random.default_rng(1)
    rows = ["".join(map(str, rng.integers(0, 2, 10))) + f" {1 + k % 7} {7 - k % 5}" for k in range(48)]
    answers = [paper_answers(code, rows[6 * k : 6 * k + 6]) for k, code in enumerate(plan.codes)]
    analysis = analyse_answers(table_of(plan, *answers))
    known = tuple(name for name, *_ in sections.ASSUMPTIONS)
    made = {own.test for tests in analysis.tests for *_, own in all_tests(tests)}
    assert len(made) == 7
    assert [name for name in made if not name.endswith(known)] == []
