"""Points relative to their patch, and the warning where float32 cannot hold what is promised.

The same object and palm, moved by a shift that float32 holds exactly, have the same points on the palm (symmetry);
binary fractions make that exact far from the array, too.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from mesh_cases import generic_poses
from section_oracle import rotation

from palpate.datasets.shapes.built_in import shape
from palpate.render import (
    ImplicitObject,
    MeshObject,
    Palm,
    array_points,
    closed_contour,
    load_strategy,
    open_contour,
    render,
)
from palpate.render.errors import PoseError, StrategyError
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.objects.functions.expression import sphere

TUBE, CC = MeshObject.load("tube"), closed_contour()
FAR = np.array([1024.0, -2048.0, 512.0])  # [m]; float32 steps by 2^-12 m there
PATCHES = tuple(HandPatch(name, 0.06, 0.05, (x, 0, 0.01, 0, 0.6, 0, 0.8)) for name, x in (("a", -0.02), ("b", 0.03)))


@pytest.mark.parametrize("strategy", [open_contour(), CC], ids=["oc", "cc"])
@pytest.mark.parametrize("hand", [Palm(), PlaneHand(PATCHES)], ids=["palm", "planes"])
@pytest.mark.parametrize("moves", [False, True])
def test_points_relative_to_patches_are_those_of_the_array_once_placed(hand, strategy, moves, device):
    poses = generic_poses(80, 3)
    moved = generic_poses(80, 4) if moves else None
    there = render(TUBE, hand, poses, strategy, object_pose=moved, device=device)
    own = render(TUBE, hand, poses, strategy, object_pose=moved, points="patch", device=device)
    np.testing.assert_array_equal(own.polyline_start, there.polyline_start)
    np.testing.assert_array_equal(own.kind, there.kind)
    placed = array_points(own, hand, poses)
    assert placed.dtype == np.float64
    np.testing.assert_allclose(placed, there.points, atol=2e-7)
    assert there.point_count > 1000
    assert not own.points[:, 2].any()
    half = np.array([[0.03, 0.025]]) if isinstance(hand, PlaneHand) else np.array([[0.0425, 0.0425]])
    assert (np.abs(own.points[:, :2]) <= half + 1e-9).all()


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
@pytest.mark.filterwarnings("ignore:motion. positions reach 2048:palpate.render.RecordingWarning")
def test_far_from_the_array_points_on_the_palm_are_those_near_it(device):
    """Coordinates are multiples of 2^-12 m, and the shift is one of 512 m: float32 holds both, so all points agree."""
    vertices, faces = shape("tube")
    vertices = np.round((vertices - [0, 0, 0.2]) * 4096) / 4096
    poses = generic_poses(40, 6)
    poses[:, :3] = np.round((poses[:, :3] - [0, 0, 0.2]) * 4096) / 4096
    beyond = poses + np.concatenate([FAR, np.zeros(4)]).astype(np.float32)
    strategy = replace(CC, flush=0.0)  # by default it grows with the distance
    near, far = MeshObject(vertices, faces), MeshObject(vertices + FAR, faces)
    own = render(near, Palm(), poses, strategy, points="patch", device=device)
    away = render(far, Palm(), beyond, strategy, points="patch", device=device)
    rounded = render(far, Palm(), beyond, strategy, device=device)
    np.testing.assert_allclose(away.points, own.points, atol=1e-9)
    placed = array_points(away, Palm(), beyond)
    turned = np.repeat(np.arange(40), np.diff(own.polyline_start[own.pose_start]))
    basis = np.array([rotation(pose[3:]) for pose in poses])[turned]  # u = X, v = -Z of the hand
    expected = poses[turned, :3] + own.points[:, :1] * basis[:, :, 0] - own.points[:, 1:2] * basis[:, :, 2]
    np.testing.assert_allclose(placed - FAR, expected, atol=1e-9)
    apart = np.abs(rounded.points - FAR - placed[: rounded.point_count] + FAR).max(axis=1)
    assert rounded.point_count != away.point_count or apart.max() > 1e-5  # float32 in the array's frame is not enough


def test_what_needs_points_in_the_arrays_frame_refuses_others():
    poses = generic_poses(2, 1)
    ball = ImplicitObject(sphere(0.04).moved(0, 0, 0.2))
    for thing, strategy in ((ball, replace(CC, step=0.004)), (TUBE, load_strategy("hatch"))):
        with pytest.raises(StrategyError, match='points="patch" is for a mesh'):
            render(thing, Palm(), poses, strategy, points="patch")
    with pytest.raises(StrategyError, match="points must be one of array, patch, not 'metres'"):
        render(TUBE, Palm(), poses, CC, points="metres")
    with pytest.raises(StrategyError, match='render them with points="patch"'):
        array_points(render(TUBE, Palm(), generic_poses(9, 1), CC), Palm(), generic_poses(9, 1))
    with pytest.raises(PoseError, match="of 2 poses, the motion has 3"):
        array_points(render(TUBE, Palm(), poses, CC, points="patch"), Palm(), generic_poses(3, 1))


@pytest.mark.parametrize(("far", "warned"), [(100.0, False), (130.0, True), (1e5, True)])
def test_a_grid_of_float32_that_is_coarser_than_promised_is_warned_of_once(far, warned, tmp_path):
    """float32 has 24 binary digits: 128 m is where its steps become 2^-16 m = 15 um."""
    vertices, faces = shape("cube")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # vertices that fall on others
        thing = MeshObject(vertices + np.array([far, 0.0, 0.0]), faces)
    poses = generic_poses(3, 1) + np.array([far, 0, 0, 0, 0, 0, 0], np.float32)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        render(thing, Palm(), poses, CC)
    told = [str(w.message) for w in caught if "float32 steps" in str(w.message)]
    assert len(told) == int(warned)
    if warned:
        spacing = 2.0 ** (np.floor(np.log2(far)) - 23)
        assert f"{spacing:.2g} m" in told[0]
        assert 'points="patch"' in told[0]
        assert caught[0].filename == __file__
