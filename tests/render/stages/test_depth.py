"""The stage "depth" against every triangle, grid point and point in NumPy, wherever the object and the hand are."""

import numpy as np
import pytest
import trimesh
from depth_oracle import weighed
from transform_cases import a_setting, near_poses, rendered, run_stage

from palpate.render import MeshObject, Palm, PlaneHand, Scene, Stage, static_pose
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.stages.depth import CACHE_SIZE, mesh_of
from palpate.render.strategies.intersection_strategy import closed_then

DEFAULTS = {"shallow": 0.0, "deep": 0.02, "lowest": 0.3, "grid": 9, "spacing": 0.004}
RAMPS = [{}, {"shallow": 0.003, "deep": 0.009, "lowest": 0.0}, {"shallow": 0.007, "deep": 0.001}]


@pytest.mark.exhaustive(after=6)
@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("at", ["patch", "pose", "point"])
@pytest.mark.parametrize("ramp", RAMPS)
@pytest.mark.parametrize(("thing", "count", "grid"), [("tube", 4, 4), ("tube", 10, 9), ("dog", 4, 9)])
def test_intensities_are_those_of_the_oracle(thing, count, grid, ramp, at, moved, device, rng):
    hand = Palm() if thing == "tube" else flat_hand()
    batch, setting = rendered(rng, device, thing=thing, hand=hand, moved=moved, count=count)
    options = {**DEFAULTS, **ramp, "at": at, "grid": grid}
    got, want = run_stage("depth", batch, setting, **options), weighed(batch, setting, **options)
    assert got.by_name().keys() == want.by_name().keys()
    np.testing.assert_array_equal(got.points, want.points)
    off = np.abs(got.intensity.astype(np.float64) - want.intensity)
    if ramp.get("deep") == 0.001:  # a step: a micrometre decides at its edge
        assert np.count_nonzero(off > 1e-6) <= 0.01 * len(off)
    else:
        assert off.max() < 1e-6 / (options["deep"] - options["shallow"])  # of intensity for a micrometre
    assert np.ptp(want.intensity) > 0.1


@pytest.mark.parametrize("at", ["patch", "pose", "point"])
def test_a_patch_that_is_absent_has_no_depth(at, device, rng):
    patches = flat_hand().patches[:3]
    own = near_poses(rng, 4 * 3).reshape(4, 3, 7)
    own[:, 0] = np.nan
    own[3] = np.nan
    hand = PlaneHand(patches, patch_pose=own)
    pose = np.tile(np.array([0, 0, 0, 0, 0, 0, 1], np.float32), (4, 1))
    solid, options = MeshObject.load("tube"), {**DEFAULTS, "grid": 3, "at": at}
    raw, _ = Scene.of(solid, hand, "cc").contours(pose, 0, device)
    batch, setting = raw.numpy(), a_setting(pose, solid=solid, hand=hand, device=device)
    got = run_stage("depth", batch, setting, **options)
    np.testing.assert_allclose(got.intensity, weighed(batch, setting, **options).intensity, atol=1e-4)
    assert np.diff(got.pose_start)[3] == 0


def test_a_mesh_is_made_once_for_an_object_and_the_oldest_go(device):
    solids = [MeshObject.load("cube", at=(0, 0, 0.2 + 0.01 * k)) for k in range(CACHE_SIZE + 1)]
    first = mesh_of(solids[0], device)
    assert mesh_of(MeshObject.load("cube", at=(0, 0, 0.2)), device) is first
    for solid in solids[1:]:
        mesh_of(solid, device)
    assert mesh_of(solids[0], device) is not first


@pytest.mark.filterwarnings("ignore:.*reaches behind the array")  # where its file has it
@pytest.mark.parametrize("moved", [False, True])
def test_points_near_the_origin_of_the_objects_file_have_their_depth(moved, device):
    """An object that moves is mostly in a file round its own origin; the first point asked about may lie there."""
    place = np.array([0, 0, 0.2])
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.06)
    solid = MeshObject(ball if moved else ball.apply_translation(place))
    object_pose = np.array([[*place, 0, 0, 0, 1]], np.float32) if moved else None
    strategy = closed_then("centroid", Stage("depth", {"at": "point"}))()
    scene = Scene.of(solid, Palm(), strategy, object_pose=object_pose)
    batch, _ = scene.contours(static_pose(place).pose, 0, device)
    batch = batch.numpy()
    assert np.linalg.norm(batch.points - place, axis=1).max() < 0.004
    np.testing.assert_array_equal(batch.intensity, 1.0)  # 56 mm deep, where 20 are enough
