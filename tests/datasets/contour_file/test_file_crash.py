"""Whatever fails while a contour file is written, what was committed is there, and resuming completes it."""

import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from contour_cases import (
    assert_same,
    cut_contours,
    make_contours,
    make_header,
    write_file,
    write_ranges,
)

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

PROCESS = Path(__file__).parents[2] / "faults" / "contour_process.py"


def assert_whole(path, contours):
    assert check_file(path) == []
    assert not path.with_name(path.name + ".partial").exists()
    with ContourFile(path) as file:
        assert_same(file.contours(), contours)


def assert_kept(path, contours, done):
    """Every range committed is readable and right."""
    if done:
        with ContourFile(path) as file:
            for first, stop in done:
                assert_same(file.contours(first, stop), cut_contours(contours, first, stop))


def test_a_block_is_on_the_disk_before_it_has_its_name_and_the_name_before_it_is_committed(tmp_path, monkeypatch):
    contours = make_contours(20)
    with ContourWriter(tmp_path / "out.h5", make_header(20)) as writer:
        write_ranges(writer, contours, [(0, 20)], held=True)
        calls: list[tuple[str, str, int]] = []
        opened: dict[int, str] = {}
        real_open, real_fsync, real_replace = os.open, os.fsync, os.replace

        def noted_open(path, *args):
            opened[handle := real_open(path, *args)] = Path(path).name
            return handle

        monkeypatch.setattr(os, "open", noted_open)
        monkeypatch.setattr(os, "fsync", lambda h: (calls.append(("sync", opened[h], writer.committed)), real_fsync(h)))
        monkeypatch.setattr(
            os, "replace", lambda a, b: (calls.append(("name", Path(b).name, writer.committed)), real_replace(a, b))
        )
        writer.commit()
        monkeypatch.undo()
        assert writer.committed == 20
    block = "poses-000000000000-000000000020.h5"
    assert calls == [("sync", block + ".tmp", 0), ("name", block, 0), ("sync", "out.h5.partial", 0)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("delay", [0.0, 0.06])
def test_kill_9_loses_nothing_reported_done_and_resuming_completes(tmp_path, delay):
    path, contours = tmp_path / "out.h5", make_contours(120)
    command = [sys.executable, PROCESS, path]
    with subprocess.Popen([*command, "create", "120", "3"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline()]
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        lines += process.stdout.readlines()
    done = [tuple(map(int, line.split()[1:])) for line in lines if line.startswith("done")]
    assert done
    assert_kept(path, contours, done)
    finished = subprocess.run([*command, "resume", "120", "50"], capture_output=True, text=True, check=True)
    assert finished.stdout.endswith("sealed\n")
    assert_whole(path, contours)


@contextmanager
def file_size_limit(size):
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, old[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)


def test_poses_over_the_file_size_limit_fail_alone(tmp_path):
    path, contours = tmp_path / "out.h5", make_contours(800)
    with ContourWriter(path, make_header(800)) as writer:
        write_ranges(writer, contours, [(0, 10)])
        with (
            file_size_limit(60_000),
            pytest.raises(
                ContourFileError, match=r"cannot write poses 10 to 800: File too large.* 10 poses .*mode=.resume"
            ),
        ):
            write_ranges(writer, contours, [(10, 800)])
        assert writer.missing() == []  # what could not be committed is still held
        assert writer.committed == 10
        assert_kept(path, contours, [(0, 10)])
        writer.seal()
        assert_whole(path, contours)


@pytest.mark.exhaustive
@pytest.mark.parametrize("held", [False, True])
def test_sealing_over_the_file_size_limit_keeps_everything_and_the_old_file(tmp_path, held):
    path, contours, before = tmp_path / "out.h5", make_contours(400), make_contours(3, seed=9)
    write_file(path, before)
    with ContourWriter(path, make_header(400), mode="overwrite") as writer:
        write_ranges(writer, contours, [(200, 400), (0, 200)], held=held)
        with (
            file_size_limit(100_000),
            pytest.raises(ContourFileError, match=r"cannot seal: File too large.*MB are free"),
        ):
            writer.seal()
        assert not list(tmp_path.glob("**/*.tmp"))
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), before)
    with ContourWriter(path, make_header(400), mode="resume") as writer:
        assert writer.missing() == []
        writer.seal()
    assert_whole(path, contours)


def test_a_header_that_does_not_fit_leaves_no_folder_behind(tmp_path):
    with file_size_limit(1000), pytest.raises(ContourFileError, match="cannot prepare: File too large"):
        ContourWriter(tmp_path / "out.h5", make_header(40))
    assert list(tmp_path.iterdir()) == []
