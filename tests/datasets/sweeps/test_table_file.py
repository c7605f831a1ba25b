"""A sweep's table on the disk: pandas, polars and xarray read it in one line, with its types, units and attributes."""

import importlib
import json

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from old_pose_table import write_old_table
from sweep_store_rows import file_size_limit

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import table as table_module
from palpate.datasets.sweeps.table import column_units, load_table, table_attributes, write_parquet, write_table

COLUMNS = {
    "object": ["tube", "dög", None],
    "seed": [1, 2, 3],
    "step": [None, 0.001, 0.002],
    "count": [1, None, 3],
    "complete": [True, False, True],
    "r": [None, None, None],
    "length": np.array([0.1, 0.2, 0.3], np.float32),
}
TYPES = {"object": "O", "seed": "i8", "step": "f8", "count": "f8", "complete": "?", "r": "f8", "length": "f4"}
ATTRIBUTES = {"maker": "palpate", "plan": {"axes": ["ü"]}, "recipes": 3}
UNITS = {"length": "m", "step": "m"}
WRITERS = {".h5": write_table, ".parquet": write_parquet}


@pytest.fixture(params=WRITERS)
def path(request, tmp_path):
    path = tmp_path / f"table{request.param}"
    WRITERS[request.param](path, COLUMNS, ATTRIBUTES, units=UNITS)
    return path


def assert_frame(rows):
    """Rows as dictionaries, of whichever library."""
    assert list(rows[0]) == list(COLUMNS)
    assert [row["object"] for row in rows] == ["tube", "dög", ""]
    assert [row["seed"] for row in rows] == [1, 2, 3]
    assert [row["complete"] for row in rows] == [True, False, True]
    np.testing.assert_array_equal([row["count"] for row in rows], [1.0, np.nan, 3.0])
    np.testing.assert_array_equal([row["step"] for row in rows], [np.nan, 0.001, 0.002])
    assert all(np.isnan(row["r"]) for row in rows)


def test_types_units_and_attributes_come_back(path):
    columns = load_table(path)
    assert {name: column.dtype for name, column in columns.items()} == {n: np.dtype(t) for n, t in TYPES.items()}
    assert_frame([dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)])
    assert column_units(path) == UNITS
    attributes = table_attributes(path)
    assert (attributes["format"], attributes["version"], attributes["maker"]) == ("palpate table", 1, "palpate")
    assert json.loads(attributes["plan"]) == ATTRIBUTES["plan"]
    assert attributes["recipes"] == 3


def test_pandas_and_polars_read_it_in_one_line(path):
    import pandas as pd
    import polars as pl

    assert_frame(pd.DataFrame(load_table(path)).to_dict("records"))
    assert_frame(pl.DataFrame(load_table(path)).to_dicts())
    if path.suffix == ".parquet":
        assert_frame(pd.read_parquet(path).to_dict("records"))
        assert_frame(pl.read_parquet(path).to_dicts())


@pytest.mark.exhaustive
def test_xarray_reads_it_in_one_line(tmp_path):
    xr = pytest.importorskip("xarray")
    write_table(tmp_path / "t.h5", COLUMNS, ATTRIBUTES, units=UNITS)
    with xr.open_dataset(tmp_path / "t.h5", engine="h5netcdf") as data:
        assert dict(data.sizes) == {"row": 3}
        assert_frame(data.to_dataframe().to_dict("records"))
        assert data["length"].attrs["units"] == "m"
        assert data["complete"].dtype == np.bool_
        assert data.attrs["maker"] == "palpate"
        assert list(load_table(tmp_path / "t.h5")) == list(COLUMNS)  # while it is open there


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_table_without_rows_or_columns_is_a_table(tmp_path, suffix):
    path = tmp_path / f"t{suffix}"
    for columns in ({}, {"a": [], "b": np.zeros(0, np.int64)}):
        WRITERS[suffix](path, columns, {})
        assert {name: len(column) for name, column in load_table(path).items()} == dict.fromkeys(columns, 0)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize(
    ("columns", "reason"),
    [
        ({"a": [1, "x"]}, "column a mixes int, text"),
        ({"a": [[1]]}, "column a mixes list"),
        ({"a": [1 << 63]}, "column a has 9223372036854775808, beyond 64 bits"),
        ({"a": ["x", "\0"]}, r"row 1 of column a is '\\x00', which is not text"),
        ({"a": ["\ud800"]}, "row 0 of column a is"),
        ({"a": [1], "b": [1, 2]}, "equally many rows, not a: 1, b: 2"),
        ({"a/b": [1]}, "cannot name a column"),
        ({"row": [1]}, "cannot be called 'row'"),
    ],
)
def test_what_no_table_holds_is_refused_and_names_the_column(tmp_path, suffix, columns, reason):
    with pytest.raises(SweepStoreError, match=reason):
        WRITERS[suffix](tmp_path / f"t{suffix}", columns, {})
    assert list(tmp_path.iterdir()) == []


TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=5)
SCALARS = st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats()


@pytest.mark.exhaustive
@settings(max_examples=50)
@given(values=st.lists(SCALARS, max_size=6) | st.lists(st.none() | TEXT, max_size=6))
def test_a_column_is_the_same_in_both_formats(tmp_path_factory, values):
    folder = tmp_path_factory.mktemp("both")
    loaded = []
    for suffix, write in WRITERS.items():
        write(folder / f"t{suffix}", {"a": values}, {})
        loaded.append(load_table(folder / f"t{suffix}")["a"])
    assert loaded[0].dtype == loaded[1].dtype
    np.testing.assert_array_equal(*loaded)
    for value, own in zip(values, loaded[0], strict=True):
        expected = value if value is not None else ("" if loaded[0].dtype == object else np.nan)
        np.testing.assert_equal(own, type(own)(expected))


def test_what_is_no_table_is_refused_by_name(tmp_path):
    with pytest.raises(SweepStoreError, match=r"no.h5 does not exist"):
        load_table(tmp_path / "no.h5")
    with pytest.raises(SweepStoreError, match=r"no.parquet does not exist"):
        load_table(tmp_path / "no.parquet")
    for suffix in WRITERS:
        (tmp_path / f"text{suffix}").write_text("hello, this is not a table at all")
        with pytest.raises(SweepStoreError, match=f"text{suffix} (is not an HDF5 file|cannot be read)"):
            load_table(tmp_path / f"text{suffix}")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = [1]
    with pytest.raises(SweepStoreError, match=r"other.h5 is not a palpate table"):
        load_table(tmp_path / "other.h5")
    pd = pytest.importorskip("pandas")
    pd.DataFrame({"a": [1]}).to_parquet(tmp_path / "other.parquet")
    with pytest.raises(SweepStoreError, match=r"other.parquet is not a palpate table"):
        load_table(tmp_path / "other.parquet")


def test_a_newer_version_is_refused_by_name(tmp_path, monkeypatch):
    monkeypatch.setattr(table_module, "FORMAT_VERSION", 2)
    for suffix, write in WRITERS.items():
        write(tmp_path / f"t{suffix}", COLUMNS, {})
    monkeypatch.undo()
    for suffix in WRITERS:
        with pytest.raises(SweepStoreError, match=rf"t{suffix} has format version 2, this palpate reads up to 1"):
            load_table(tmp_path / f"t{suffix}")


def test_without_pyarrow_parquet_says_what_to_install(tmp_path, monkeypatch):
    real = importlib.import_module

    def absent(name):
        if name.startswith("pyarrow"):
            raise ModuleNotFoundError(name)
        return real(name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(SweepStoreError, match=r"pip install -e '.\[parquet\]'"):
        write_parquet(tmp_path / "t.parquet", COLUMNS, {})


@pytest.mark.parametrize("suffix", WRITERS)
def test_a_full_disk_leaves_the_earlier_table(tmp_path, suffix):
    path = tmp_path / f"t{suffix}"
    WRITERS[suffix](path, COLUMNS, {})
    before = path.read_bytes()
    with file_size_limit(8192), pytest.raises(SweepStoreError, match=rf"t{suffix} cannot be written: File too large"):
        WRITERS[suffix](path, {"a": np.random.default_rng(0).random(10_000)}, {})
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_rows_of_poses_of_an_earlier_palpate_are_read(tmp_path):
    path = tmp_path / "poses.h5"
    columns = {"pose": np.arange(70_000), "length": (np.arange(70_000) / 7).astype(np.float32)}
    write_old_table(path, columns, {"maker": "m"}, {"length": "m"})
    loaded = load_table(path)
    assert list(loaded) == list(columns)
    for name, column in columns.items():
        assert loaded[name].dtype == column.dtype
        np.testing.assert_array_equal(loaded[name], column)
    assert (table_attributes(path)["maker"], column_units(path)) == ("m", {"length": "m"})
