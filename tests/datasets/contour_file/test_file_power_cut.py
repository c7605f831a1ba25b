"""A contour file whose machine loses power, or whose writer is killed, at any moment: what was reported done is there.

`disk_faults.Disk` says what a file system may keep. `PALPATE_FAULTS=N` lays out N more remains at each moment.
"""

import os
import random
import shutil

import pytest
from contour_cases import assert_same, cut_contours, make_contours, make_header, small_chunks, write_file, write_ranges
from disk_faults import Disk

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.contour_file.writer import ContourWriter
from palpate.datasets.errors import ContourFileError

COUNT = 9
MORE = int(os.environ.get("PALPATE_FAULTS", "0"))
CONTOURS, HEADER = make_contours(COUNT), make_header(COUNT)
RANGES = [(0, 3), (3, 4), (4, 9)]
CASES = {
    "ordered": (RANGES, 7, {}),
    "reversed": (RANGES[::-1], 7, {}),
    "overwrite": (RANGES, 7, {"mode": "overwrite"}),
    "resume": (RANGES, 7, {"mode": "resume"}),
}
"""Ranges, rows of a chunk, and options."""


def write_all(path, ranges, done, *, gzip=0, mode="create"):
    """A rendering, each range noted when it is done."""
    with ContourWriter(path, HEADER, mode=mode) as writer:
        for poses in ranges:
            if poses not in done:
                write_ranges(writer, CONTOURS, [poses])
                done.append(poses)
        writer.seal(gzip=gzip)
    done.append("sealed")


def prepared(path, done, ranges, mode):
    """An older file in the way of one that overwrites; a rendering that was interrupted before one that resumes."""
    if mode == "overwrite":
        write_file(path, make_contours(COUNT, seed=3), created="2020")
    if mode == "resume":
        with ContourWriter(path, HEADER) as writer:
            write_ranges(writer, CONTOURS, ranges[:1])
            done.append(ranges[0])


def remains(tmp_path, case, disk_type=Disk):
    """What power cuts leave of a rendering, each different remains once, with what was reported done by then.

    Remains that differ only in what lies under temporary names are one, as no writer reads those.
    """
    ranges, _, options = CASES[case]
    root = tmp_path / "disk"
    root.mkdir()
    done, found, moments = [], {}, 0
    prepared(root / "out.h5", done, ranges, options.get("mode"))

    def cut():
        nonlocal moments
        for number, share in enumerate((0.0, 1.0, 0.5, *[0.5] * MORE)):  # of a kill, all is left
            folder = tmp_path / f"{moments}-{number}"
            folder.mkdir()
            disk.lay_out(folder, random.Random(f"{case} {moments} {number}"), share)
            whole = [p for p in sorted(folder.rglob("*")) if p.suffix != ".tmp"]
            content = [(p.relative_to(folder), p.is_file() and p.read_bytes()) for p in whole]
            if found.setdefault(repr((content, done)), (folder / "out.h5", list(done)))[0].parent != folder:
                shutil.rmtree(folder)
        moments += 1

    disk = disk_type(root, cut)
    with disk.recording():
        write_all(root / "out.h5", ranges, done, **options)
    cut()
    assert moments > 15
    return list(found.values())


def resumed(path, done, mode):
    """Go on after a power cut; which of the ranges that were done are missing."""
    again = "overwrite" if mode == "overwrite" and is_old(path) and not done else "resume"
    ranges = [poses for poses in done if poses != "sealed"]
    if not path.exists():
        for first, stop in ranges:
            with ContourFile(path) as file:
                assert_same(file.contours(first, stop), cut_contours(CONTOURS, first, stop))
    with ContourWriter(path, HEADER, mode=again) as writer:
        missing = writer.missing()
        write_ranges(writer, CONTOURS, missing)
        writer.seal()
    assert check_file(path) == []
    with ContourFile(path) as file:
        assert_same(file.contours(), CONTOURS)
    return [poses for poses in ranges if any(a < poses[1] and poses[0] < b for a, b in missing)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", CASES)
def test_a_power_cut_loses_nothing_that_was_reported_done_and_resuming_completes(tmp_path, case):
    mode = CASES[case][2].get("mode")
    with small_chunks(CASES[case][1]):
        for path, done in remains(tmp_path, case):
            if mode == "overwrite" or "sealed" in done:
                assert check_file(path) == []  # of one that overwrites, the old file or the new one
            assert resumed(path, done, mode) == []


def is_old(path):
    """Whether a file is the one that is being overwritten."""
    try:
        with ContourFile(path) as file:
            return file.attributes["created"] == "2020"
    except ContourFileError:
        return False


class Careless(Disk):
    """A disk that forgets to sync blocks, but does sync their names: so a writer would be that forgot it."""

    def _note_fsync(self, result, before, handle):
        found = self.opened_name(handle)
        return (
            None
            if found is not None and found.name.startswith("poses-")
            else super()._note_fsync(result, before, handle)
        )


def is_lost(path, done):
    """Whether what was done is missing, or read as something else."""
    try:
        return resumed(path, done, None) != []
    except (AssertionError, ContourFileError):
        return True


@pytest.mark.exhaustive
def test_the_model_finds_a_sync_that_is_missing(tmp_path):
    with small_chunks(7):
        assert any(is_lost(path, done) for path, done in remains(tmp_path, "ordered", Careless))
