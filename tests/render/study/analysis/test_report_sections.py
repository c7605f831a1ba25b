"""The report's sections: what they say of tables whose answers are known, for every design."""

import pytest
from answered_tables import PAPER
from simulated_participants import ObservedTables
from study_observers import Observer, paper_observers
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
