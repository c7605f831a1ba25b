"""Real volumes and real open meshes go through render -> check -> play."""

import importlib.util
import warnings
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from palpate.datasets import check_file, exploration
from palpate.datasets.shapes import shape
from palpate.render import MeshObject, Palm, Placement, VoxelObject, closed_contour, play_file, record, render, voxelise
from palpate.render.errors import MeshError, PalpateWarning
from palpate.render.playback import Connection

PLACED = Placement(fit=0.13, at=(0, 0, 0.2))


def rocks():
    path = Path(wp.__file__).parent / "examples" / "assets" / "rocks.nvdb"
    if not path.is_file():
        pytest.skip("this Warp's wheel has no rocks.nvdb")
    return VoxelObject.load(path, placement=PLACED)


def white_matter():
    spec = importlib.util.find_spec("nilearn")  # its data only: importing it takes seconds
    if spec is None or importlib.util.find_spec("nibabel") is None:
        pytest.skip("nilearn, whose wheel has a segmented brain, or nibabel, is not installed")
    path = Path(spec.origin).parent / "datasets" / "data" / "mni_icbm152_wm_tal_nlin_sym_09a_converted.nii.gz"
    return VoxelObject.load(path, level=128.0, placement=PLACED)


def torn(path):
    """A real mesh with a twentieth of its triangles missing, as voxels; it must be refused as it is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)  # what is mended is another test's
        whole = MeshObject.load(path, placement=PLACED)
        kept = np.random.default_rng(2).random(len(whole.faces)) > 0.05
        thing = MeshObject(whole.vertices, whole.faces[kept], name=path.name)
        with pytest.raises(MeshError, match="palpate voxelise"):
            thing.require_closed()
        return voxelise(thing, spacing=0.002)


@pytest.mark.parametrize("make", [rocks, white_matter, "meshes/dog_skull_1200.stl", "hands/left.glb"], ids=str)
def test_a_real_object_is_rendered_and_played(make, tmp_path, request):
    if isinstance(make, str):
        thing = torn(request.getfixturevalue("outside_data") / make)
    else:
        thing = make()
    motion = exploration(thing.bounds, duration=1.0, rate=90.0, seed=1)
    path = tmp_path / "real.h5"
    record(path, thing, Palm(), motion, closed_contour())
    assert check_file(path) == []
    told = play_file(path, array="emulator", connection=Connection(clock="virtual")).as_dict()
    assert told["frames"] == 10_000
    assert told["board_underruns"] == 0


def test_a_torn_dog_made_of_voxels_is_the_dog():
    vertices, faces = shape("dog")
    whole = MeshObject(vertices, faces, name="dog")
    closed = voxelise(MeshObject(vertices, faces[3:], name="torn dog"), spacing=0.0015)
    motion = exploration(whole.bounds, duration=6.0, rate=30.0, seed=1)
    lengths = [render(thing, Palm(), motion, closed_contour()).length().mean() for thing in (whole, closed)]
    assert lengths[0] > 0.02
    assert lengths[1] == pytest.approx(lengths[0], rel=0.05)
