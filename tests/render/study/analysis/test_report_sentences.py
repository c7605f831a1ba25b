"""Sentences of the report: none says more than its test does, and none contradicts the numbers beside it."""

import numpy as np
import pytest
from answered_tables import QUESTION, levels_text, plan_of, stimulus_text, table_of

from palpate.render.study.analysis.answer_measures import choice_measures
from palpate.render.study.analysis.level_answers import LevelAnswers
from palpate.render.study.analysis.measure_tests import AGAINST, FOR, analyse_measure
from palpate.render.study.analysis.measures import Cell, Measure
from palpate.render.study.analysis.psychometric_fit import fit_psychometric
from palpate.render.study.analysis.report_sections import ASSUMPTIONS, asked_text, factor_paragraph, threshold_doubts
from palpate.render.study.analysis.study_analysis import FittedLevels


def paragraph_of(values, cells):
    """What the report says of objects. cells: of each the object and the opacity."""
    found = tuple(Cell(f"{one}-{other}", {"object": one, "opacity": other}) for one, other in cells)
    measure = Measure(name="ease", title="ease", codes=tuple(map(str, range(len(values)))), cells=found, values=values)
    return factor_paragraph(measure, analyse_measure(measure).factors[0])


def test_levels_that_cannot_be_compared_are_not_said_to_be_alike():
    text = paragraph_of(np.full((9, 3), 4.0), (("cube", 1.0), ("tube", 1.0), ("dog", 1.0)))
    assert "Whether any level differs cannot be tested (Friedman test: each participant has the same value" in text


def test_means_over_different_cells_are_not_to_be_compared():
    values = np.random.default_rng(3).normal([4.0, 2.0, 9.0], 0.5, (12, 3))
    text = paragraph_of(values, (("cube", 1.0), ("tube", 1.0), ("tube", 0.7)))
    assert "do not compare these means" in text
    assert "ease is higher for cube than for tube" in text
    assert "do not compare" not in paragraph_of(values[:, :2], (("cube", 1.0), ("tube", 1.0)))


def test_a_measure_of_different_questions_says_so():
    def text_of(*questions):
        blocks = [
            f'[[block]]\nname = "b{k}"\ndesign = "2ifc"\npairs = [["a", "b"]]\nquestion = "{own}"\n'
            for k, own in enumerate(questions)
        ]
        plan = plan_of(stimulus_text("a", "b"), *blocks)
        (measure,) = choice_measures(table_of(plan))
        return asked_text(measure, plan)

    assert text_of("Denser?", "Denser?") == ""
    assert text_of("Denser?", "Smoother?").startswith(" Its blocks ask 2 different questions")


def test_means_that_contradict_what_ranks_find_are_named():
    values = np.array([[4.0 + 0.01 * k, 3.9] for k in range(16)] + [[1.0, 6.9], [1.0, 6.8]])
    text = paragraph_of(values, (("cube", 1.0), ("tube", 1.0)))
    assert values[:, 0].mean() < values[:, 1].mean()
    assert "ease is higher for cube than for tube" in text
    assert text.endswith("The mean of cube - tube has the other sign: few far values move a mean more than ranks.")
    assert "other sign" not in paragraph_of(values[:16], (("cube", 1.0), ("tube", 1.0)))


@pytest.mark.exhaustive
def test_of_people_who_answer_at_random_the_papers_rule_calls_as_many_for_as_the_report_says():
    successes = np.random.default_rng(7).binomial(10, 0.5, (200, 6))
    measure = Measure(
        name="p", title="p", codes=tuple(map(str, range(200))), chance=0.5, values=successes / 10,
        cells=tuple(Cell(str(k), {"block": str(k)}) for k in range(6)), successes=successes,
        counts=np.full((200, 6), 10),
    )  # fmt: skip
    found = [own.tendency for own in analyse_measure(measure).tendencies]
    said = next(how for name, _, how in ASSUMPTIONS if name == "tendency of a participant")
    for name in (FOR, AGAINST):
        assert found.count(name) / 200 == pytest.approx(0.25, abs=0.08)
        assert f"25 % `{name}`" in said


def fits_of(**shares):
    """Fits of participants of whom so many of 10 answers to each of four levels were yes."""
    block = '[[block]]\nname = "x"\ndesign = "constant"\ncomparisons = ["s1", "s2"]\noptions = ["no", "yes"]\n'
    (planned,) = plan_of(levels_text([1, 2]), block + QUESTION).blocks
    x, counts = np.arange(1.0, 5.0), np.full(4, 10)
    return [
        FittedLevels(
            answers=LevelAnswers(
                code=code, block=planned, x=x, successes=np.array(own), counts=counts, guess=0.0,
                lapses_both_ways=False, counted="yes",
            ),
            fit=fit_psychometric(x, np.array(own), counts, with_intervals=False),
        )
        for code, own in shares.items()
    ]  # fmt: skip


@pytest.mark.exhaustive
def test_thresholds_that_are_doubtful_are_counted_where_they_are_compared():
    text = threshold_doubts(
        fits_of(P01=[1, 3, 7, 9], P02=[9, 7, 3, 1], P03=[0, 0, 10, 10], P04=[10] * 4, P05=[0, 0, 1, 3])
    )
    assert text.startswith(
        "Of 5 fits 1 have no threshold and lack here; 1 have a threshold outside the levels and lack here, too; "
        "1 are steps, which count "
        "with a JND of 0; 1 fall with the value where others rise (P02 in x): "
    )
    assert threshold_doubts(fits_of(P01=[1, 3, 7, 9], P02=[2, 4, 6, 8])) == ""
    assert threshold_doubts(fits_of(P01=[9, 7, 3, 1])) == ""
