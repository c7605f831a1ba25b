"""Shards of a sweep: what goes in comes out, to the bit; a damaged or newer one is refused by name."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_store_rows import file_size_limit, write_rows

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.shard import ShardRow, read_shard, shard_columns, write_shard

ROWS = [
    ShardRow("contours", "k", 0, {"poses": 3, "stat": {"length": [3, 0.1, 1e-300, -0.0, float("inf")]}, "name": "ü"}),
    ShardRow("poses", "k", 1, {}),
]
COLUMNS = {
    "pose": np.arange(70_000),
    "length": np.linspace(0, 1, 70_000, dtype=np.float32),
    "big": np.arange(70_000, dtype=">i2"),
    "drawn": np.arange(70_000) % 7 == 0,
    "text": [f"ü{k}" for k in range(70_000)],
    "few": [None, 1.5] * 35_000,
}


@pytest.mark.exhaustive
def test_rows_and_columns_come_back_as_they_were(tmp_path):
    path = tmp_path / "a.h5"
    write_shard(path, ROWS, [None, COLUMNS], maker="me")
    shard = read_shard(path)
    assert shard.rows == tuple(ROWS)
    assert shard.maker == "me"
    assert shard.columns[0] is None
    columns = shard.columns[1]
    assert list(columns) == list(COLUMNS)
    for name, expected in COLUMNS.items():
        np.testing.assert_array_equal(columns[name], np.asarray(expected, columns[name].dtype))
    assert [columns[name].dtype.str for name in ("length", "big", "drawn", "few")] == ["<f4", "<i2", "|b1", "<f8"]
    with shard_columns(path) as reader:
        np.testing.assert_array_equal(reader.columns(1, "poses", "k", 1)["pose"], COLUMNS["pose"])
    assert read_shard(path, columns=False).columns == (None, None)
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]


def test_numpys_numbers_are_numbers_in_a_payload(tmp_path):
    payload = {"n": np.int64(3), "x": np.float32(0.5), "all": np.arange(2), "is": np.bool_(True)}
    write_shard(tmp_path / "a.h5", [ShardRow("g", "k", 0, payload)])
    assert read_shard(tmp_path / "a.h5").rows[0].payload == {"n": 3, "x": 0.5, "all": [0, 1], "is": True}
    with pytest.raises(SweepStoreError, match="not set"):
        write_shard(tmp_path / "b.h5", [ShardRow("g", "k", 0, {"x": {1}})])


TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=8,
)


@pytest.mark.exhaustive
@given(rows=st.lists(st.builds(ShardRow, TEXT, TEXT, st.integers(0, 10**9), st.dictionaries(TEXT, JSON)), max_size=5))
def test_any_payload_of_json_comes_back(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("any") / "a.h5"
    write_shard(path, rows)
    assert read_shard(path).rows == tuple(rows)


@pytest.mark.parametrize("place", [0.0, 0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("columns", [False, True])
def test_a_changed_byte_anywhere_is_found(tmp_path, place, columns):
    path = tmp_path / "a.h5"
    write_rows(path, [("poses", "k", part) for part in range(4)], columns=columns)
    content = bytearray(path.read_bytes())
    content[int(place * (len(content) - 1))] ^= 0x40
    path.write_bytes(content)
    with pytest.raises(SweepStoreError, match=rf"{re.escape(str(path))} is damaged"):
        read_shard(path)


def test_a_newer_version_is_refused_by_name(tmp_path):
    path = tmp_path / "a.h5"
    write_rows(path, [("poses", "k", 0)])
    path.write_bytes(path.read_bytes().replace(b"palpate shard 1\n", b"palpate shard 2\n"))
    with pytest.raises(SweepStoreError, match=r"a.h5 has format version 2, this palpate reads up to 1"):
        read_shard(path)


def test_columns_that_do_not_go_with_the_rows_are_refused(tmp_path):
    path = tmp_path / "a.h5"
    with pytest.raises(SweepStoreError, match="2 rows have columns for 1"):
        write_shard(path, ROWS, [None])
    with pytest.raises(SweepStoreError, match=r"equally many rows, not a: 1, b: 2"):
        write_shard(path, ROWS, [None, {"a": [1], "b": [1, 2]}])
    with pytest.raises(SweepStoreError, match="shape"):
        write_shard(path, ROWS, [None, {"a": np.zeros((2, 3))}])
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_nothing_behind_and_what_was_there_stays(tmp_path):
    path = tmp_path / "a.h5"
    write_rows(path, [("contours", "k", 0)])
    before = path.read_bytes()
    with file_size_limit(4096), pytest.raises(OSError, match="File too large"):
        write_shard(path, ROWS, [None, COLUMNS])
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.h5"]
