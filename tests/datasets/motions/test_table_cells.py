"""Separators and decimal commas of spreadsheets' CSV files."""

import pytest

from palpate.datasets.motions.table_cells import cells_of, header_of, not_utf8, number_in, separator_of


@pytest.mark.parametrize(
    ("header", "separator"),
    [("time,x", ","), ("time;x;y", ";"), ("time\tx", "\t"), ("time,\tx,\ty", ","), ("x", ","), ("", ",")],
)
def test_the_header_shows_what_separates_cells(header, separator):
    assert separator_of(header) == separator


@pytest.mark.parametrize(
    ("cell", "separator", "value"),
    [
        ("0.5", ",", 0.5),
        ("0,5", ";", 0.5),
        ("0.5", ";", 0.5),
        ("-1,25e-3", "\t", -1.25e-3),
        (" 7 ", ";", 7.0),
        ("0,5", ",", 0.5),
        ("0,123", ",", 0.123),
        ("1,000", ";", 1.0),
    ],
)
def test_a_comma_in_a_cell_is_a_decimal_comma(cell, separator, value):
    assert number_in(cell, separator) == value


@pytest.mark.parametrize(
    ("cell", "separator"),
    [("1,000", ","), ("-12,345,678", ","), ("0,5,5", ","), ("1.000,5", ";"), ("1_0", ","), ("", ";"), ("a", ";")],
)
def test_other_cells_are_no_numbers(cell, separator):
    with pytest.raises(ValueError, match=r"could not convert|1_0|1,000|-12,345,678"):
        number_in(cell, separator)


@pytest.mark.parametrize(
    ("text", "header"),
    [
        ("sep=;\ntime;x\n1;2\n", ("time;x\n", ";", 2)),
        ("SEP=,\r\nt;,x;\r\n", ("t;,x;\r\n", ",", 2)),
        ('"sep=\t"\na;b\tc\n', ("a;b\tc\n", "\t", 2)),
        ("# by a tracker; with; marks\n\n#\ntime,x\n", ("time,x\n", ",", 4)),
        ("sep=|\n", ("sep=|\n", ",", 1)),
        ("# nothing\n\n", ("", ",", 0)),
    ],
)
def test_a_header_is_below_what_states_the_separator_and_comments(text, header):
    lines = iter(text.splitlines(keepends=True))
    assert header_of(lines) == header
    assert list(lines) == text.splitlines(keepends=True)[header[2] or 99 :]


def test_cells_are_taken_out_of_quotes_which_close_on_their_line():
    assert cells_of('"0,1", 2,"say ""a"""\n', ",") == ["0,1", "2", 'say "a"']
    with pytest.raises(ValueError, match="quotes are not closed"):
        cells_of('1,"a\n', ",")


def test_bytes_that_are_not_utf8_are_named_with_what_a_spreadsheet_calls_utf8():
    assert not_utf8("time".encode("utf-16")).startswith("byte 0 is not UTF-8 text, but UTF-16: save it as UTF-8")
    assert not_utf8(b"x" * 9000 + "\u00e9".encode("cp1252")).startswith("byte 9000 is not UTF-8 text: save it as UTF-8")
