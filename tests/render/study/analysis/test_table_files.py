"""Tables as CSV: pandas, polars and the csv module read what was written, whatever people have typed."""

import csv
import io
import math

import numpy as np
import pytest

from palpate.render.errors import RenderError
from palpate.render.study.analysis.result_columns import write_table

TEXTS = ["plain", "a, b", 'she said "no"', "two\nlines", "a\rb", "# none", "", None, "日本語", "a\tb", " a "]
COLUMNS = {
    "code": [f"P{k:02}" for k in range(len(TEXTS))],
    "text": TEXTS,
    "number": [0.1, None, math.nan, 1e300, -0.5, 7.0, 1 / 3, 2.0, 3.0, 4.0, math.inf],
    "count": [*range(10), None],
    "is_practice": [*[True, False] * 5, True],
    "nothing": [None] * 11,
    "level, mixed": ["cube", 0.7, 1.0, *[None] * 8],
}


@pytest.mark.exhaustive
def test_pandas_and_polars_read_it_and_tell_what_is_missing_from_what_is_empty(tmp_path):
    import pandas as pd
    import polars as pl

    write_table(tmp_path / "a.csv", COLUMNS)
    frame = pd.read_csv(tmp_path / "a.csv", keep_default_na=False, na_values={"number": ""})
    assert frame["text"].fillna("").tolist() == [own or "" for own in TEXTS]
    numbers = [None if own is None or math.isnan(own) else own for own in COLUMNS["number"]]
    assert frame["number"].tolist() == pytest.approx([math.nan if n is None else n for n in numbers], nan_ok=True)
    assert frame["is_practice"].tolist() == COLUMNS["is_practice"]
    other = pl.read_csv(tmp_path / "a.csv")
    assert other["text"].to_list() == TEXTS
    assert other["number"].to_list() == numbers
    assert (other["count"].to_list(), other["count"].dtype) == (COLUMNS["count"], pl.Int64)
    assert other["nothing"].to_list() == [None] * 11


def read_rows(path):
    return list(csv.reader(io.StringIO(path.read_bytes().decode(), newline="")))


def test_it_begins_with_its_names_and_holds_every_text(tmp_path):
    path = tmp_path / "answers.csv"
    write_table(path, COLUMNS)
    rows = read_rows(path)
    assert rows[0] == list(COLUMNS)
    assert [row[1] for row in rows[1:]] == [own or "" for own in TEXTS]
    assert [row[2] for row in rows[1:4]] == ["0.1", "", ""]
    assert rows[6][2] == "7"
    assert float(rows[7][2]) == 1 / 3
    assert [row[4] for row in rows[1:3]] == ["TRUE", "FALSE"]  # R 4.2.2 reads true and false as texts
    assert [row[6] for row in rows[1:4]] == ["cube", "0.7", "1"]


GUARDED = {"=1+1": "'=1+1", "@SUM(A1)": "'@SUM(A1)", "-a": "'-a", "\t=a": "'\t=a", "'=a": "''=a"}
PLAIN = {text: text for text in ("-5", "+1e3", "a=1")}


def test_a_text_that_a_spreadsheet_would_compute_is_guarded_also_as_a_name(tmp_path):
    for text, shown in (GUARDED | PLAIN).items():
        write_table(tmp_path / "a.csv", {text: [text, "b"]})
        assert [row[0] for row in read_rows(tmp_path / "a.csv")] == [shown, shown, "b"]


def test_odd_tables_are_written_and_a_folder_that_is_not_there_is_named(tmp_path):
    write_table(tmp_path / "a.csv", {"a\0": ["\0", "\ud800", "x\U0001f600"], "b": np.array([0.5, 1, 2])})
    assert [row[0] for row in read_rows(tmp_path / "a.csv")] == ["a\\x00", "\\x00", "\\ud800", "x\U0001f600"]
    with pytest.raises(RenderError, match=r"gone/a\.csv: cannot be written \(No such file or directory\)"):
        write_table(tmp_path / "gone" / "a.csv", {})
