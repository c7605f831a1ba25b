"""Sentences of the report: none says more than its test does, and none contradicts the numbers beside it."""

import numpy as np
from answered_tables import plan_of, stimulus_text, table_of

from palpate.render.study.analysis.answer_measures import Cell, Measure, choice_measures
from palpate.render.study.analysis.measure_tests import analyse_measure
from palpate.render.study.analysis.report_sections import asked_text, factor_paragraph


def paragraph_of(values, cells):
    """What the report says of objects. cells: of each the object and the opacity."""
    found = tuple(Cell(f"{one}-{other}", {"object": one, "opacity": other}) for one, other in cells)
    measure = Measure(name="ease", title="ease", codes=tuple(map(str, range(len(values)))), cells=found, values=values)
    return factor_paragraph(measure, analyse_measure(measure).factors[0])


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
