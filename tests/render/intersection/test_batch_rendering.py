"""Batches of contours: properties of OC and CC, order, chunks, rigid motions, and the arrays' own rules."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import generic_poses
from scipy.spatial.transform import Rotation

from palpate.datasets.errors import MotionError
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.datasets.shapes.built_in import shape_names
from palpate.render import (
    ContourBatch,
    IntersectionStrategy,
    MeshObject,
    Palm,
    closed_contour,
    open_contour,
    record,
    render,
)
from palpate.render.contour_batch import HAND, OBJECT, join_batches, object_part
from palpate.render.errors import PoseError, StrategyError

OBJECTS = {name: MeshObject.load(name) for name in shape_names()}
PALM = Palm()


def assert_same(one: ContourBatch, two: ContourBatch):
    first, second = one.arrays(), two.arrays()
    assert first.keys() == second.keys()
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


poses_of_cases = st.builds(generic_poses, st.integers(1, 12), st.integers(0, 2**32 - 1), st.floats(0.0, 0.12))
palms = st.builds(Palm, st.floats(0.01, 0.3), st.floats(0.01, 0.3))


@pytest.mark.exhaustive
@settings(max_examples=40)
@given(name=st.sampled_from(["cube", "tube", "dog"]), poses=poses_of_cases, palm=palms)
def test_closed_contours_hold_the_open_ones_and_are_never_shorter(name, poses, palm):
    oc = render(OBJECTS[name], palm, poses, open_contour())
    cc = render(OBJECTS[name], palm, poses, closed_contour())
    assert (cc.length() >= oc.length() - 1e-6).all()
    assert cc.length("object") == pytest.approx(oc.length(), abs=1e-6)
    assert cc.polyline_closed.all()
    own = object_part(cc)
    for pose in range(len(poses)):
        ends = {tuple(p) for line in oc.polylines_of(pose) for p in line}
        assert {tuple(p) for line in own.polylines_of(pose) for p in line} == ends


@pytest.mark.exhaustive
@settings(max_examples=40)
@given(name=st.sampled_from(["cube", "tube", "dog"]), poses=poses_of_cases, palm=palms)
def test_batches_keep_their_own_rules(name, poses, palm):
    for strategy in (open_contour(), closed_contour(), IntersectionStrategy()):
        batch = render(OBJECTS[name], palm, poses, strategy)
        assert batch.pose_start[0] == 0
        assert batch.pose_start[-1] == batch.polyline_count == len(batch.polyline_patch)
        assert batch.polyline_start[0] == 0
        assert batch.polyline_start[-1] == batch.point_count == len(batch.points)
        assert (np.diff(batch.pose_start) >= 0).all()
        assert (np.diff(batch.polyline_start) >= 2).all()
        last = batch.polyline_start[1:] - 1
        assert (batch.kind[last] == batch.kind[last - 1]).all()
        closed = batch.polyline_closed == 1
        first = batch.polyline_start[:-1]
        np.testing.assert_array_equal(batch.points[last[closed]], batch.points[first[closed]])
        steps = np.linalg.norm(np.diff(batch.points, axis=0), axis=1)
        inner = np.ones(len(steps), bool)
        inner[last[:-1]] = False
        assert (steps[inner] > 0).all()
        assert set(batch.kind) <= ({OBJECT, HAND} if strategy.needs_closed else {OBJECT})


@settings(max_examples=25)
@given(height=st.floats(-0.07, 0.07), tilt=st.floats(-1.2, 1.2), turn=st.floats(-3.1, 3.1))
def test_sections_of_the_sphere_lie_between_its_faces_and_its_radius(height, tilt, turn):
    axes = Rotation.from_euler("zx", [turn, tilt]).as_matrix() @ Rotation.from_euler("x", -90, degrees=True).as_matrix()
    sphere = OBJECTS["sphere"]
    centre = np.array([0, 0, 0.2]) + height * axes[:, 1]
    pose = np.hstack([centre, Rotation.from_matrix(axes).as_quat()])
    batch = render(sphere, Palm(0.3, 0.3), pose[None], open_contour())
    triangles = sphere.vertices[sphere.faces].astype(float) - [0, 0, 0.2]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    nearest = np.einsum("ij,ij->i", triangles[:, 0], normal / np.linalg.norm(normal, axis=1, keepdims=True)).min()
    distance = np.linalg.norm(batch.points - [0, 0, 0.2], axis=1)
    assert ((distance >= nearest - 1e-7) & (distance <= 0.065 + 1e-7)).all()
    if abs(height) < nearest - 1e-6:
        assert batch.polyline_closed.tolist() == [1]
    if abs(height) > 0.065 + 1e-6:
        assert batch.polyline_count == 0


def test_permuted_poses_permute_the_batch(device, rng):
    poses = generic_poses(200, 5)
    order = rng.permutation(len(poses))
    plain = render(OBJECTS["tube"], PALM, poses, closed_contour(), device=device)
    shuffled = render(OBJECTS["tube"], PALM, poses[order], closed_contour(), device=device)
    assert_same(join_batches([plain.select(i, i + 1) for i in order]), shuffled)


@pytest.mark.parametrize("memory", [np.nan, np.inf, -1, "2 GB", True])
def test_a_budget_that_is_no_number_of_bytes_is_refused(memory, tmp_path):
    poses = generic_poses(2, 1)
    with pytest.raises(StrategyError, match="memory must be"):
        render(OBJECTS["cube"], PALM, poses, open_contour(), memory=memory)
    with pytest.raises(StrategyError, match="memory must be"):
        record(tmp_path / "out.h5", OBJECTS["cube"], PALM, HandMotion(None, poses), open_contour(), memory=memory)
    assert not list(tmp_path.iterdir())


def test_mirrored_object_gives_mirrored_contours_of_the_same_length(device):
    thing, poses = OBJECTS["dog"], generic_poses(100, 10)
    mirror = np.array([-1.0, 1.0, 1.0])
    mirrored = MeshObject(thing.vertices * mirror, thing.faces[:, ::-1])
    turned = poses.copy()
    turned[:, 0] *= -1
    turned[:, 4:6] *= -1  # a mirror in x: rotations about y and z reverse
    # The mirrored palm has its u reversed, which is the same rectangle; its normal keeps its side.
    here = render(thing, PALM, poses, closed_contour(), device=device).length()
    there = render(mirrored, PALM, turned, closed_contour(), device=device).length()
    assert there == pytest.approx(here, abs=1e-5)


def test_flipping_the_palm_over_changes_nothing_but_the_direction(device):
    poses = generic_poses(100, 11)
    flipped = poses.copy()
    half_turn = Rotation.from_euler("z", 180, degrees=True)  # about the fingers: n and u reverse
    flipped[:, 3:] = (Rotation.from_quat(poses[:, 3:]) * half_turn).as_quat()
    here = render(OBJECTS["tube"], PALM, poses, closed_contour(), device=device)
    there = render(OBJECTS["tube"], PALM, flipped, closed_contour(), device=device)
    assert there.length() == pytest.approx(here.length(), abs=1e-5)


@pytest.mark.parametrize(
    ("pose", "error", "message"),
    [
        (np.zeros((3, 6)), PoseError, r"\[pose, 7\].*\(3, 6\)"),
        ([[0, 0, 0.2, 0, 0, 0, 0]], MotionError, "row 0.*zero quaternion"),
        ([[0, 0, 0.2, 0, 0, 0, 1], [0, 0, 0.2, 0, 0, 0, 1.1]], MotionError, "row 1.*1.1"),
        ([[0, 0, np.nan, 0, 0, 0, 1]], MotionError, "row 0.*not finite"),
    ],
)
def test_bad_poses_are_refused_with_their_row(pose, error, message):
    with pytest.raises(error, match=message):
        render(OBJECTS["cube"], PALM, np.array(pose), open_contour())
