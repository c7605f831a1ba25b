"""Volumes beyond what Warp can count: refused by their shape, before anything is read or allocated."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
import warp as wp

from palpate.render import MeshObject
from palpate.render.errors import VoxelError
from palpate.render.objects.voxels.files import read_volume
from palpate.render.objects.voxels.grid import PADDED_MOST, require_room
from palpate.render.objects.voxels.voxel_object import VoxelObject
from palpate.render.objects.voxels.voxeliser import voxelise

LARGE = (1024, 1024, 1024)
REFUSED = (
    r"values must be 715827882 at most, .* \(a cube of 892 a side\), not 1080045576 \(shape \[1024, 1024, 1024\]\)"
)


def test_the_limit_is_that_of_warps_arrays_for_three_edges_of_each_value():
    with pytest.raises(ValueError, match="signed 32-bit"):  # marching cubes number them in one array
        wp.empty(3 * (PADDED_MOST + 1), dtype=wp.int32, device="cpu")
    assert 3 * PADDED_MOST < 2**31
    require_room((892, 892, 892))
    with pytest.raises(VoxelError, match="a cube of 892"):
        require_room((893, 893, 893))
    require_room((1, 1, 2**20))


def test_an_array_is_refused_at_once_with_the_way_out():
    values = np.broadcast_to(np.uint8(1), LARGE)  # one byte
    tracemalloc.start()
    with pytest.raises(VoxelError, match=REFUSED + r".*values\[::2, ::2, ::2\], with 2 times the spacing"):
        VoxelObject(values, spacing=1e-4)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def npy_header():
    """An .npy file that ends before its values."""
    out = io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "|u1", "fortran_order": False, "shape": LARGE})
    return out.getvalue()


def headers_alone(folder):
    """Files of each format that hold a header and no values: who reads on fails otherwise."""
    (folder / "large.npy").write_bytes(npy_header())
    with zipfile.ZipFile(folder / "large.npz", "w") as arrays:
        arrays.writestr("values.npy", npy_header())
    (folder / "large.nrrd").write_text("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1024 1024 1024\nencoding: raw\n\n")
    (folder / "large.nhdr").write_text(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1024 1024 1024\nencoding: raw\ndata file: nowhere.raw\n\n"
    )
    header = np.zeros(352, np.uint8)  # NIfTI-1: size of the header, dimensions, type, bits, offset, magic
    header[:4].view(np.int32)[0] = 348
    header[40:56].view(np.int16)[:] = [3, *LARGE, 1, 1, 1, 1]
    header[70:74].view(np.int16)[:] = [2, 8]
    header[76:108].view(np.float32)[:] = 1.0
    header[108:112].view(np.float32)[0] = 352.0
    header[344:348] = np.frombuffer(b"n+1\0", np.uint8)
    (folder / "large.nii").write_bytes(header.tobytes())


@pytest.mark.parametrize("ending", ["npy", "npz", "nrrd", "nhdr", "nii"])
def test_a_file_is_refused_by_its_header(tmp_path, ending):
    headers_alone(tmp_path)
    with pytest.raises(VoxelError, match=rf"large\.{ending}: " + REFUSED):
        read_volume(tmp_path / f"large.{ending}")


def test_the_layer_around_counts(monkeypatch):
    monkeypatch.setattr("palpate.render.objects.voxels.grid.PADDED_MOST", 12**3)
    monkeypatch.setattr("palpate.render.objects.voxels.voxeliser.PADDED_MOST", 12**3)
    ball = np.linalg.norm(np.indices((10, 10, 10)).T - 4.5, axis=3) - 3
    assert VoxelObject(ball, spacing=0.01, origin=(0, 0, 0.1), kind="distance").outline_mesh()[1].size
    with pytest.raises(VoxelError, match="not 1872 "):  # 12 x 12 x 13
        VoxelObject(np.pad(ball, ((0, 0), (0, 0), (0, 1))), spacing=0.01, kind="distance")
    cube = MeshObject.load("cube")  # 130 mm
    assert max(voxelise(cube, spacing=0.0265, device="cpu").values.shape) == 10
    with pytest.raises(VoxelError, match="needs 11 x 11 x 11 voxels; 1728 are allowed, a layer around them included"):
        voxelise(cube, spacing=0.0225, device="cpu")
