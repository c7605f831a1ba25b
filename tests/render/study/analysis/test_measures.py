"""Means of measures over cells, where tables of a plan repeat levels, lack factors, or list them in another order."""

import numpy as np
import pytest

from palpate.render.study.analysis.measures import Cell, Measure, cell_text, level_text


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


def test_levels_come_in_the_order_of_the_cells():
    assert measure(CROSSED, [[1, 2, 3, 4]]).factors == {"object": ("cube", "tube"), "opacity": (1.0, 0.7)}


def test_a_factor_that_has_one_level_only_is_none():
    assert measure(
        {"a": {"object": "cube", "hand": "left"}, "b": {"object": "tube", "hand": "left"}}, [[1, 2]]
    ).factors == {"object": ("cube", "tube")}


def test_cells_match_whatever_the_order_in_which_their_factors_are_written():
    own = measure(CROSSED, [[1, 2, 3, 4]])
    assert own.cells_at("object", "cube") == {(("opacity", 1.0),): [0], (("opacity", 0.7),): [1]}
    assert own.cells_at("object", "tube") == {(("opacity", 1.0),): [2], (("opacity", 0.7),): [3]}


def test_means_of_a_level_are_over_its_cells():
    own = measure(CROSSED, [[1, 2, 3, 6], [5, 5, 5, 5]])
    assert own.at_level("object", "cube").tolist() == [1.5, 5]  # (1 + 2) / 2
    assert own.at_level("opacity", 0.7).tolist() == [4, 5]  # (2 + 6) / 2
    assert own.by_participant().tolist() == [3, 5]  # (1 + 2 + 3 + 6) / 4


def test_two_cells_with_the_same_levels_count_both():
    own = measure(
        {"easy cube": {"object": "cube"}, "hard cube": {"object": "cube"}, "tube": {"object": "tube"}}, [[2, 6, 1]]
    )
    assert own.cells_at("object", "cube") == {(): [0, 1]}
    assert own.at_level("object", "cube").tolist() == [4]


def test_a_cell_without_the_factor_is_at_none_of_its_levels():
    own = measure({"a": {"object": "cube"}, "b": {"object": "tube"}, "c": {"block": "c"}}, [[1, 2, 9]])
    assert own.factors == {"object": ("cube", "tube")}
    assert own.at_level("object", "tube").tolist() == [2]


def test_a_missing_cell_leaves_a_participant_without_a_mean_at_its_levels_alone():
    own = measure(CROSSED, [[1, np.nan, 3, 6]])
    assert np.isnan(own.at_level("object", "cube"))
    assert np.isnan(own.at_level("opacity", 0.7))
    assert np.isnan(own.by_participant())
    assert own.at_level("object", "tube").tolist() == [4.5]


def test_nobody_has_no_mean_and_no_warning():
    own = measure(CROSSED, np.zeros((0, 4)))
    assert own.at_level("object", "cube").shape == own.by_participant().shape == (0,)


@pytest.mark.parametrize(("level", "text"), [(0.7, "0.7"), (1.0, "1"), (-2, "-2"), ("cc", "cc"), ("", "")])
def test_levels_are_written_as_people_read_them(level, text):
    assert level_text(level) == text


def test_cells_are_called_by_their_levels_or_else_by_their_name():
    assert cell_text(Cell("cube-0.7", {"object": "cube", "opacity": 0.7})) == "cube, 0.7"
    assert cell_text(Cell("pilot", {})) == "pilot"
