"""Means of measures over cells, where tables of a plan repeat levels, lack factors, or list them in another order."""

import numpy as np

from palpate.render.study.analysis.answer_measures import Cell, Measure


def measure(cells, values):
    values = np.array(values, dtype=float)
    return Measure(
        name="m", title="m", codes=tuple(f"P{k}" for k in range(len(values))), values=values,
        cells=tuple(Cell(name, factors) for name, factors in cells.items()),
    )  # fmt: skip


CROSSED = {
    "a": {"object": "cube", "opacity": 1.0},
    "b": {"object": "cube", "opacity": 0.7},
    "c": {"opacity": 1.0, "object": "tube"},
    "d": {"opacity": 0.7, "object": "tube"},
}


def test_cells_match_whatever_the_order_in_which_their_factors_are_written():
    own = measure(CROSSED, [[1, 2, 3, 4]])
    assert own.cells_at("object", "cube") == {(("opacity", 1.0),): [0], (("opacity", 0.7),): [1]}
    assert own.cells_at("object", "tube") == {(("opacity", 1.0),): [2], (("opacity", 0.7),): [3]}


def test_a_missing_cell_leaves_a_participant_without_a_mean_at_its_levels_alone():
    own = measure(CROSSED, [[1, np.nan, 3, 6]])
    assert np.isnan(own.at_level("object", "cube"))
    assert np.isnan(own.at_level("opacity", 0.7))
    assert np.isnan(own.by_participant())
    assert own.at_level("object", "tube").tolist() == [4.5]
