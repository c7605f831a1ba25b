"""Tables as text: what they hold after reading, what a diff of two shows, and texts that are no tables."""

import csv
import io
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.table import column_units, load_table, table_attributes, write_parquet, write_table
from palpate.datasets.sweeps.table_text import write_csv

TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)
NUMBERS = st.one_of(st.none(), st.integers(-(2**53), 2**53), st.floats(allow_nan=False))
CONSTANTS = st.dictionaries(st.sampled_from(["maker", "speed", "object_fit"]), st.one_of(TEXTS, NUMBERS))
WRITERS = {".csv": write_csv, ".h5": write_table, ".parquet": write_parquet}


def same(one, other):
    """Whether two cells mean the same."""
    is_nothing = [v is None or v == "" or (isinstance(v, float) and math.isnan(v)) for v in (one, other)]
    return all(is_nothing) or one == other


@pytest.mark.exhaustive
@given(rows=st.lists(st.tuples(TEXTS, NUMBERS), min_size=1, max_size=5), constants=CONSTANTS)
def test_what_is_read_is_what_was_written(tmp_path_factory, rows, constants):
    path = tmp_path_factory.mktemp("text") / "t.csv"
    names, numbers = (list(values) for values in zip(*rows, strict=True))
    write_csv(path, {"name": [f"n {name}" for name in names], "number": numbers}, {"constants": constants})
    columns = load_table(path)
    assert columns["name"].tolist() == [f"n {name}" for name in names]
    assert all(map(same, columns["number"].tolist(), numbers))
    assert all(same(json.loads(table_attributes(path)["constants"])[name], value) for name, value in constants.items())
    whole = load_table(path, constants=True)
    assert set(whole) == {"name", "number", *constants}
    assert all(same(whole[name][-1], value) for name, value in constants.items())


FORMULAS = ["=1+1", '=HYPERLINK("http://a")', "+1 m", "-cube", "@SUM(A1)", "\t=1", "\r=1", "'=1", "''@a"]
"""Names of files that spreadsheets take for formulas, by the signs of OWASP's "CSV Injection"; and such in quotes."""


@pytest.mark.parametrize("names", [FORMULAS, ["a=b", "'quoted'", "-5", "cube"]])
def test_no_cell_is_a_formula_and_names_come_back(tmp_path, names):
    path = tmp_path / "t.csv"
    write_csv(path, {"object": names, "r": [-1.5] * len(names)}, {})
    assert load_table(path)["object"].tolist() == names
    rows = list(csv.reader(io.StringIO(path.read_bytes().decode(), newline="")))[2:]
    cells = [name for name, number in rows if number == "-1.5"]
    assert len(cells) == len(names)
    assert not [cell for cell in cells if cell[0] in "=+-@\t\r" and cell != "-5"]
    if names is not FORMULAS:
        assert cells == names


@pytest.mark.parametrize("suffix", WRITERS)
def test_constants_are_columns_only_if_asked_for(tmp_path, suffix):
    path = tmp_path / f"t{suffix}"
    constants = {"maker": "me", "speed": 7.0, "object_fit": None, "seed": 3}
    WRITERS[suffix](path, {"length_mean": [0.1, 0.2, 0.3]}, {"constants": constants}, units={"length_mean": "m"})
    assert list(load_table(path)) == ["length_mean"]
    columns = load_table(path, constants=True)
    assert {name: values.tolist() for name, values in columns.items() if name != "object_fit"} == {
        "length_mean": [0.1, 0.2, 0.3], "maker": ["me"] * 3, "speed": [7.0] * 3, "seed": [3] * 3,
    }  # fmt: skip
    assert np.isnan(columns["object_fit"]).all()
    assert json.loads(table_attributes(path)["constants"]) == constants
    assert column_units(path) == ({} if suffix == ".csv" else {"length_mean": "m"})


@pytest.mark.exhaustive
@given(st.lists(st.floats(allow_nan=False), min_size=2, max_size=6, unique=True), st.data())
def test_one_number_that_moves_changes_one_line(tmp_path_factory, numbers, data):
    path = tmp_path_factory.mktemp("text") / "t.csv"
    lines = []
    row = data.draw(st.integers(0, len(numbers) - 1))
    for k in range(2):
        write_csv(path, {"r": numbers, "name": ["a, b"] * len(numbers)}, {})
        lines.append(path.read_text().splitlines())
        numbers[row] = math.nextafter(numbers[row], 0.0 if numbers[row] else 1.0)
        assert len(lines[k]) == 2 + len(numbers)
    changed = [k for k, (one, other) in enumerate(zip(*lines, strict=True)) if one != other]
    assert changed == [2 + row]


def test_pandas_reads_it_without_palpate(tmp_path):
    import pandas as pd

    names = ["#1", 'a "b", c', "two\nlines", "cr\rhere"]
    write_csv(tmp_path / "t.csv", {"name": names, "r": [1.5, None, 3.0, 4.0]}, {"constants": {"maker": "me"}})
    frame = pd.read_csv(tmp_path / "t.csv", comment="#", lineterminator="\n")
    assert frame["name"].tolist() == names
    assert frame["r"].tolist() == pytest.approx([1.5, math.nan, 3.0, 4.0], nan_ok=True)


HEAD = "# palpate text table 1\n"
NO_TABLES = [
    ("", "first line"),
    ("a,b\n1,2\n", "first line"),
    ("# palpate text table 2\na\n1\n", "format version 2"),
    (HEAD + "# seed\na\n1\n", ":2: expected '# name = value'"),
    (HEAD + "# seed = me\na\n1\n", ":2: the value of seed is not JSON"),
    (HEAD + "# seed = [1]\na\n1\n", "constant seed is \\[1\\]"),
    (HEAD + "a,b\n1,2\n<<<<<<< mine\n1,3\n", ":4: 1 values, expected 2"),
    (HEAD + "a,a\n1,2\n", ":2: a column stands there more than once"),
    (HEAD + 'a,b\n1,"2\n', "unexpected end"),
    (HEAD + "a/b\n1\n", "cannot name a column"),
    (HEAD + "a\n99999999999999999999\n1\n", ""),
]


@pytest.mark.parametrize(("text", "message"), NO_TABLES, ids=[message or "large" for _, message in NO_TABLES])
def test_what_is_no_table_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "t.csv"
    path.write_text(text)
    if message:
        with pytest.raises(SweepStoreError, match=message):
            load_table(path)
    else:
        assert load_table(path)["a"].tolist() == [1e20, 1.0]


def test_a_hash_of_decimal_digits_stays_a_text(tmp_path):
    for key in ("1234567890" * 3 + "12", "1" * 29 + "e12"):
        write_csv(tmp_path / "t.csv", {"recipe_hash": [key]}, {})
        assert load_table(tmp_path / "t.csv")["recipe_hash"].tolist() == [key]


@given(st.one_of(st.text('#= ,"a1.e-\n\r{[', max_size=40).map(str.encode), st.binary(max_size=40)))
def test_any_bytes_are_a_table_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("text") / "t.csv"
    path.write_bytes(HEAD.encode() + content)
    rows, refusal = _rows_of(path)
    assert str(path) in refusal if refusal else len(rows) <= 1


def _rows_of(path):
    """Lengths of the columns of a table, or the message of its refusal."""
    try:
        return {len(values) for values in load_table(path, constants=True).values()}, ""
    except SweepStoreError as error:
        return set(), str(error)


def test_constants_of_other_kinds_are_refused(tmp_path):
    for value, message in (("[1]", "expected an object"), ("{", "not JSON"), ('{"a": {}}', "constant a is")):
        write_table(tmp_path / "t.h5", {"r": [1.0]}, {"constants": value})
        with pytest.raises(SweepStoreError, match=message):
            load_table(tmp_path / "t.h5", constants=True)
        assert list(load_table(tmp_path / "t.h5")) == ["r"]


def test_constants_take_no_more_memory_than_a_file_may(tmp_path, monkeypatch):
    write_table(tmp_path / "t.h5", {"r": np.zeros(20_000)}, {"constants": {f"c{k}": 1 for k in range(100)}})
    monkeypatch.setenv("PALPATE_READ_MB", "1")
    with pytest.raises(SweepStoreError, match="constants as columns takes 16000000 bytes"):
        load_table(tmp_path / "t.h5", constants=True)
