"""Volumes are written whole or not at all, whichever library writes them: on a full disk, and to the disk.

The truths are the system's limit on a file's size, and what it is asked to sync.
"""

import os
import resource
import warnings
from contextlib import contextmanager

import pytest
from disk_faults import stood_in_for
from voxel_cases import balled, skipped_unless

from palpate.render.errors import VoxelError
from palpate.render.objects.voxels.voxel_object import save_voxels

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


@pytest.mark.parametrize("end", FORMATS)
def test_what_a_library_has_written_is_on_the_disk(end, tmp_path):
    """The file that is synced is the one that the library wrote, whole by then."""
    if FORMATS[end]:
        skipped_unless(FORMATS[end])
    path, synced = tmp_path / f"ball{end}", {}

    def noted(name, real):
        def call(handle, *rest, **options):
            if name == "fsync":
                synced[os.fstat(handle).st_ino] = os.fstat(handle).st_size
            return real(handle, *rest, **options)

        return call

    with stood_in_for(noted), warnings.catch_warnings(action="ignore"):  # of what a format does not hold
        save_voxels(balled(), path)
    assert synced[path.stat().st_ino] == path.stat().st_size > 300
