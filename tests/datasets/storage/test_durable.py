"""Files that come whole or not at all: writers that raise or are killed, calls that fail, power cuts, two at once.

The truths are the system's own: real processes that are killed, real locks, and the models of tests/faults.
"""

import contextlib
import errno
import fcntl
import os
import random
import signal
import subprocess
import sys

import pytest
from disk_faults import Disk, Faults, stood_in_for

from palpate.datasets.storage import durable
from palpate.datasets.storage.durable import (
    FolderLock,
    NewFile,
    discard_unfinished,
    temporary_files,
    temporary_name,
    write_file,
)

OLD, NEW = b"old" * 3000, b"new" * 4000  # of several pages, which a power cut keeps one by one


def put(path):
    """Write in two steps, as writers of large files do."""
    with NewFile(path) as new:
        new.write(NEW[:5000])
        new.write(NEW[5000:8000], memoryview(NEW)[8000:])


def put_by_path(path):
    """Write as a library does that opens the temporary file by its name."""
    with NewFile(path) as new:
        handle = os.open(new.temporary, os.O_WRONLY | os.O_TRUNC)
        try:
            os.write(handle, NEW)
        finally:
            os.close(handle)


def put_if_absent(path):
    with NewFile(path) as new:
        new.write(NEW)
        new.publish(replaces=False)


WRITERS = {"at once": lambda path: write_file(path, NEW), "in steps": put, "by path": put_by_path}


def leave(path, suffix=""):
    """What a killed writer leaves."""
    left = temporary_name(path, suffix=suffix)
    left.write_bytes(b"half")
    return left


def test_a_new_file_replaces_the_old_one_only_at_the_end(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")
    with NewFile(path, ".csv") as new:
        new.temporary.write_text("new")
        assert path.read_text() == "old"
        assert new.temporary.parent == tmp_path
        assert new.temporary.suffix == ".csv"
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["a.csv"]
    new.publish()
    new.discard()
    assert path.read_text() == "new"


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt, ValueError])
def test_a_writer_that_raises_leaves_the_old_file_alone(error, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("old")

    def write():
        with NewFile(path) as new:
            new.write(b"half")
            raise error

    with pytest.raises(error):
        write()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_a_discarded_file_is_never_published(tmp_path):
    with NewFile(tmp_path / "a") as new:
        new.write(b"half")
        new.discard()
        with pytest.raises(OSError, match="was discarded"):
            new.publish()
    assert os.listdir(tmp_path) == []


def test_a_file_that_came_meanwhile_is_not_replaced_unless_it_may_be(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(OLD)
    with pytest.raises(FileExistsError):
        put_if_absent(path)
    assert path.read_bytes() == OLD
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("has_old", [False, True])
def test_a_file_system_without_links_takes_a_file_that_replaces_none(tmp_path, monkeypatch, has_old):
    def refuse(*names):
        raise PermissionError(errno.EPERM, "Operation not permitted")  # of FAT, link(2)

    path = tmp_path / "a"
    monkeypatch.setattr(os, "link", refuse)
    if has_old:
        path.write_bytes(OLD)
        with pytest.raises(FileExistsError):
            put_if_absent(path)
    else:
        put_if_absent(path)
    assert path.read_bytes() == (OLD if has_old else NEW)
    assert os.listdir(tmp_path) == ["a"]


def test_what_is_half_written_is_removed_before_a_process_ends_in_the_middle(tmp_path):
    write_file(tmp_path / "done.csv", b"done")

    def write():
        with NewFile(tmp_path / "a.csv") as new:
            new.write(b"half")
            discard_unfinished()

    with pytest.raises(FileNotFoundError):
        write()
    assert os.listdir(tmp_path) == ["done.csv"]


def test_the_content_is_on_the_disk_before_the_name_and_the_name_before_the_end(tmp_path):
    """Each call that a small file takes: there are no more of them than these."""
    faults = Faults(frozenset())
    with stood_in_for(faults):
        write_file(tmp_path / "a", NEW)
    assert faults.names == ["open", "fstat", "write", "fsync", "replace", "open", "fsync"]


# Killed writers, and two at once.

KILLED = """
import os, signal, sys
from pathlib import Path
from palpate.datasets.storage.durable import write_file

name, number = sys.argv[2], int(sys.argv[3])
real, made = getattr(os, name), []

def call(*args):
    made.append(args)
    if len(made) == number:
        os.write(1, b"there")
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*args)

setattr(os, name, call)
write_file(Path(sys.argv[1]), b"half", b"half")
"""


@pytest.mark.parametrize(("name", "number"), [("write", 2), ("replace", 1), ("fsync", 2)])
def test_nothing_stays_of_a_killed_writer_once_the_file_is_written_again(tmp_path, name, number):
    """Kills while it writes, before it has its name, and before the folder is synced."""
    path, other = tmp_path / "a.h5", leave(tmp_path / "b.h5")
    path.write_bytes(OLD)
    killed = subprocess.run([sys.executable, "-c", KILLED, path, name, str(number)], capture_output=True, check=False)
    assert (killed.returncode, killed.stdout) == (-signal.SIGKILL, b"there")
    assert path.read_bytes() == (b"halfhalf" if name == "fsync" else OLD)
    assert len(temporary_files(path)) == (name != "fsync")
    write_file(path, NEW)
    assert path.read_bytes() == NEW
    assert sorted(tmp_path.iterdir()) == [path, other]


@pytest.mark.parametrize("name", ["n" * 255, "n" * 239, "é" * 127, "[n]" * 85, "日" * 85, "a[1]*.txt"], ids=range(6))
def test_a_name_of_any_length_is_written_and_its_leftovers_are_found_and_no_others(name, tmp_path):
    path = tmp_path / name
    leave(path)
    others = [leave(path.with_name(name[:-1] + "x")), leave(path, ".npz"), tmp_path / "a[1]*.txt.thesis.tmp"]
    others[-1].write_bytes(b"half")
    write_file(path, b"new")
    assert sorted(tmp_path.iterdir()) == sorted([path, *others])
    assert path.read_bytes() == b"new"


def test_of_two_writers_the_one_that_publishes_last_stays(tmp_path):
    path = tmp_path / "a"
    with NewFile(path) as first:
        first.write(b"first")
        with NewFile(path) as second:
            second.write(b"second")
            assert len(temporary_files(path)) == 2
        assert path.read_bytes() == b"second"
        first.write(b"!")
    assert path.read_bytes() == b"first!"
    assert os.listdir(tmp_path) == ["a"]


def test_others_may_lock_a_file_as_soon_as_it_has_its_name(tmp_path, monkeypatch):
    """As libhdf5 does to read: a shared lock, which is refused at once where another is exclusive."""
    path, real = tmp_path / "a.h5", durable.sync

    def sync(folder):
        with path.open("rb") as reader:
            fcntl.flock(reader, fcntl.LOCK_SH | fcntl.LOCK_NB)
        real(folder)

    monkeypatch.setattr(durable, "sync", sync)
    write_file(path, NEW)
    assert path.read_bytes() == NEW


@pytest.mark.parametrize("is_held", [False, True])
def test_a_file_that_another_writer_takes_for_a_left_one_gets_another_name(tmp_path, monkeypatch, is_held):
    """Between making a file and locking it, another writer removes it, or has locked it in order to do so."""
    path, real, taken = tmp_path / "a", fcntl.flock, []

    def late(handle, how):
        if how & fcntl.LOCK_SH and not taken:
            (found,) = temporary_files(path)
            taken.append(os.open(found, os.O_RDWR))
            if is_held:
                real(taken[0], fcntl.LOCK_EX)
            else:
                found.unlink()
        real(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with NewFile(path) as new:
        assert new.temporary.exists()
        new.write(NEW)
        os.close(taken[0])
    assert path.read_bytes() == NEW
    write_file(path, NEW)
    assert os.listdir(tmp_path) == ["a"]


def test_a_file_system_without_locks_keeps_what_others_may_be_writing(tmp_path, monkeypatch):
    def refuse(handle, how):
        raise OSError(errno.ENOLCK, "No locks available")

    path = tmp_path / "a"
    left = leave(path)
    monkeypatch.setattr(fcntl, "flock", refuse)
    write_file(path, NEW)
    assert sorted(tmp_path.iterdir()) == [path, left]


def test_no_link_and_no_fifo_that_somebody_planted_is_written_or_waited_for(tmp_path):
    victim, path = tmp_path / "victim", tmp_path / "a.txt"
    victim.write_bytes(b"precious")
    planted = [temporary_name(path, number) for number in range(12)]
    os.mkfifo(planted[0])
    for link in planted[1:]:
        link.symlink_to(victim)
    write_file(path, NEW)
    assert (path.read_bytes(), victim.read_bytes()) == (NEW, b"precious")
    assert set(planted) < set(tmp_path.iterdir())


def test_writers_of_one_path_at_once_have_names_of_their_own_and_leave_nothing(tmp_path):
    path = tmp_path / "a"
    with contextlib.ExitStack() as stack:
        writers = [stack.enter_context(NewFile(path)) for _ in range(9)]
        assert len({writer.temporary for writer in writers}) == len(temporary_files(path)) == 9
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("numbers", [[0], [3], [1, 3], range(9)], ids=str)
def test_leftovers_are_found_though_the_folder_is_never_listed(tmp_path, monkeypatch, numbers):
    """A folder may have very many files, as that of a sweep's kept ones."""
    path, listed = tmp_path / "a", os.listdir
    for number in numbers:
        temporary_name(path, number).write_bytes(b"half")
    monkeypatch.setattr(os, "listdir", None)
    monkeypatch.setattr(os, "scandir", None)
    write_file(path, NEW)
    assert listed(tmp_path) == ["a"]


def test_a_left_file_that_another_process_has_removed_and_begun_again_stays(tmp_path, monkeypatch):
    """Between opening a left file and locking it, another process removes it and begins one of the same name."""
    path, real = tmp_path / "a", fcntl.flock
    left = leave(path)
    begun = []

    def late(handle, how):
        if how & fcntl.LOCK_EX and not begun:
            left.unlink()
            begun.append(NewFile(path))
        real(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    write_file(path, OLD)
    begun[0].write(NEW)
    begun[0].publish()
    assert path.read_bytes() == NEW
    assert os.listdir(tmp_path) == ["a"]


# Calls that fail, and power cuts.


def calls_of(folder, write, old):
    """The calls of an undisturbed run that finds an older file and what a killed writer has left."""
    path = begun(folder, old)
    faults = Faults(frozenset())
    with stood_in_for(faults):
        write(path)
    return faults.names


def begun(folder, old):
    folder.mkdir()
    path = folder / "a"
    leave(path)
    if old is not None:
        path.write_bytes(old)
    return path


@pytest.mark.parametrize("error", [errno.EIO, errno.ENOSPC])
@pytest.mark.parametrize(
    ("write", "old"), [*((own, OLD) for own in WRITERS.values()), (put_if_absent, None)], ids=[*WRITERS, "if absent"]
)
def test_whichever_call_fails_there_is_the_old_file_or_the_new_one_and_writing_again_completes(
    tmp_path, write, old, error
):
    names = calls_of(tmp_path / "undisturbed", write, old)
    for number, name in enumerate(names):
        path = begun(tmp_path / str(number), old)
        faults = Faults(frozenset([number]), error, is_torn=True)
        raised = None
        with stood_in_for(faults):
            try:
                write(path)
            except OSError as failure:
                raised = failure.errno
        found = path.read_bytes() if path.exists() else None
        is_late = number >= len(names) - 2  # opening and syncing the folder: the name stands
        assert faults.failed == [name]
        assert raised in (None, error)
        assert found == (NEW if raised is None or is_late else old)
        assert raised or name in ("open", "fstat", "unlink", "link")  # of what others left, or there are no links
        if write is not put_if_absent:
            write(path)
            assert path.read_bytes() == NEW
            assert os.listdir(path.parent) == ["a"]
    assert {"open", "fsync", "unlink"} < set(names)


@pytest.mark.parametrize("is_left", [False, True])
def test_publishing_again_after_the_folder_could_not_be_synced_completes(tmp_path, is_left):
    """Within the `with` and, as a writer does that is asked again, when that was left by the exception."""
    path, faults = tmp_path / "a", Faults(frozenset([3]))  # fsync, replace, open, fsync
    new = NewFile(path)
    new.write(NEW)
    with stood_in_for(faults):
        with pytest.raises(OSError, match="Input/output error"):
            new.publish()
        assert path.read_bytes() == NEW
        if is_left:
            new.discard()
        new.publish()
        new.publish()
    assert faults.names == ["fsync", "replace", "open", "fsync", "open", "fsync"]
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize("failing", ["write", "fsync"])
def test_content_that_may_be_lost_is_never_published(tmp_path, failing):
    """Linux reports once that pages could not be written, and takes them for clean afterwards (fsync(2))."""
    path, faults = tmp_path / "a", Faults(frozenset([int(failing == "fsync")]), is_torn=True)
    path.write_bytes(OLD)
    with NewFile(path) as new:
        with stood_in_for(faults), contextlib.suppress(OSError):
            new.write(NEW)
            new.publish()
        assert faults.failed == [failing]
        with pytest.raises(OSError, match="was discarded"):
            new.publish()
    assert path.read_bytes() == OLD
    assert os.listdir(tmp_path) == ["a"]


def remains(tmp_path, write, old, seeds):
    """What power cuts at each moment leave under the name; the last ones come when the writer is done."""
    found, number = [], 0
    path = begun(tmp_path / "disk", old)

    def cut():
        nonlocal number
        for share in (0.0, *[0.5] * seeds, 1.0):
            folder = tmp_path / str(number)
            folder.mkdir()
            disk.lay_out(folder, random.Random(number), share)
            found.append((folder / "a").read_bytes() if (folder / "a").exists() else None)
            number += 1

    disk = Disk(path.parent, cut)
    with disk.recording():
        write(path)
    cut()
    return found[: -seeds - 2], found[-seeds - 2 :]


@pytest.mark.parametrize(
    ("write", "old"), [*((own, OLD) for own in WRITERS.values()), (put_if_absent, None)], ids=[*WRITERS, "if absent"]
)
def test_a_power_cut_leaves_the_old_file_or_the_new_one_and_once_it_is_written_the_new_one(tmp_path, write, old):
    during, after = remains(tmp_path, write, old, seeds=5)
    assert set(during) == {old, NEW}
    assert set(after) == {NEW}


def test_the_model_of_power_cuts_finds_a_file_that_is_not_synced(tmp_path):
    def put_unsynced(path):
        handle = os.open(path.with_name("other"), os.O_WRONLY | os.O_CREAT)
        os.write(handle, NEW)
        os.close(handle)
        os.replace(path.with_name("other"), path)

    during, after = remains(tmp_path, put_unsynced, OLD, seeds=30)
    assert not set(during) <= {OLD, NEW}
    assert set(after) != {NEW}


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
