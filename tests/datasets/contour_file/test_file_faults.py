"""A contour file whose system calls fail, and one whose machine loses power: nothing that was reported done is lost.

`PALPATE_FAULTS=N` makes N runs of each test at random besides those that are always made.
"""

import errno
import os
import random
import subprocess
import sys
from collections import Counter

import pytest
from contour_cases import assert_same, cut_contours, make_contours, make_header, small_chunks, write_file, write_ranges
from disk_faults import Faults, stood_in_for

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

COUNT = 9
MORE = int(os.environ.get("PALPATE_FAULTS", "0"))
ORDERS = {"in order": [(0, 3), (3, 4), (4, 9)], "any order": [(4, 9), (0, 3), (3, 4)]}
TRIES = 8
CONTOURS, HEADER = make_contours(COUNT), make_header(COUNT)


def assert_whole(path):
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), CONTOURS)


def assert_kept(path, done):
    """Every range that was reported done is there and right, unless an older file of the name hides it."""
    if done and not (path.exists() and path.with_name("out.h5.partial").exists()):
        with ContourFile(path) as file:
            for first, stop in done:
                assert_same(file.contours(first, stop), cut_contours(CONTOURS, first, stop))


def commit(writer, poses):
    """Write a range, unless it is held or there already, and have it on the disk."""
    if any(first <= poses[0] < stop for first, stop in writer.missing()):
        write_ranges(writer, CONTOURS, [poses], held=True)
    writer.commit()


def write_all(writer, ranges, done, *, gzip=0):
    """Write what is missing of the ranges and seal, each step again in the same writer while it fails.

    Returns how many failures the writer reported; raises the last one where it does not get any further.
    """
    steps = [(poses, lambda poses=poses: commit(writer, poses)) for poses in ranges if poses not in done]
    reported = 0
    for poses, step in [*steps, (None, lambda: writer.seal(gzip=gzip))]:
        for attempt in range(TRIES):
            try:
                step()
                break
            except ContourFileError:
                reported += 1
                assert_kept(writer.path, done)
                if attempt == TRIES - 1:
                    raise
        if poses:
            done.append(poses)
    return reported


def rendered(path, faults, ranges, *, gzip=0, mode="create"):
    """A rendering during which calls fail: gone on with by the same writer, by a new one where that gives up."""
    done, reported = [], 0
    for attempt in range(TRIES):
        try:
            with stood_in_for(faults):
                again = "resume" if attempt and (done or mode == "create") else mode
                with ContourWriter(path, HEADER, mode=again) as writer:
                    unlucky = [p for p in done if any(a < p[1] and p[0] < b for a, b in writer.missing())]
                    assert unlucky == []
                    reported += write_all(writer, ranges, done, gzip=gzip)
            return reported
        except ContourFileError:
            reported += 1
    raise AssertionError(f"{faults.failed} kept it from ending")


def assert_outlived(path, faults, ranges, **options):
    """Whatever failed, the file is that of an undisturbed run; what would have lost something was reported."""
    reported = rendered(path, faults, ranges, **options)
    assert_whole(path)
    assert not path.with_name("out.h5.partial").exists() or "unlink" in faults.failed or "rmdir" in faults.failed
    if set(faults.failed) & {"write", "pwrite", "fsync", "fdatasync", "replace", "rename"}:
        assert reported, faults.failed


def calls_to_fail(folder, ranges, **options):
    """Numbers of the calls of an undisturbed run, every second; of the many by which libhdf5 writes every 40th."""
    faults = Faults(frozenset())
    (folder / "undisturbed").mkdir()
    prepared(folder / "undisturbed", options)
    rendered(folder / "undisturbed" / "out.h5", faults, ranges, **options)
    many = [k for k, own in enumerate(faults.names) if own == "pwrite"]
    few = [k for k, own in enumerate(faults.names) if own != "pwrite"]
    return sorted([*few[:: 1 if MORE else 2], *many[:: 1 if MORE else 40]])


def prepared(folder, options):
    """An older file in the way of one that overwrites."""
    if options.get("mode") == "overwrite":
        write_file(folder / "out.h5", make_contours(COUNT, seed=3), created="2020")
    return folder / "out.h5"


CASES = {
    "in order": ("in order", 7, {}),
    "any order, gzip": ("any order", 7, {"gzip": 1}),
    "overwrite": ("in order", 7, {"mode": "overwrite"}),
}
"""Order of the ranges, rows of a chunk, and options."""


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", CASES)
def test_a_call_that_fails_once_is_made_up_for_by_the_same_writer(tmp_path, case):
    order, rows, options = CASES[case]
    with small_chunks(rows):
        numbers = calls_to_fail(tmp_path, ORDERS[order], **options)
        failed = Counter()
        for number in numbers:
            folder = tmp_path / str(number)
            folder.mkdir()
            faults = Faults(frozenset([number]), errno.ENOSPC if number % 3 else errno.EIO, is_torn=number % 2 == 0)
            assert_outlived(prepared(folder, options), faults, ORDERS[order], **options)
            failed.update(faults.failed)
    assert failed.total() == len(numbers) > 25
    assert {"open", "pwrite", "fsync", "replace"} <= set(failed)


@pytest.mark.exhaustive
@pytest.mark.parametrize("run", range(12 + MORE))
def test_several_calls_that_fail_are_made_up_for(tmp_path, run):
    rng = random.Random(run)
    order, rows, options = CASES[rng.choice(list(CASES))]
    numbers = frozenset(rng.randrange(340) for _ in range(rng.choice((2, 3, 5))))
    faults = Faults(numbers, rng.choice((errno.EIO, errno.ENOSPC, errno.EDQUOT)), rng.random() < 0.5)
    with small_chunks(rows):
        assert_outlived(prepared(tmp_path, options), faults, ORDERS[order], **options)
    assert faults.failed


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
