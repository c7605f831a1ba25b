"""Palms exactly through vertices, along edges, flush with faces, sides and corners on contours, by either method."""

import numpy as np
import pytest
from drawing import METHODS, STRATEGIES, assert_same_bits, draw, patch_array, surface_on
from mesh_cases import CLOSED, MESHES, slab
from oracles import SHIFT, cut_mesh, is_degenerate
from scipy.spatial.transform import Rotation

from palpate.kernels.patch import ON

HALF = np.array([0.0425, 0.0425])
TOLERANCE = 1e-5  # [m]
SHIFTS = [(plane, side) for plane in (0, SHIFT, -SHIFT) for side in (0, -float(ON), SHIFT, -SHIFT)]


def pose_of(position, u, n):
    """A palm at a position whose width runs along u and whose normal is n, as near as u allows."""
    n = np.asarray(n, float) / np.linalg.norm(n)
    u = np.asarray(u, float) - np.dot(u, n) * n
    u /= np.linalg.norm(u)
    turn = Rotation.from_matrix(np.stack([u, n, np.cross(u, n)], axis=1))
    return np.hstack([position, turn.as_quat()]).astype(np.float32)


def corner_at(point, pose, sides=(-1, 1)):
    """The pose moved so that a side or corner of its palm lies at a point."""
    turn = Rotation.from_quat(pose[3:].astype(float))
    local = np.array([sides[0] * HALF[0], 0.0, -sides[1] * HALF[1]])
    return np.hstack([point - turn.apply(local), pose[3:]]).astype(np.float32)


def degenerate_poses(mesh, count, seed):
    """Poses about a mesh's own vertices, edges and faces, by what is degenerate in them."""
    vertices, faces = mesh[0].astype(float), mesh[1]
    rng = np.random.default_rng(seed)
    poses = {}
    for k in range(count):
        a, b, c = vertices[faces[rng.integers(len(faces))]]
        normal = np.cross(b - a, c - a)
        any_way = rng.normal(size=3)
        across = np.cross(b - a, any_way)
        for sign in (1, -1):
            flush = pose_of((a + b + c) / 3, b - a, sign * normal)
            poses[f"flush with a face {k} {sign}"] = flush
            poses[f"flush, a corner on a vertex {k} {sign}"] = corner_at(a, flush)
            poses[f"flush, a side along an edge {k} {sign}"] = corner_at(0.5 * (a + b), flush, (0, sign))
        poses[f"through a vertex {k}"] = pose_of(a, any_way, rng.normal(size=3))
        poses[f"a corner on a vertex {k}"] = corner_at(a, pose_of(a, any_way, rng.normal(size=3)))
        poses[f"along an edge {k}"] = pose_of(0.5 * (a + b), any_way, across)
        poses[f"along an edge, a side too {k}"] = corner_at(0.5 * (a + b), pose_of(a, b - a, across), (0, 1))
        poses[f"a side through an edge {k}"] = corner_at(0.3 * a + 0.7 * b, pose_of(a, any_way, b - a), (1, 0))
        poses[f"a corner on an edge {k}"] = corner_at(0.3 * a + 0.7 * b, pose_of(a, any_way, b - a), (1, -1))
    return poses


def touches(drawn, i):
    """Whether contours meet in a point, as they do where a plane goes through a saddle's vertex."""
    lines = [line[:-1] if (line[0] == line[-1]).all() else line for line in drawn.lines_of(i)]
    points = np.concatenate(lines).round(7)
    return len(np.unique(points, axis=0)) < len(points)


def fits(oc, cc, i, cut):
    """Whether the contours of a pose are those of the oracle, which does not tell lines apart where they touch."""
    closed = oc.closed_of(i)
    return (
        abs(oc.length[i].sum() - cut.oc_length) <= TOLERANCE
        and abs(cc.length[i].sum() - cut.cc_length) <= TOLERANCE
        and ((len(closed), sum(closed)) == (cut.oc_lines, cut.oc_loops) or touches(oc, i))
        and cc.closed_of(i) == [True] * cut.cc_loops
    )


def check(mesh, poses, device):
    """Both methods give the same bits, and these equal the oracle at one of the shifts; returns how many were so."""
    surface, patch, stack = surface_on(mesh, device), patch_array(HALF, device), np.array(list(poses.values()))
    raw, oc, cc = (draw(surface, stack, patch, strategy, "trace") for strategy in STRATEGIES)
    for strategy, traced in zip(STRATEGIES, (raw, oc, cc), strict=True):
        assert_same_bits(traced, draw(surface, stack, patch, strategy, "seek"))
    for i, (label, pose) in enumerate(poses.items()):
        cuts = [cut_mesh(*mesh, pose, HALF, plane_shift=p, side_shift=s) for p, s in SHIFTS]
        agreed = any(fits(oc, cc, i, cut) for cut in cuts)
        assert agreed, (label, oc.length[i], cc.length[i], cuts)
    return sum(is_degenerate(*mesh, pose, HALF) for pose in stack)


def test_palm_along_an_edge_goes_around_a_sliver(device):
    """A plane through an edge cuts off a sliver of 1e-10 m: its contour leaves the palm right where it came in."""
    mesh = CLOSED["cube"]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    a, b = mesh[0].astype(float)[[0, 1]]
    rng = np.random.default_rng(1)
    poses = np.array(
        [pose_of(0.5 * (a + b), rng.normal(size=3), np.cross(b - a, rng.normal(size=3))) for _ in range(200)]
    )
    for method in METHODS:
        oc, cc = (draw(surface, poses, patch, strategy, method) for strategy in ("oc", "cc"))
        np.testing.assert_allclose(cc.length[:, 0], oc.length[:, 0], atol=1e-6)
        assert np.isfinite(cc.points).all()
        assert (cc.length.sum(axis=1) <= 0.37 + TOLERANCE).all()


@pytest.mark.parametrize("name", [*(name for name in CLOSED if name != "comb"), "block"])
def test_degenerate_poses_equal_a_nearby_answer(name, device):
    mesh = slab(lambda x, y: 0 * x, 9) if name == "block" else CLOSED[name]()
    poses = degenerate_poses(mesh, 12, seed=3)
    assert check(mesh, poses, device) > 0.9 * len(poses)


@pytest.mark.parametrize("name", sorted(set(MESHES) - set(CLOSED)))
def test_degenerate_poses_of_open_and_odd_meshes_are_the_same_by_either_method(name, device):
    mesh = MESHES[name]()
    surface, patch = surface_on(mesh, device), patch_array(HALF, device)
    poses = np.array(list(degenerate_poses(mesh, 12, seed=4).values()))
    for strategy in ("raw", "oc"):
        traced, sought = (draw(surface, poses, patch, strategy, method) for method in METHODS)
        assert_same_bits(traced, sought)
        assert traced.length.sum() > 0


def test_palms_on_a_grid_of_quarter_millimetres_meet_a_block_as_defined(device):
    """Level palms over a block with vertices on a grid: sides run along its sides, corners lie on its corners."""
    mesh = slab(lambda x, y: 0 * x, 5, size=0.0625)
    mesh = (np.round(mesh[0].astype(float) * 1024) / 1024).astype(np.float32), mesh[1]
    step = 0.0625 / 2
    poses = {}
    for x in (-2, -1, 0, 1, 2):
        for y in (-2, -1, 0, 1, 2):
            for z in (0.0, -0.02):
                poses[f"{x} {y} {z}"] = pose_of([x * step, y * step, mesh[0][0, 2] + z], [1, 0, 0], [0, 0, 1])
    assert check(mesh, poses, device) >= 25
