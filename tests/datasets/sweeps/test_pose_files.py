"""Rows of poses as Parquet files: every library reads them as one table, and palpate proves them."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_store_rows import file_size_limit

from palpate.datasets import load_pose_table
from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps import pose_files
from palpate.datasets.sweeps.check import check_store
from palpate.datasets.sweeps.pose_files import pose_file_problems, write_pose_files
from palpate.datasets.sweeps.table import column_units, table_attributes

ATTRIBUTES = {"maker": "palpate", "plan": {"axes": ["ü"]}}
UNITS = {"length": "m"}


def block(first, count):
    poses = np.arange(first, first + count)
    return {"recipe": poses // 10, "length": (poses / 7).astype(np.float32), "drawn": poses % 3 > 0}


def write(folder, counts):
    firsts = np.cumsum([0, *counts])
    blocks = (block(first, count) for first, count in zip(firsts, counts, strict=False))
    assert write_pose_files(folder, blocks, ATTRIBUTES, units=UNITS) == firsts[-1]
    return block(0, int(firsts[-1]))


@pytest.fixture
def small(monkeypatch):
    """Files of 100 rows in row groups of 40."""
    monkeypatch.setattr(pose_files, "ROWS", 100)
    monkeypatch.setattr(pose_files, "GROUP_ROWS", 40)


@pytest.fixture
def folder(tmp_path, small):
    write(tmp_path / "poses", [130, 0, 70, 60])
    return tmp_path / "poses"


@settings(max_examples=5)
@given(counts=st.lists(st.integers(0, 30), max_size=8), rows=st.integers(1, 12))
def test_blocks_of_any_size_make_the_same_rows_in_files_of_any_size(tmp_path_factory, counts, rows):
    path = tmp_path_factory.mktemp("blocks") / "poses"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pose_files, "ROWS", rows)
        expected = write(path, counts)
    loaded = load_pose_table(path)
    assert len(list(path.iterdir())) == -(-sum(counts) // rows)
    for name, column in expected.items() if sum(counts) else ():
        assert loaded[name].dtype == column.dtype
        np.testing.assert_array_equal(loaded[name], column)
    assert pose_file_problems(path) == []
    assert [file.name for file in path.parent.iterdir()] == ["poses"]


def duckdb_lengths(pattern):
    duckdb = pytest.importorskip("duckdb")
    return duckdb.sql(f"select length from '{pattern}'").fetchnumpy()["length"]


def dask_lengths(pattern):
    frame = pytest.importorskip("dask.dataframe", exc_type=ImportError)
    return frame.read_parquet(pattern)["length"].compute().to_numpy()


def polars_lengths(pattern):
    polars = pytest.importorskip("polars")
    return polars.scan_parquet(pattern).select("length").collect()["length"].to_numpy()


def pandas_lengths(pattern):
    pandas = pytest.importorskip("pandas")
    return pandas.read_parquet(pattern.removesuffix("/*.parquet"))["length"].to_numpy()


READERS = {"polars": polars_lengths, "pandas": pandas_lengths, "duckdb": duckdb_lengths, "dask": dask_lengths}


@pytest.mark.exhaustive(after=1)
@pytest.mark.filterwarnings("ignore:The inplace keyword")  # Dask calls pandas so
@pytest.mark.parametrize("library", READERS)
def test_libraries_read_the_folder_as_one_table_in_the_order_of_the_rows(folder, library):
    found = READERS[library](f"{folder}/*.parquet")
    np.testing.assert_array_equal(found, block(0, 260)["length"])


def test_each_file_says_what_it_is(folder):
    names = [path.name for path in sorted(folder.iterdir())]
    assert names == [f"00000{number}-of-000003.parquet" for number in range(3)]
    attributes = table_attributes(folder / names[1])
    assert (attributes["maker"], json.loads(attributes["plan"]), attributes["file"]) == (
        "palpate",
        ATTRIBUTES["plan"],
        1,
    )
    assert column_units(folder / names[2]) == UNITS


def remove(paths):
    paths[1].unlink()


def swap(paths):
    other = paths[0].with_name("other")
    for a, b in ((paths[0], other), (paths[1], paths[0]), (other, paths[1])):
        a.rename(b)


def add(paths):
    paths[0].with_name("mine.parquet").write_bytes(paths[0].read_bytes())


def flip(paths):
    content = paths[1].read_bytes()
    paths[1].write_bytes(content[:40] + bytes([content[40] ^ 1]) + content[41:])


@pytest.mark.parametrize("damage", [remove, swap, add, flip])
def test_damage_of_the_folder_is_found(folder, damage):
    damage(sorted(folder.iterdir()))
    assert pose_file_problems(folder)
    assert any(str(folder) in sentence for sentence in check_store(folder.parent).problems)
    with pytest.raises(SweepStoreError):
        load_pose_table(folder)


def test_a_folder_that_is_written_again_holds_no_file_of_the_earlier_one(folder):
    expected = write(folder, [50])
    assert [path.name for path in folder.iterdir()] == ["000000-of-000001.parquet"]
    np.testing.assert_array_equal(load_pose_table(folder)["length"], expected["length"])


def test_what_cannot_be_written_leaves_the_earlier_folder(folder, tmp_path):
    def mine():
        yield block(0, 150)
        raise KeyError("mine")

    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(KeyError, match="mine"):
        write_pose_files(folder, mine(), {}, units={})
    for other in ({"a": [1.0]}, {"a": [1], "b": [2]}, {"b": [1]}):
        with pytest.raises(SweepStoreError, match="rows from 1 on have columns"):
            write_pose_files(folder, [{"a": [1]}, other], {}, units={})
    with file_size_limit(1000), pytest.raises(SweepStoreError, match="poses cannot be written: File too large"):
        write_pose_files(folder, [block(0, 1000)], {}, units={})
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["poses"]


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(SweepStoreError, match="poses does not exist"):
        load_pose_table(tmp_path / "poses")
