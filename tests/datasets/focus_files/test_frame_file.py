"""Files of frames: frames come in any blocks, and the file appears when all are there."""

import os

import h5py
import numpy as np
import pytest

from palpate.datasets.focus_files.frame_file import FrameField, FrameFile

FIELDS = [FrameField("/a/position", (3,), "m"), FrameField("/a/level", (), "1")]


def frame_file(path, count):
    return FrameFile(path, FIELDS, count, attributes={"/": {"format": "test"}, "/a": {"rate": 7.0}})


def test_room_is_reserved_where_the_file_system_leaves_that_to_the_c_library(tmp_path, monkeypatch):
    def touch_blocks(handle, offset, length):
        """As glibc does: a byte of each block is read and written back."""
        for at in range(offset, offset + length, 4096):
            byte = os.pread(handle, 1, at)
            os.pwrite(handle, byte or b"\0", at)
        os.pwrite(handle, os.pread(handle, 1, offset + length - 1) or b"\0", offset + length - 1)

    monkeypatch.setattr(os, "posix_fallocate", touch_blocks)
    with frame_file(tmp_path / "a.h5", 100) as file:
        file.append({"/a/position": np.ones((100, 3)), "/a/level": np.ones(100)})
        file.publish()
    with h5py.File(tmp_path / "a.h5") as read:
        assert (read["a/position"][...] == 1.0).all()


def test_frames_come_in_any_blocks_and_appear_when_all_are_there(tmp_path, rng):
    rows = rng.normal(size=(1000, 4)).astype(np.float32)
    with frame_file(tmp_path / "a.h5", 1000) as file:
        for first, stop in ((0, 1), (1, 700), (700, 700), (700, 1000)):
            assert not (tmp_path / "a.h5").exists()
            file.append({"/a/position": rows[first:stop, :3], "/a/level": rows[first:stop, 3]})
        with pytest.raises(ValueError, match=r"1001 of .* do not fit 1000"):
            file.append({"/a/position": rows[:1, :3], "/a/level": rows[:1, 3]})
        size = file.publish()
    assert [path.name for path in tmp_path.iterdir()] == ["a.h5"]
    assert size == (tmp_path / "a.h5").stat().st_size < 40_000
    with h5py.File(tmp_path / "a.h5") as read:
        np.testing.assert_array_equal(read["a/position"], rows[:, :3])
        np.testing.assert_array_equal(read["a/level"], rows[:, 3])
        assert (read["a"].attrs["rate"], read["a/level"].attrs["units"]) == (7.0, b"1")


def test_a_file_for_which_there_is_no_room_leaves_nothing(tmp_path):
    with pytest.raises(OSError, match=r"No space|too large"), frame_file(tmp_path / "a.h5", 1 << 50):
        pass
    assert list(tmp_path.iterdir()) == []
