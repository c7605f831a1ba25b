"""Whatever fails while a contour file is written, what was reported done is there, and resuming completes it."""

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
    Killed,
    assert_same,
    cut_contours,
    killed_at,
    make_contours,
    make_header,
    small_chunks,
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
    """Every range reported done is readable and right."""
    if done:
        with ContourFile(path) as file:
            for first, stop in done:
                assert_same(file.contours(first, stop), cut_contours(contours, first, stop))


def test_rows_are_on_the_disk_before_their_record_and_the_record_before_they_are_done(tmp_path, monkeypatch):
    contours = make_contours(20)
    with small_chunks(), ContourWriter(tmp_path / "out.h5", make_header(20)) as writer:
        write_ranges(writer, contours, [(0, 2)])
        calls: list[str] = []
        opened: dict[int, str] = {}
        real_open = os.open

        def noted_open(path, *args):
            handle = real_open(path, *args)
            opened[handle] = Path(path).suffix
            return handle

        monkeypatch.setattr(os, "open", noted_open)
        for name in ("pwritev", "fsync"):
            real = getattr(os, name)
            monkeypatch.setattr(
                os, name, lambda handle, *args, n=name, r=real: (calls.append(n + opened[handle]), r(handle, *args))[1]
            )
        write_ranges(writer, contours, [(2, 20)])
    assert calls == ["pwritev.rows", "fsync.rows", "pwritev.log", "fsync.log"]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("step", [0, 1, 2, 3])
def test_what_an_interrupted_write_left_is_not_found_behind_a_shorter_one(tmp_path, step):
    path, contours = tmp_path / "out.h5", make_contours(40)
    with small_chunks():
        with ContourWriter(path, make_header(40)) as writer:
            write_ranges(writer, contours, [(0, 4)])
            with pytest.raises(Killed), killed_at(step):
                write_ranges(writer, contours, [(4, 40)])
            write_ranges(writer, contours, [(4, 6)])
        with ContourWriter(path, make_header(40), mode="resume") as writer:
            assert (writer.missing(), writer.repairs) == ([(6, 40)], ())
            write_ranges(writer, contours, [(6, 40)])
            writer.seal()
        assert_whole(path, contours)


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


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("limit", "rows"), [(60_000, 8192), (80_000, 7)], ids=["log", "rows"])
def test_poses_over_the_file_size_limit_fail_alone(tmp_path, limit, rows):
    path, contours = tmp_path / "out.h5", make_contours(800)
    with small_chunks(rows), ContourWriter(path, make_header(800)) as writer:
        write_ranges(writer, contours, [(0, 10)])
        with (
            file_size_limit(limit),
            pytest.raises(
                ContourFileError, match=r"cannot write poses 10 to 800: File too large.* 10 poses .*mode=.resume"
            ),
        ):
            write_ranges(writer, contours, [(10, 800)])
        assert writer.missing() == [(10, 800)]
        assert_kept(path, contours, [(0, 10)])
        write_ranges(writer, contours, [(10, 800)])
        writer.seal()
        assert_whole(path, contours)


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [[(0, 400)], [(200, 400), (0, 200)]], ids=["in place", "copied"])
def test_sealing_over_the_file_size_limit_keeps_everything_and_the_old_file(tmp_path, order):
    path, contours, before = tmp_path / "out.h5", make_contours(400), make_contours(3, seed=9)
    write_file(path, before)
    with ContourWriter(path, make_header(400), mode="overwrite") as writer:
        write_ranges(writer, contours, order)
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
