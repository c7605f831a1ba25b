"""A sweep's table on the disk: other programs read it, its values come back, and what is no table is refused."""

import csv
import io
import math

import numpy as np
import pytest
from disk_faults import file_size_limit
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import table as table_module
from palpate.datasets.sweeps.table import load_table, write_blocks, write_table

COLUMNS = {
    "object": ["tube", "dög, #1", None],
    "seed": [1, 2, 3],
    "step": [None, 0.001, 0.002],
    "count": [1, None, 3],
    "complete": [True, False, True],
    "r": [None, None, None],
    "length": np.array([0.1, 0.2, 0.3], np.float32),
}
TYPES = {"object": "O", "seed": "i8", "step": "f8", "count": "f8", "complete": "?", "r": "f8", "length": "f4"}
BOTH = pytest.mark.parametrize("suffix", [".csv", ".parquet"])


def rows_of(frame):
    """Rows as dictionaries, of whichever library."""
    return frame.to_dicts() if hasattr(frame, "to_dicts") else frame.to_dict("records")


def assert_rows(rows):
    """Rows of COLUMNS, as one of the libraries gives them; a missing text is "", None or NaN."""
    assert list(rows[0]) == list(COLUMNS)
    assert [row["object"] for row in rows][:2] == ["tube", "dög, #1"]
    assert [row["seed"] for row in rows] == [1, 2, 3]
    assert [row["complete"] for row in rows] == [True, False, True]
    np.testing.assert_array_equal(np.array([row["count"] for row in rows], float), [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(np.array([row["step"] for row in rows], float), [np.nan, 0.001, 0.002])
    assert all(row["r"] is None or math.isnan(row["r"]) for row in rows)
    np.testing.assert_array_equal(np.array([row["length"] for row in rows], np.float32), COLUMNS["length"])


@BOTH
def test_values_and_types_come_back(tmp_path, suffix):
    size = write_table(tmp_path / f"t{suffix}", COLUMNS, units={"length": "m"})
    assert size == (tmp_path / f"t{suffix}").stat().st_size
    columns = load_table(tmp_path / f"t{suffix}")
    types = TYPES | ({"length": "f8", "count": "f8"} if suffix == ".csv" else {})
    assert {name: column.dtype for name, column in columns.items()} == {n: np.dtype(t) for n, t in types.items()}
    assert_rows([dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)])
    assert columns["object"][2] == ""


def with_pandas(path):
    pandas = pytest.importorskip("pandas")
    return pandas.read_csv(path) if path.suffix == ".csv" else pandas.read_parquet(path)


def with_polars(path):
    polars = pytest.importorskip("polars")
    return polars.read_csv(path, infer_schema_length=None) if path.suffix == ".csv" else polars.read_parquet(path)


def with_duckdb(path):
    duckdb = pytest.importorskip("duckdb")
    pytest.importorskip("polars")
    return duckdb.sql(f"select * from '{path}'").pl()


def with_dask(path):
    frames = pytest.importorskip("dask.dataframe", exc_type=ImportError)
    return (frames.read_csv(path) if path.suffix == ".csv" else frames.read_parquet(path)).compute()


LIBRARIES = [with_pandas, with_polars, with_duckdb, pytest.param(with_dask, marks=pytest.mark.exhaustive)]


@BOTH
@pytest.mark.filterwarnings("ignore:The inplace keyword")  # Dask calls pandas so
@pytest.mark.parametrize("read", LIBRARIES)
def test_libraries_read_it_in_one_line_without_palpate(tmp_path, suffix, read):
    write_table(tmp_path / f"t{suffix}", COLUMNS)
    assert_rows(rows_of(read(tmp_path / f"t{suffix}")))


@BOTH
def test_constants_are_columns_when_a_table_is_read(tmp_path, suffix):
    constants = {"maker": "me", "speed": 7.0, "object_fit": None, "seed": 3}
    write_table(tmp_path / f"t{suffix}", {"r": [0.1, 0.2]}, constants=constants)
    columns = {name: values.tolist() for name, values in load_table(tmp_path / f"t{suffix}").items()}
    assert np.isnan(columns.pop("object_fit")).all()
    assert columns == {"r": [0.1, 0.2], "maker": ["me"] * 2, "speed": [7.0] * 2, "seed": [3] * 2}
    if suffix == ".csv":
        lines = (tmp_path / "t.csv").read_text().splitlines()
        assert lines[1:] == ['# maker = "me"', "# speed = 7", "# object_fit = null", "# seed = 3", "r", "0.1", "0.2"]


# ---- CSV

FORMULAS = ["=1+1", '=HYPERLINK("http://a")', "+1 m", "-cube", "@SUM(A1)", "\t=1", "\r=1", "'=1", "''@a"]
"""Names of files that spreadsheets take for formulas, by the signs of OWASP's "CSV Injection"; and such in quotes."""


@pytest.mark.parametrize("names", [FORMULAS, ["a=b", "'quoted'", "-5", "cube"]])
def test_no_cell_is_a_formula_and_names_come_back(tmp_path, names):
    path = tmp_path / "t.csv"
    write_table(path, {"object": names, "r": [-1.5] * len(names)})
    assert load_table(path)["object"].tolist() == names
    cells = [name for name, _ in csv.reader(io.StringIO(path.read_bytes().decode(), newline=""))][1:]
    assert len(cells) == len(names)
    assert not [cell for cell in cells if cell[0] in "=+-@\t\r" and cell != "-5"]
    if names is not FORMULAS:
        assert cells == names


HEAD = "# palpate text table 1\n"
NO_TABLES = [
    ("# my table\na,b\n1,2\n", "first line with #"),
    ("# palpate text table 2\na\n1\n", "format version 2"),
    (HEAD + "# seed\na\n1\n", ":2: expected '# name = value'"),
    (HEAD + "# seed = me\na\n1\n", ":2: the value of seed is not JSON"),
    (HEAD + "# seed = [1]\na\n1\n", r":2: seed is \[1\], expected text"),
    (HEAD + "a,b\n1,2\n<<<<<<< mine\n1,3\n", ":4: 1 values, expected 2"),
    ("a,a\n1,2\n", ":1: a column stands there more than once"),
    (HEAD + 'a,b\n1,"2\n', "unexpected end"),
]


@pytest.mark.parametrize(("text", "message"), NO_TABLES, ids=[message for _, message in NO_TABLES])
def test_what_is_no_csv_table_is_refused_with_its_line(tmp_path, text, message):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(SweepStoreError, match=message):
        load_table(tmp_path / "t.csv")


def test_digits_that_are_no_number_stay_text_and_large_numbers_are_floats(tmp_path):
    for key in ("1234567890" * 3 + "12", "1" * 29 + "e12"):
        write_table(tmp_path / "t.csv", {"recipe_hash": [key]})
        assert load_table(tmp_path / "t.csv")["recipe_hash"].tolist() == [key]
    (tmp_path / "t.csv").write_text("a\n99999999999999999999\n1\n")
    assert load_table(tmp_path / "t.csv")["a"].tolist() == [1e20, 1.0]


def test_constants_take_no_more_memory_than_a_file_may(tmp_path, monkeypatch):
    write_table(tmp_path / "t.csv", {"r": np.zeros(5_000)}, constants={f"c{k}": 1 for k in range(100)})
    monkeypatch.setenv("PALPATE_READ_MB", "2")
    with pytest.raises(SweepStoreError, match="constants as columns takes 4000800 bytes"):
        load_table(tmp_path / "t.csv")


# ---- Parquet and files


def block(first, count):
    poses = np.arange(first, first + count)
    return {"recipe": poses // 10, "length": (poses / 7).astype(np.float32), "drawn": poses % 3 > 0}


@settings(max_examples=10)
@given(counts=st.lists(st.integers(0, 30), max_size=8), rows=st.integers(1, 12))
def test_blocks_of_any_size_are_one_table_in_groups_of_at_most_so_many_rows(tmp_path_factory, counts, rows):
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path_factory.mktemp("blocks") / "poses.parquet"
    firsts = np.cumsum([0, *counts])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(table_module, "GROUP_ROWS", rows)
        write_blocks(path, (block(first, count) for first, count in zip(firsts, counts, strict=False)))
    for name, column in block(0, sum(counts)).items() if counts else ():
        loaded = load_table(path)[name]
        assert loaded.dtype == column.dtype
        np.testing.assert_array_equal(loaded, column)
    facts = parquet.ParquetFile(path).metadata
    assert all(facts.row_group(k).num_rows <= rows for k in range(facts.num_row_groups))


def test_what_cannot_be_written_leaves_the_earlier_file(tmp_path):
    pytest.importorskip("pyarrow")

    def mine():
        yield block(0, 150)
        raise KeyError("mine")

    path = tmp_path / "poses.parquet"
    write_blocks(path, [block(0, 10)])
    before = path.read_bytes()
    with pytest.raises(KeyError, match="mine"):
        write_blocks(path, mine())
    for other in ({"a": [1.0]}, {"a": [1], "b": [2]}, {"b": [1]}):
        with pytest.raises(SweepStoreError, match=r"poses\.parquet cannot be written"):
            write_blocks(path, [{"a": [1]}, other])
    random = {"a": np.random.default_rng(0).random(10_000)}
    with file_size_limit(8192), pytest.raises(SweepStoreError, match=r"poses\.parquet cannot be written: .*too large"):
        write_blocks(path, [random])
    assert path.read_bytes() == before
    with file_size_limit(8192), pytest.raises(SweepStoreError, match=r"t\.csv cannot be written: File too large"):
        write_table(tmp_path / "t.csv", random)
    assert [own.name for own in tmp_path.iterdir()] == [path.name]


def test_a_column_of_lists_or_bytes_is_refused_and_a_missing_text_is_empty(tmp_path):
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    for values in (arrow.array([[1], [2]]), arrow.array([b"a", b"b"])):
        parquet.write_table(arrow.table({"name": values}), tmp_path / "t.parquet")
        with pytest.raises(SweepStoreError, match="column name mixes"):
            load_table(tmp_path / "t.parquet")
    parquet.write_table(arrow.table({"name": ["a", None, "b"]}), tmp_path / "t.parquet")
    assert load_table(tmp_path / "t.parquet")["name"].tolist() == ["a", "", "b"]
