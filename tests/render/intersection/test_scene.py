"""What a scene settles before it renders: about what a moved object turns, where and when the focal width counts."""

from dataclasses import replace

import numpy as np
import pytest
from implicit_functions import ball
from mesh_cases import generic_poses

from palpate.datasets import HandMotion
from palpate.datasets.contour_file.check import check_file
from palpate.datasets.contour_file.reader import ContourFile
from palpate.render import ImplicitObject, MeshObject, Palm, Placement, VoxelObject, closed_contour, record, render
from palpate.render.contour_batch import join_batches
from palpate.render.errors import PoseError, StrategyError
from palpate.render.focal_spot import focal_width
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.intersection.scene import Scene
from palpate.render.objects.functions import implicit_object
from palpate.render.objects.functions.expression import box, sphere
from palpate.render.reports.scene_drawing import object_at
from palpate.render.stages.registry import Stage

TUBE, CC = MeshObject.load("tube"), closed_contour()
STEP = replace(CC, step=0.004)


def cut_sphere():
    return ImplicitObject((sphere(0.03) - box(0.1, 0.1, 0.03).moved(0, 0, 0.03)).moved(0, 0, 0.2))


def function():
    loose = [[-0.05] * 3, [0.09, 0.05, 0.07]]
    return ImplicitObject(ball, bounds=loose, placement=Placement(at=(0, 0, 0.2)), name="ball")


def voxels():
    inside = np.zeros((40, 30, 30), bool)
    inside[5:20, 5:-5, 5:-5] = True
    return VoxelObject(inside, spacing=0.002, origin=(0, 0, 0.15))


def poses_at(place, count=12):
    poses = generic_poses(count, 7)
    poses[:, :3] += (place - poses[:, :3].mean(axis=0)).astype(np.float32)
    return poses


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [cut_sphere, function, voxels])
def test_an_object_that_stays_where_it_was_placed_is_one_that_stands_still(make):
    thing = make()
    middle = thing.bounds.mean(axis=0)
    hands = poses_at(middle)
    still = np.tile(np.array([*middle, 0, 0, 0, 1], np.float32), (len(hands), 1))
    batch, expected = (render(thing, Palm(), hands, STEP, object_pose=moved) for moved in (still, None))
    assert expected.length().max() > 0.02
    np.testing.assert_array_equal(batch.pose_start, expected.pose_start)
    np.testing.assert_allclose(batch.length(), expected.length(), atol=1e-5)


def test_a_file_tells_where_the_middle_of_its_outline_is_so_that_pictures_are_right(tmp_path, monkeypatch):
    monkeypatch.setattr(implicit_object, "OUTLINE", 24)  # cells along the longest side, which is quicker
    thing, path = cut_sphere(), tmp_path / "cut.h5"
    outline = thing.outline_mesh()[0].astype(np.float64)
    middle = thing.bounds.mean(axis=0)
    assert np.abs(outline.min(axis=0) + outline.max(axis=0) - 2 * middle).max() > 0.01
    turn = np.sqrt(0.5)
    moved = np.array([[0.01, 0.02, 0.25, turn, 0, 0, turn]] * 3, np.float32)  # a quarter turn about x
    motion = HandMotion(np.arange(3) / 90, poses_at(np.array([0.01, 0.02, 0.25]), 3))
    record(path, thing, Palm(), motion, STEP, object_pose=moved)
    assert check_file(path) == []
    away = outline - middle
    expected = np.stack([away[:, 0], -away[:, 2], away[:, 1]], axis=1) + moved[0, :3]
    with ContourFile(path) as file:
        kept = file.object()
        shown = object_at(kept, 1)
        np.testing.assert_allclose(shown, expected[kept["faces"]], atol=1e-6)


def test_the_focal_width_is_that_where_a_moving_object_is():
    moved = np.array([[0, 0, z, 0, 0, 0, 1] for z in (0.28, 0.3, 0.5)], np.float32)
    scene = Scene.of(TUBE, Palm(), replace(CC, transform=(Stage("close"), Stage("hatch"))), object_pose=moved)
    assert scene.focal_width == pytest.approx(focal_width(0.3).width, rel=1e-6)


def test_the_focal_width_is_asked_for_only_where_something_is_scaled_by_it():
    near = ImplicitObject(sphere(0.004).moved(0.00525, 0.00525, 0.005))  # 5 mm above a transducer
    assert Scene.of(near, Palm(), STEP).focal_width == 0.0
    scaled = replace(STEP, transform=("close", "hatch"))
    given = replace(STEP, transform=("close", Stage("hatch", {"spacing": 0.005})))
    for strategy in (CC, scaled):
        with pytest.raises(StrategyError, match="focal width: point"):
            Scene.of(near, Palm(), strategy)
    scene = Scene.of(near, Palm(), given)
    assert scene.strategy.described()["step"] == 0.004
    assert all(value is not None for stage in scene.strategy.transform_stages for value in stage.options.values())


@pytest.mark.parametrize(
    ("parts", "error", "said"),
    [
        ((Palm(), Palm(), CC), StrategyError, "comes after the object: the order is object, hand, motion"),
        ((TUBE, None, CC), StrategyError, "the hand must be a Palm, .* not None"),
        ((TUBE, Palm(), 5), StrategyError, "the strategy must be an IntersectionStrategy .* not 5"),
        ((TUBE, Palm(), "hacth"), StrategyError, "did you mean 'hatch'"),
    ],
)
def test_what_is_no_part_of_a_scene_is_refused_with_what_is(parts, error, said):
    with pytest.raises(error, match=said):
        render(*parts[:2], generic_poses(2, 1), parts[2])


def test_rows_of_a_hand_that_are_not_the_motions_are_an_error_of_poses():
    own = np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (3, 1, 1))
    skin = np.tile(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]]), (3, 1, 1))
    for hand in (PlaneHand((HandPatch("palm", 0.08, 0.08),), (), own), MeshHand(skin, [[0, 1, 2]])):
        with pytest.raises(PoseError, match="articulated for 3 poses, but the motion has 2"):
            render(TUBE, hand, generic_poses(2, 1), STEP)


def test_batches_and_files_carry_the_bound_of_error(tmp_path):
    """A cube's contour on a palm is an exact rectangle; float32's spacing is NumPy's."""
    cube, palm = MeshObject.load("cube"), Palm()
    motion = np.tile(np.array([*cube.bounds.mean(axis=0), 0.7071068, 0, 0, 0.7071068], np.float32), (4, 1))
    batch = render(cube, palm, motion, closed_contour())
    assert batch.raw_error == np.spacing(np.float32(np.abs(cube.bounds).max()))
    assert np.abs(batch.points[:, :2]).max() - np.abs(cube.bounds[:, :2]).max() <= batch.raw_error
    assert batch.select(1, 3).raw_error == join_batches([batch, batch]).raw_error == batch.raw_error
    marched = render(ImplicitObject(sphere(0.03).moved(0, 0, 0.2)), palm, motion, replace(closed_contour(), step=0.002))
    assert marched.raw_error == 0.002
    assert join_batches([batch, marched]).raw_error == 0.002
    assert "raw_error" not in marched.arrays()
    assert join_batches([batch, replace(batch, raw_error=None)]).raw_error is None
    record(tmp_path / "cube.h5", cube, palm, HandMotion(np.arange(4.0), motion), closed_contour())
    with ContourFile(tmp_path / "cube.h5") as file:
        assert file.header().raw_error == batch.raw_error
