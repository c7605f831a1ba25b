"""Real volumes and real open meshes go through render -> check -> play."""

import importlib.util
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from palpate.datasets import check_file
from palpate.datasets.shapes.built_in import shape
from palpate.render import (
    MeshObject,
    Palm,
    Placement,
    VoxelObject,
    closed_contour,
    exploration,
    play_file,
    record,
    render,
    voxelise,
)
from palpate.render.errors import MeshError, PalpateWarning
from palpate.render.playback.file_playback import Connection

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


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "make",
    [rocks, white_matter, "meshes/dog_skull_1200.stl", "hands/left.glb"],
    ids=lambda m: getattr(m, "__name__", m),
)
def test_a_real_object_is_rendered_and_played(make, tmp_path, request):
    thing = torn(request.getfixturevalue("outside_data") / make) if isinstance(make, str) else make()
    motion = exploration(thing.bounds, duration=1.0, rate=90.0, seed=1, model="around")
    path = tmp_path / "real.h5"
    record(path, thing, Palm(), motion, closed_contour())
    assert check_file(path) == []
    told = play_file(path, array="emulator", connection=Connection(clock="virtual")).as_dict()
    assert told["frames"] == 10_000
    assert told["board_underruns"] == 0


@pytest.mark.exhaustive
@pytest.mark.filterwarnings("ignore:.*open edges")
def test_a_torn_dog_made_of_voxels_is_the_dog():
    """As the whole one in voxels of the same size; what these lose of thin ears and sharp edges is not the tear's."""
    vertices, faces = shape("dog")
    whole, torn_one = MeshObject(vertices, faces, name="dog"), MeshObject(vertices, faces[3:], name="torn dog")
    things = [whole, *(voxelise(thing, spacing=0.0015) for thing in (whole, torn_one))]
    motion = exploration(whole.bounds, duration=6.0, rate=30.0, seed=1, model="around")
    strategy = replace(closed_contour(), step=0.0005)
    mesh, solid, closed = (render(thing, Palm(), motion, strategy).length().mean() for thing in things)
    assert mesh > 0.02
    assert closed == pytest.approx(solid, rel=0.005)
    assert closed == pytest.approx(mesh, rel=0.06)
