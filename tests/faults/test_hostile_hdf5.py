"""Hostile HDF5 files: each operation on each gives one clear error, in time and in memory; never a signal or a hang."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import FAILED, run
from contour_cases import everything, make_contours, write_file
from hostile_hdf5 import CASES, OPERATIONS, sound, write_case

from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.storage.hdf5_opening import open_hdf5
from palpate.datasets.storage.hdf5_source import collection_size, refuse_endless_heap

GROUPS = 6  # each is a process, which takes seconds to start


@pytest.mark.exhaustive
@pytest.mark.parametrize("group", range(GROUPS))
def test_hostile_files_are_refused_with_a_clear_error(tmp_path, group):
    names = list(CASES)[group::GROUPS]
    command = [sys.executable, Path(__file__).with_name("hostile_process.py"), tmp_path, *names]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row for row in rows if row["short"]] == []
    assert len(rows) == sum(len(OPERATIONS[CASES[name].kind]) for name in names)


def test_a_refusal_names_the_file_the_path_inside_the_value_and_the_bound(tmp_path):
    """Of files that are quick to make and do not wait if they are read."""
    for name in (
        "a virtual dataset on itself",
        "a link to another file in place of a group",
        "a soft link in place of a dataset",
        "external data of a system file",
        "points of 1e9 rows in one piece that were never written",
        "a compound in /contours/points",
        "a seed of three dimensions",
        "a version below zero",
        "an offset of text",
    ):
        path = tmp_path / "hostile.h5"
        write_case(name, path)
        problems = check_file(path)
        assert any(CASES[name].message in problem and str(path) in problem for problem in problems), (name, problems)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("mode", ["r", "r+", "a"])
@pytest.mark.parametrize("options", [{}, {"locking": True}, {"libver": "latest"}], ids=str)
def test_a_file_that_this_process_holds_open_in_h5py_is_checked_and_read(tmp_path, mode, options):
    path = tmp_path / "held.h5"
    path.write_bytes(sound("contours"))
    with h5py.File(path, mode, **options) as held:
        points = held["/contours/points"][...]
        assert check_file(path) == []
        with ContourFile(path) as file:
            np.testing.assert_array_equal(file.contours()["points"], points)
            with h5py.File(path, mode, **options) as again:
                np.testing.assert_array_equal(again["/contours/points"], points)
        assert run("info", path, "--json").exit_code == 0


@pytest.mark.parametrize("libver", ["earliest", "latest"])
@pytest.mark.parametrize("options", [{}, {"compression": "gzip", "shuffle": True}, {"compression": "lzf"}], ids=str)
def test_what_other_writers_leave_is_read_as_h5py_reads_it(tmp_path, libver, options):
    path = tmp_path / "other.h5"
    rows = np.random.default_rng(1).normal(size=(5000, 7))
    with h5py.File(path, "w", libver=libver) as file:
        file.create_dataset("/a/chunked", data=rows, chunks=(64, 7), fletcher32=True, **options)
        file.create_dataset("/a/growing", data=rows, chunks=(100, 7), maxshape=(None, 7), **options)
        file["/a/plain"], file["/b"] = rows.astype(">f4"), rows.astype(np.int16)
    with open_hdf5(path) as opened, h5py.File(path) as file:
        for name in ("/a/chunked", "/a/growing", "/a/plain", "/b"):
            np.testing.assert_array_equal(opened.read(name, 7, 4001), file[name][7:4001])
            assert opened.read(name).dtype.isnative


@pytest.mark.parametrize("length", [13, 20_000])
def test_a_heap_in_which_libhdf5_walks_for_ever_is_refused(tmp_path, length):
    path = tmp_path / "heap.h5"
    with h5py.File(path, "w") as file:
        file.attrs["text"] = "x" * length
    content = bytearray(path.read_bytes())
    begin = content.index(b"GCOL")
    size = collection_size(memoryview(content)[begin:])
    assert size >= max(length, 4096)
    refuse_endless_heap(memoryview(content)[begin : begin + size])
    free = 16 + 16 + -(-length // 8) * 8  # behind the collection's head, and the text with its own
    if size - free < 16:
        free = 16  # the text fills it: it becomes the free space
    struct.pack_into("<HHIQ", content, begin + free, 0, 0, 0, 0)
    path.write_bytes(content)
    with open_hdf5(path) as opened, pytest.raises(OSError, match=f"object 0 at byte {free} takes 0 of {size} bytes"):
        opened.attribute("/", "text")


@pytest.mark.exhaustive
def test_what_the_format_does_not_name_is_no_fault(tmp_path):
    path = tmp_path / "more.h5"
    write_file(path, make_contours(30, intensity=True, dwell=True), chunk=11, **everything(30))
    with h5py.File(path, "r+") as file:
        file["/contours/colour"] = np.zeros(3)
        file["/focus/deep/points"] = np.zeros(3)
        file["/contours/points"].attrs["author"] = "me"
        file.attrs["note"] = "mine"
    told = run("check", path, "--json")
    assert (told.exit_code, json.loads(told.stdout)) == (0, {"path": str(path), "whole": True, "problems": []})
    path.write_bytes(path.read_bytes()[:-1])
    assert run("check", path).exit_code == FAILED
