"""Files that come whole or not at all, also where a writer stops in the middle."""

import fcntl
import os
import random
import time

import pytest
from disk_faults import Disk

from palpate.datasets.storage.durable import (
    ABANDONED_SECONDS,
    FolderLock,
    discard_unfinished,
    temporary_name,
    whole_file,
    write_file,
)


def test_a_whole_file_replaces_the_old_one_only_at_the_end(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")
    with whole_file(path) as new:
        new.write_text("new")
        assert path.read_text() == "old"
        assert new.parent == tmp_path
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("begun", [False, True])
def test_a_writer_that_raises_leaves_the_old_file_alone(error, begun, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")

    def write():
        with whole_file(path) as new:
            if begun:
                new.write_text("half")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_what_a_killed_writer_left_is_removed_once_it_is_old(tmp_path):
    path = tmp_path / "a.csv"
    old, young = temporary_name(path), temporary_name(path)
    for left in (old, young):
        left.write_text("half")
    then = time.time() - ABANDONED_SECONDS - 10
    os.utime(old, (then, then))
    with whole_file(path) as new:
        new.write_text("new")
    assert sorted(tmp_path.iterdir()) == sorted([path, young])


@pytest.mark.parametrize("name", ["n" * 255, "n" * 239, "é" * 127, "[n]" * 85, "日" * 85], ids=range(5))
def test_a_name_as_long_as_the_file_system_takes_is_written_and_its_leftovers_are_found(name, tmp_path):
    path = tmp_path / name
    left, others = temporary_name(path), temporary_name(path.with_name(name[:-1] + "x"))
    then = time.time() - ABANDONED_SECONDS - 10
    for temporary in (left, others):
        temporary.write_text("half")
        os.utime(temporary, (then, then))
    write_file(path, memoryview(b"new"))
    with whole_file(path) as new:
        new.write_text("newer")
    assert sorted(tmp_path.iterdir()) == sorted([path, others])
    assert path.read_text() == "newer"


def test_what_is_half_written_is_removed_before_a_process_ends_in_the_middle(tmp_path):
    done = tmp_path / "done.csv"
    write_file(done, memoryview(b"done"))

    def write():
        with whole_file(tmp_path / "a.csv") as new:
            new.write_text("half")
            discard_unfinished()

    with pytest.raises(FileNotFoundError):
        write()
    assert list(tmp_path.iterdir()) == [done]


def write_whole(path, content):
    with whole_file(path) as new:
        handle = os.open(new, os.O_WRONLY | os.O_CREAT)
        os.write(handle, content)
        os.close(handle)


@pytest.mark.parametrize("write", [write_file, write_whole])
def test_a_power_cut_leaves_the_old_file_or_the_new_one(tmp_path, write):
    old, new, found = b"old" * 3000, b"new" * 4000, []
    path = tmp_path / "disk" / "a.csv"
    path.parent.mkdir()
    path.write_bytes(old)

    def cut():
        for share in (0.0, 0.5, 0.5, 1.0):
            folder = tmp_path / str(len(found))
            folder.mkdir()
            disk.lay_out(folder, random.Random(len(found)), share)
            found.append((folder / "a.csv").read_bytes())

    disk = Disk(path.parent, cut)
    with disk.recording():
        write(path, memoryview(new))
    cut()
    assert set(found) == {old, new}
    assert set(found[-4:]) == {new}


@pytest.mark.parametrize("is_made_anew", [False, True])
def test_a_lock_on_a_file_that_its_last_holder_removed_is_none(tmp_path, monkeypatch, is_made_anew):
    lock, real = tmp_path / FolderLock.NAME, fcntl.flock

    def late(handle, how):
        (tmp_path / "kept").hardlink_to(lock)  # so that the new file has another number
        lock.unlink()
        if is_made_anew:
            lock.touch()
        real(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with pytest.raises(BlockingIOError):
        FolderLock(tmp_path)
    monkeypatch.undo()
    FolderLock(tmp_path).release()
    assert not FolderLock.is_held(tmp_path)
