"""Tables as files: pandas, polars and the csv module read what was written, whatever people have typed."""

import csv
import io
import math

import numpy as np
import pytest

from palpate.render.errors import RenderError
from palpate.render.study.analysis import table_files
from palpate.render.study.analysis.table_files import write_tables

TEXTS = [
    "plain",
    "a, b",
    'she said "no"',
    "two\nlines",
    "two\r\nlines",
    "a\rb",
    "# none",
    "",
    None,
    "日本語",
    "a\tb",
    " a ",
]
COLUMNS = {
    "code": [f"P{k:02}" for k in range(len(TEXTS))],
    "text": TEXTS,
    "number": [0.1, None, math.nan, 1e300, -0.5, 7.0, 1 / 3, 2.0, 3.0, 4.0, 5.0, math.inf],
    "count": [*range(11), None],
    "is_practice": [True, False] * 6,
    "nothing": [None] * 12,
    "level, mixed": ["cube", 0.7, 1.0, *[None] * 9],
}


@pytest.mark.exhaustive
def test_pandas_reads_both_files(tmp_path):
    import pandas as pd

    csv_file, parquet_file = write_tables(tmp_path, "answers", COLUMNS)
    for frame in (
        pd.read_csv(csv_file, keep_default_na=False, na_values={"number": ""}),
        pd.read_parquet(parquet_file),
    ):
        assert list(frame.columns) == list(COLUMNS)
        assert frame["text"].fillna("").tolist() == [own or "" for own in TEXTS]
        assert frame["number"].tolist() == pytest.approx(
            [math.nan if own is None else own for own in COLUMNS["number"]], nan_ok=True
        )
        assert frame["is_practice"].tolist() == COLUMNS["is_practice"]
        assert frame["level, mixed"].fillna("").tolist()[:4] == ["cube", "0.7", "1", ""]


@pytest.mark.exhaustive
def test_polars_reads_both_files_and_tells_what_is_missing_from_what_is_empty(tmp_path):
    import polars as pl

    csv_file, parquet_file = write_tables(tmp_path, "answers", COLUMNS)
    for frame in (pl.read_csv(csv_file), pl.read_parquet(parquet_file)):
        assert frame["text"].to_list() == TEXTS
        assert frame["number"].to_list() == [
            None if own is None or math.isnan(own) else own for own in COLUMNS["number"]
        ]
        assert frame["count"].to_list() == COLUMNS["count"]
        assert frame["count"].dtype == pl.Int64
        assert frame["is_practice"].dtype == pl.Boolean
        assert frame["nothing"].to_list() == [None] * 12


def read_rows(path):
    return list(csv.reader(io.StringIO(path.read_bytes().decode(), newline="")))


def test_a_csv_begins_with_its_names_and_holds_every_text(tmp_path, monkeypatch):
    monkeypatch.setattr(table_files, "find_spec", lambda name: None)
    (path,) = write_tables(tmp_path, "answers", COLUMNS)
    assert path.name == "answers.csv"
    rows = read_rows(path)
    assert rows[0] == list(COLUMNS)
    assert [row[1] for row in rows[1:]] == [own or "" for own in TEXTS]
    assert [row[2] for row in rows[1:4]] == ["0.1", "", ""]
    assert rows[6][2] == "7"
    assert float(rows[7][2]) == 1 / 3
    assert [row[4] for row in rows[1:3]] == ["TRUE", "FALSE"]  # R 4.2.2 reads true and false as texts
    assert path.read_bytes()[-1:] == b"\n"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("=1+1", "'=1+1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("+a", "'+a"),
        ("-a", "'-a"),
        ("\t=a", "'\t=a"),
        ("\r=a", "'\r=a"),
        ("'=a", "''=a"),
        ("-5", "-5"),
        ("+1e3", "+1e3"),
        ("a=1", "a=1"),
    ],
)
def test_a_text_that_a_spreadsheet_would_compute_is_guarded_also_as_a_name(tmp_path, monkeypatch, text, shown):
    monkeypatch.setattr(table_files, "find_spec", lambda name: None)
    (path,) = write_tables(tmp_path, "a", {text: [text, "b"]})
    assert [row[0] for row in read_rows(path)] == [shown, shown, "b"]


@pytest.mark.exhaustive
def test_parquet_holds_texts_as_they_are_types_and_units(tmp_path):
    from pyarrow import parquet

    columns = {"text": ["=1+1", None], "seconds": [1, None], "r": [1, 2.5], "big": [1 << 70, 1], "n": np.array([1, 2])}
    _, path = write_tables(tmp_path, "a", columns, units={"seconds": "s"})
    table = parquet.read_table(path)
    assert table["text"].to_pylist() == ["=1+1", None]
    assert [str(own.type) for own in table.schema] == ["string", "int64", "double", "double", "int64"]
    assert table.schema.field("seconds").metadata == {b"units": b"s"}
    assert table.schema.field("r").metadata is None


@pytest.mark.exhaustive
@pytest.mark.parametrize("columns", [{}, {"a": []}, {"a": ["\0", "\ud800", "x\U0001f600"]}, {"a\0": [np.float32(0.5)]}])
def test_odd_tables_are_written(tmp_path, columns):
    from pyarrow import parquet

    csv_file, parquet_file = write_tables(tmp_path, "a", columns)
    assert parquet.read_table(parquet_file).num_columns == len(columns)
    assert len(read_rows(csv_file)[0]) == len(columns)
    if columns and (shown := next(iter(columns.values()))) and isinstance(shown[0], str):
        assert [row[0] for row in read_rows(csv_file)[1:]] == ["\\x00", "\\ud800", "x\U0001f600"]


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RenderError, match=r"gone/a\.csv: cannot be written \(No such file or directory\)"):
        write_tables(tmp_path / "gone", "a", {})
