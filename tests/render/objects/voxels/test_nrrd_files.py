"""NRRD files whose axes are more than those of a place."""

import numpy as np
import pytest

from palpate.render.errors import VoxelError
from palpate.render.objects.voxels.files import read_volume, without_lists
from palpate.render.objects.voxels.voxel_object import VoxelObject


def layer(header, values, path):
    """Write a NRRD with pynrrd's fields."""
    pytest.importorskip("nrrd").write(str(path), values, header)
    return path


def test_nrrd_of_one_layer_is_its_layer(tmp_path):
    """A segmentation of 3D Slicer: first an axis of layers, without a direction; here with one layer."""
    values = np.arange(24, dtype=np.uint8).reshape(1, 2, 3, 4)
    directions = np.array([[np.nan] * 3, [2.0, 0, 0], [0, 3.0, 0], [0, 0, 4.0]])
    kinds = ["list", "domain", "domain", "domain"]
    header = {"space": "right-anterior-superior", "space directions": directions, "kinds": kinds}
    header["space origin"] = np.array([0.0, 0.0, 200.0])
    volume = read_volume(layer(header, values, tmp_path / "a.nrrd"))
    np.testing.assert_array_equal(volume.values, values[0])
    np.testing.assert_allclose(volume.affine[:3], [[0.002, 0, 0, 0], [0, 0.003, 0, 0], [0, 0, 0.004, 0.2]], rtol=1e-12)
    spaced = {"kinds": kinds, "spacings": [np.nan, 2.0, 3.0, 4.0], "units": ["", "mm", "mm", "mm"]}
    volume = read_volume(layer(spaced, values, tmp_path / "b.nrrd"))
    np.testing.assert_array_equal(volume.values, values[0])
    np.testing.assert_allclose(np.diag(volume.affine), [0.002, 0.003, 0.004, 1.0], rtol=1e-12)
    slab = {"space": "RAS", "space directions": directions[1:], "space origin": header["space origin"]}
    assert read_volume(layer(slab, values[0, :1], tmp_path / "c.nrrd")).values.shape == (1, 3, 4)
    with pytest.raises(VoxelError, match=r"not \[2, 2, 3, 4\].* choose one: VoxelObject\(values"):
        VoxelObject.load(layer(header, np.repeat(values, 2, axis=0), tmp_path / "d.nrrd"))


@pytest.mark.parametrize("field", ["spacings", "units", "kinds"])
def test_fields_without_an_entry_for_each_axis_are_named(field):
    with pytest.raises(VoxelError, match=f"{field} must have 4 entries, one for each axis"):
        without_lists(np.zeros((1, 2, 3, 4)), {field: ["a", "b", "c"]})
