"""A writer that is killed, whose commit fails, or whose disk is full: what was committed is there, and is gone on with.

How a file gets its name, and what a power cut leaves of it, is shown once for all files (test_durable.py).
"""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from contour_cases import (
    assert_same,
    assert_whole,
    cut_contours,
    finish,
    make_contours,
    make_header,
    write_file,
    write_ranges,
)
from disk_faults import file_size_limit, stood_in_for

from palpate.datasets.contour_file.blocks import work_folder
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

PROCESS = Path(__file__).parents[2] / "faults" / "contour_process.py"
CONTOURS, HEADER = make_contours(9), make_header(9)
RANGES = [(0, 3), (3, 4), (4, 9)]


def assert_kept(path, contours, done):
    """Every range that was committed is readable and right."""
    with ContourFile(path) as file:
        for first, stop in done:
            assert_same(file.contours(first, stop), cut_contours(contours, first, stop))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("call", "name", "count"),
    [("replace", "poses-000000000006-000000000009.h5", 2), ("replace", "out.h5", 4), ("unlink", "header.h5", 4)],
    ids=["before a block has its name", "before the file has its name", "while the blocks are removed"],
)
def test_kill_9_loses_nothing_reported_done_and_resuming_completes(tmp_path, call, name, count):
    path, contours = tmp_path / "out.h5", make_contours(12)
    command = [sys.executable, PROCESS, path]
    killed = subprocess.run([*command, "create", "12", "3", call, name], capture_output=True, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    done = [tuple(map(int, line.split()[1:])) for line in killed.stdout.splitlines()]
    assert len(done) == count
    assert path.exists() == (call == "unlink")
    assert_kept(path, contours, done)
    resumed = subprocess.run([*command, "resume", "12", "3"], capture_output=True, text=True, check=True)
    assert resumed.stdout.split("\n")[:-1] == [f"done {first} {first + 3}" for first in (6, 9)][: 4 - count]
    assert_whole(path, contours)


def calls_seen(see):
    """Have `see(name, path or handle, ...)` called before each system call that changes files."""
    return stood_in_for(lambda name, real: lambda *args, **options: (see(name, *args), real(*args, **options))[1])


def test_names_come_after_content_and_blocks_go_after_the_name_of_the_file(tmp_path):
    path, synced, moments = tmp_path / "out.h5", set(), []

    def see(name, own, *rest):
        if name == "fsync":
            synced.add(os.fstat(own).st_ino)
        if name == "replace":
            moments.append((Path(rest[0]).name, os.stat(own).st_ino in synced))
            synced.discard(tmp_path.stat().st_ino)
        if name == "unlink" and Path(own).name.startswith("poses-"):
            moments.append(("removed", tmp_path.stat().st_ino in synced))

    with ContourWriter(path, HEADER) as writer:
        write_ranges(writer, CONTOURS, [(0, 9)], held=True)
        with calls_seen(see):
            writer.commit()
            assert work_folder(path).stat().st_ino in synced
            writer.seal()
    names = ("header.h5", "poses-000000000000-000000000009.h5", "out.h5", "removed")
    assert [moment for moment in moments if moment[0] in names] == [(name, True) for name in names]


def test_a_kill_while_overwriting_clears_the_folder_leaves_what_resuming_reads(tmp_path):
    """The header goes last: blocks without it would be of nothing."""
    path, removed = tmp_path / "out.h5", []
    with ContourWriter(path, HEADER) as writer:
        write_ranges(writer, CONTOURS, RANGES[:2])

    def see(name, own, *rest):
        if name == "unlink" and Path(own).suffix == ".h5":
            removed.append(own)
            if len(removed) == 2:
                raise KeyboardInterrupt  # stands for the kill

    with calls_seen(see), pytest.raises(KeyboardInterrupt):
        ContourWriter(path, HEADER, mode="overwrite")
    assert finish(path, CONTOURS)[0] != []


def test_a_full_disk_while_sealing_keeps_everything_and_the_old_file(tmp_path):
    """The old file is of the same recipe, made earlier: resuming does not take it for the one that is being written."""
    path, contours, before = tmp_path / "out.h5", make_contours(100), make_contours(100, seed=9)
    write_file(path, before, chunk=100, created="2020")
    with ContourWriter(path, make_header(100), mode="overwrite") as writer:
        write_ranges(writer, contours, [(50, 100)])
        write_ranges(writer, contours, [(0, 50)], held=True)
        message = r"cannot seal: File too large"
        with file_size_limit(20_000), pytest.raises(ContourFileError, match=message):
            writer.seal()
        assert not list(tmp_path.glob("**/*.tmp"))
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), before)
    assert finish(path, contours)[0] == []


def test_a_header_that_does_not_fit_leaves_no_block_without_it(tmp_path):
    path = tmp_path / "out.h5"
    with ContourWriter(path, HEADER) as writer:
        write_ranges(writer, CONTOURS, [(0, 9)], held=True)
        with file_size_limit(1000), pytest.raises(ContourFileError, match="cannot prepare to write: File too large"):
            writer.commit()
        assert (writer.committed, os.listdir(work_folder(path))) == (0, ["lock"])
    assert finish(path, CONTOURS)[0] == []


def test_sealing_again_after_the_folder_was_not_synced_keeps_the_file(tmp_path):
    """The first sync after the new name stands fails, as on a disk that reports an error late."""
    path, failed = tmp_path / "out.h5", []

    def see(name, *rest):
        if name == "fsync" and path.exists() and not failed:
            failed.append(name)
            raise OSError(5, "Input/output error")

    with ContourWriter(path, HEADER) as writer:
        write_ranges(writer, CONTOURS, RANGES)
        with calls_seen(see):
            with pytest.raises(ContourFileError, match="cannot seal: Input/output error"):
                writer.seal()
            writer.seal()
    assert_whole(path, CONTOURS)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("change", [Path.unlink, lambda path: os.truncate(path, 9000)], ids=["removed", "cut off"])
def test_blocks_that_somebody_changed_are_missed_and_those_that_he_added_are_none(tmp_path, change):
    path = tmp_path / "out.h5"
    block = work_folder(path) / "poses-000000000003-000000000004.h5"
    with ContourWriter(path, HEADER) as writer:
        write_ranges(writer, CONTOURS, RANGES)
        shutil.copy(block, block.with_name("poses-000000000004-000000000005.h5"))
        change(block)
        message = r"1 poses that were committed are not in .*out.h5.partial.*mode=.resume. renders them again"
        with pytest.raises(ContourFileError, match=message):
            writer.seal()
        assert os.listdir(tmp_path) == ["out.h5.partial"]
    assert finish(path, CONTOURS)[0] == [(3, 4)]


FAILING = """
import contextlib, sys
from contour_cases import make_contours, make_header, write_ranges
from disk_faults import Faults, stood_in_for
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

for number in range(3, 250, 5):
    with contextlib.suppress(ContourFileError), stood_in_for(Faults(frozenset([number]))):
        with ContourWriter(f"{sys.argv[1]}/{number}.h5", make_header(9)) as writer:
            write_ranges(writer, make_contours(9), [(0, 9)])
            writer.seal()
"""


@pytest.mark.exhaustive
def test_a_process_in_which_calls_failed_ends_in_good_order(tmp_path):
    """libhdf5 crashes when a process ends that has a file which could not be closed."""
    ended = subprocess.run([sys.executable, "-c", FAILING, tmp_path], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
