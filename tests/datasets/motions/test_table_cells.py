"""Separators and decimal commas of spreadsheets' CSV files."""

import pytest

from palpate.datasets.motions.table_cells import number_in, separator_of


@pytest.mark.parametrize(
    ("header", "separator"),
    [("time,x", ","), ("time;x;y", ";"), ("time\tx", "\t"), ("time,\tx,\ty", ","), ("x", ","), ("", ",")],
)
def test_the_header_shows_what_separates_cells(header, separator):
    assert separator_of(header) == separator


@pytest.mark.parametrize(
    ("cell", "separator", "value"),
    [("0.5", ",", 0.5), ("0,5", ";", 0.5), ("0.5", ";", 0.5), ("-1,25e-3", "\t", -1.25e-3), (" 7 ", ";", 7.0)],
)
def test_a_comma_that_separates_no_cells_is_a_decimal_comma(cell, separator, value):
    assert number_in(cell, separator) == value


@pytest.mark.parametrize(("cell", "separator"), [("0,5", ","), ("1.000,5", ";"), ("1_0", ","), ("", ";"), ("a", ";")])
def test_other_cells_are_no_numbers(cell, separator):
    with pytest.raises(ValueError, match=r"could not convert|1_0"):
        number_in(cell, separator)
