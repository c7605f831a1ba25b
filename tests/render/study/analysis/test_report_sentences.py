"""Sentences of the report: none says more than its test does, and none contradicts the numbers beside it."""

import numpy as np

from palpate.render.study.analysis.measure_tests import analyse_measure
from palpate.render.study.analysis.measures import Cell, Measure
from palpate.render.study.analysis.report_sections import factor_paragraph


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
