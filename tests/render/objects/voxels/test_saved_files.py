"""Volumes are written whole or not at all: on a full disk, on a read-only one, after a kill, in a power cut.

The truths are the system's limit on a file's size, its own errors, and the model of power cuts of tests/faults.
"""

import errno
import os
import random
import resource
import time
import warnings
from contextlib import contextmanager

import pytest
from disk_faults import Disk, Faults, stood_in_for
from voxel_cases import balled, skipped_unless

from palpate.datasets.storage.durable import ABANDONED_SECONDS, temporary_name
from palpate.render.errors import VoxelError
from palpate.render.objects.voxels.files import save_voxels

FORMATS = {".npz": None, ".npy": None, ".nrrd": "nrrd", ".nii": "nibabel", ".nii.gz": "nibabel", ".nvdb": None}
OLD = b"what was there before"


@contextmanager
def no_file_beyond(size):
    """Writing more into a file fails, as on a full disk; size [byte]."""
    before, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, most))


@pytest.mark.parametrize("end", FORMATS)
def test_a_full_disk_is_named_and_leaves_the_old_file(end, tmp_path):
    if FORMATS[end]:
        skipped_unless(FORMATS[end])
    path = tmp_path / f"ball{end}"
    with warnings.catch_warnings(action="ignore"):  # of what a format does not hold
        save_voxels(balled(), path)  # imports libraries: within the limit Python would cut off bytecode that it keeps
    path.write_bytes(OLD)
    cause = "(File too large|the disk may be full)"
    with no_file_beyond(300), pytest.raises(VoxelError, match=rf"^{path}: cannot be written \({cause}"):
        save_voxels(balled(), path, overwrite=True)
    assert path.read_bytes() == OLD
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.parametrize("failing", ["open", "fsync", "replace"])
def test_a_folder_that_takes_nothing_is_named_and_keeps_nothing(failing, tmp_path):
    class Refusing(Faults):
        def __call__(self, name, real):
            return super().__call__(name, real) if name == failing else real

    path = tmp_path / "ball.npz"
    faults = Refusing(frozenset(range(9)), errno.EROFS)
    sentence = rf"^{path}: cannot be written \(Read-only file system\)$"
    with stood_in_for(faults), pytest.raises(VoxelError, match=sentence):
        save_voxels(balled(), path)
    assert faults.failed
    assert os.listdir(tmp_path) == []


def test_what_a_killed_process_left_is_removed(tmp_path):
    left = temporary_name(tmp_path / "ball.npz", ".npz")
    left.write_bytes(b"half")
    then = time.time() - ABANDONED_SECONDS - 10
    os.utime(left, (then, then))
    save_voxels(balled(), tmp_path / "ball.npz")
    assert os.listdir(tmp_path) == ["ball.npz"]


@pytest.mark.parametrize("end", [".npz", ".nvdb"])
def test_a_power_cut_leaves_the_old_file_or_the_new_one(end, tmp_path):
    disk_folder, found = tmp_path / "disk", []
    disk_folder.mkdir()
    path = disk_folder / f"ball{end}"
    path.write_bytes(OLD)

    def cut():
        for share in (0.0, 0.5, 1.0):
            folder = tmp_path / str(len(found))
            folder.mkdir()
            disk.lay_out(folder, random.Random(len(found)), share)
            found.append((folder / path.name).read_bytes())

    disk = Disk(disk_folder, cut)
    with disk.recording():
        save_voxels(balled(), path, overwrite=True)
    cut()
    assert set(found) == {OLD, path.read_bytes()}
    assert found[-3:] == [path.read_bytes()] * 3  # all is on the disk when it returns
