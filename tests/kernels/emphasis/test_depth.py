"""Intensity by depth on a device: every grid point and every point asked for itself gives the same."""

import numpy as np
import pytest
import trimesh
import warp as wp
from contour_shapes import batch_of
from depth_oracle import grid_points
from transform_cases import a_setting, near_poses, rendered, run_stage

from palpate.kernels.emphasis.depth import find_deepest, make_ramp, place_body
from palpate.kernels.patch import EXACT
from palpate.kernels.solids.distance import distance_within, is_within
from palpate.render import MeshObject, Palm
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.objects.moving_object import back_to
from palpate.render.stages.depth import mesh_of

wp.set_module_options(EXACT)


@wp.kernel
def _measure_depth(
    # In:
    mesh: wp.uint64,
    points: wp.array[wp.vec3],
    # Out:
    depth: wp.array[wp.float32],
):
    """Depth of each point by itself."""
    i = wp.tid()
    depth[i] = 0.0
    if is_within(mesh, points[i]):
        depth[i] = distance_within(mesh, points[i], 10.0)


def alone(body, setting, points):
    """Depth of each point by itself, the mesh where it stands still."""
    if setting.object_pose is not None:
        row = np.broadcast_to(np.arange(points.shape[0])[:, None, None], points.shape[:3]).ravel()
        points = back_to(setting.object_pose[row], setting.solid.bounds.mean(axis=0), points.reshape(-1, 3))
    x = wp.array(np.ascontiguousarray(points, np.float32).reshape(-1, 3), dtype=wp.vec3, device=setting.device)
    depth = wp.empty(len(x), dtype=wp.float32, device=setting.device)
    wp.launch(_measure_depth, len(x), inputs=[body.mesh, x], outputs=[depth], device=setting.device)
    return depth.numpy()


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("grid", [2, 3, 9, 24, 128])
def test_the_deepest_point_is_found_to_the_bit_whatever_is_left_out(grid, moved, device, rng):
    hand = flat_hand()
    for own, count in ((Palm(), 15 if grid < 128 else 3), (hand, 2 if grid < 128 else 1)):
        batch, setting = rendered(rng, device, hand=own, moved=moved, count=count)
        mesh, there = mesh_of(setting.solid, device), batch.to(device)
        pose = None if not moved else wp.array(setting.object_pose, dtype=wp.transform, device=device)
        body = place_body(mesh, pose, setting.solid.bounds.mean(axis=0))
        ramp = make_ramp(0.0, 1.0, 0.0)
        points = grid_points(setting.frames, grid)
        every = alone(body, setting, points).reshape(points.shape[:3])
        lines = (there.struct, body, setting.patches, ramp)
        by_patch, by_pose = (find_deepest(*lines, grid=grid, whole=whole).numpy() for whole in (False, True))
        drawn = np.zeros(by_patch.shape, bool)
        drawn[np.repeat(np.arange(count), np.diff(batch.pose_start)), batch.polyline_patch] = True
        np.testing.assert_array_equal(by_patch[drawn], every.max(axis=2)[drawn])
        touched = drawn.any(axis=1)
        np.testing.assert_array_equal(by_pose[touched, 0], every.max(axis=(1, 2))[touched])
        assert every[drawn].max() > 0.005


def test_a_grid_of_more_points_than_the_stack_of_cells_can_divide_is_refused(device, rng):
    batch, setting = rendered(rng, device, count=2)
    there, body = batch.to(device), place_body(mesh_of(setting.solid, device))
    for grid in (1, 129):
        with pytest.raises(ValueError, match="grid must lie between 2 and 128"):
            find_deepest(there.struct, body, setting.patches, make_ramp(0, 1, 0), grid=grid, whole=False)


def test_long_lines_are_measured_in_runs_that_agree(device, rng):
    """A line of many points inside and outside: the side of a point may come from the one before it, or not."""
    ball = trimesh.creation.icosphere(3, 0.03)
    solid = MeshObject(ball.vertices, ball.faces, name="ball", at=(0, 0, 0.2))
    setting = a_setting(near_poses(rng, 1), solid=solid, device=device)
    points = (np.linspace([-0.05, 0.002, 0.2], [0.05, -0.003, 0.201], 701) + rng.normal(0, 1e-4, (701, 3))).astype("f4")
    batch = batch_of([[(points, False)]])
    got = run_stage("depth", batch, setting, at="point", deep=0.02, lowest=0.3, spacing=1.0).intensity
    depth = alone(place_body(mesh_of(solid, device)), setting, points)
    want = 0.3 + (1.0 - 0.3) * np.clip(depth.astype(np.float64) / 0.02, 0.0, 1.0)
    np.testing.assert_array_equal(got, want.astype(np.float32))
    assert 200 < np.count_nonzero(depth) < 500
