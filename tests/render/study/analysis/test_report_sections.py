"""The report's sections: what they say of tables whose answers are known, for every design."""

import json

import pytest
from answered_tables import PAPER, paper_answers, plan_of, table_of
from simulated_participants import ObservedTables
from study_observers import Observer, null_observers, paper_observers
from written_plans import EVERY_DESIGN

from palpate.render.reports.report_pages import html_page, markdown_page
from palpate.render.study.analysis.report_sections import ASSUMED_HEAD, ASSUMPTIONS, report_sections
from palpate.render.study.analysis.study_analysis import analyse_answers
from palpate.render.study.plan.study_reading import read_stored_study

SIZES = {f"{size} cm": size / 2 for size in (4, 6, 8, 10)}


@pytest.fixture(autouse=True)
def without_pictures(monkeypatch):
    """Pictures have tests of their own, and take most of the time."""
    names = (
        "draw_measure",
        "draw_participants",
        "draw_scale",
        "draw_psychometric",
        "draw_staircases",
        "draw_magnitudes",
    )
    for name in names:
        monkeypatch.setattr(f"palpate.render.study.analysis.report_sections.{name}", lambda *_, **__: None)


@pytest.fixture(scope="module")
def paper():
    plan = read_stored_study(PAPER.replace("participants = 3", "participants = 18"), "paper.toml")
    return ObservedTables(plan)


def sections_of(table):
    return {own.title: own for own in report_sections(analyse_answers(table))}


def test_the_papers_study_has_a_section_for_each_of_its_results(paper):
    found = sections_of(paper.table(paper_observers(18)))
    assert list(found) == [
        "Participants and data", "Choices: p_cc", "Ratio r", "Confidence", "Difficulty", "What the tests assume",
    ]  # fmt: skip
    text = found["Choices: p_cc"].text
    assert "6 cells of 18 participants with 10 answers each" in text
    for words in (
        "By object: cube: ",
        "By opacity: opacity 1: ",
        "there are subgroups, or each has a tendency of their own",
        "five sixths of their cells",
    ):
        assert words in text
    assert "r is higher for cube than for tube (V = " in found["Ratio r"].text
    tables = [own.title for own in found["Choices: p_cc"].tables]
    assert tables == [
        "p_cc of participants", "Tests: a participant is one observation",
        "For comparison, as in the founding paper: each cell of a participant is an observation",
        "Participants, by exact binomial tests of all answers",
    ]  # fmt: skip


def test_people_who_feel_nothing_are_reported_as_that(paper):
    text = sections_of(paper.table(null_observers(18, seed=5)))["Choices: p_cc"].text
    assert "No difference of p_cc from chance (0.5) was found" in text
    assert "No difference between participants beyond chance was found" in text


def test_what_is_odd_stands_in_the_first_section_and_is_kept(paper):
    people = [Observer(seed=1, strengths=paper_observers(1)[0].strengths, habit="ArrowLeft"), *paper_observers(3)]
    section = sections_of(paper.table(people))["Participants and data"]
    rows = json.dumps([list(row) for table in section.tables for row in table.rows])
    assert "P01 always pressed the key 'ArrowLeft', in 60 answers" in rows
    assert section.text.startswith("4 of 18 participants have taken part; 4 have answered everything.")


@pytest.mark.exhaustive
def test_every_design_has_its_section_and_both_pages_are_made_of_them():
    plan = read_stored_study(EVERY_DESIGN, "all.toml")
    people = [Observer(seed=1, strengths=SIZES, age=30)]
    sections = report_sections(analyse_answers(ObservedTables(plan).table(people)))
    titles = [own.title for own in sections]
    for title in (
        "Choices: p_second", "Thresholds: constant", "Thresholds: staircase",
        "Point of subjective equality", "Just noticeable difference", "Threshold by staircase of yes and no",
        "Magnitudes: magnitude", "Exponent of the power law", "Rough", "Hard",
    ):  # fmt: skip
        assert title in titles
    for page in (html_page("All", "", sections, ""), markdown_page("All", "", sections, "")):
        for words in ("cumulative Gaussian", "exponent of the power law", "mean of reversals", "What was it?"):
            assert words in " ".join(page.split())
        assert " nan" not in page
        assert "None" not in page


def test_a_study_without_answers_has_a_report():
    table = ObservedTables(plan_of(PAPER.partition("[[stimulus]]")[1] + PAPER.partition("[[stimulus]]")[2])).table([])
    found = sections_of(table)
    assert found["Participants and data"].text.startswith("0 of 3 participants have taken part")
    assert "cannot be tested" in found["Choices: p_cc"].text


def test_each_test_that_a_report_names_has_its_assumptions(paper):
    named = {own[0] for own in ASSUMPTIONS}
    assert all(len(own) == len(ASSUMED_HEAD) for own in ASSUMPTIONS)
    analysis = analyse_answers(paper.table(paper_observers(18)))
    tests = {
        test.test
        for own in analysis.tests
        for test in (
            own.normality, own.chance_by_ranks, own.chance_by_means, own.heterogeneity,
            *(one for factor in own.factors for one in (factor.omnibus, *factor.by_ranks, *factor.by_means)),
            *(one.binomial for one in own.tendencies),
        )
        if test is not None
    }  # fmt: skip
    for test in tests:
        assert any(name in test for name in named), test


ROW = "1111100000 4 4"


def report_of(count, unfinished=()):
    plan = plan_of(PAPER.replace("participants = 3", "participants = 8"))
    answers = [paper_answers(code, [ROW] * 6) for code in plan.codes[:count]]
    return report_sections(analyse_answers(table_of(plan, *answers, unfinished=unfinished)))


def test_a_report_of_one_participant_is_in_the_singular_and_says_that_nothing_can_be_found():
    first, choices = report_of(1, unfinished=["P01"])[:2]
    assert first.text.startswith("1 of 8 participants has taken part; 0 have answered everything. ")
    assert "Fewer than 6 participants have taken part: whatever they answered, no p" in first.text
    assert "6 cells of 1 participant with 10 answers each." in choices.text
    groups = "0 of 1 participant have five sixths of their cells at chance or above, 0 at chance or below, and 1 is"
    assert f"{groups} ambiguous." in choices.text  # each cell is at chance, and so on both sides


def test_six_participants_are_enough_for_a_report_without_that_warning():
    first = report_of(6)[0]
    assert first.text.startswith("6 of 8 participants have taken part; 6 have answered everything. ")
    assert "Fewer than" not in first.text
