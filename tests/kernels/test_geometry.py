"""Contours of meshes against float64 oracles: lengths, numbers of loops, closedness, degenerate poses."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from section_oracle import COUNTED, cut_mesh, cut_mesh_trimesh, default_flush, is_degenerate

from palpate.render import MeshObject, Palm, closed_contour, open_contour, render

TOLERANCE = 1e-5  # [m]
PALM = Palm(0.085, 0.085)
HALF = (0.0425, 0.0425)


def random_poses(count, seed, spread=0.09):
    """Palms around the objects, any way up; about half of them cut something."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=(count, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.hstack([rng.uniform(-spread, spread, (count, 3)) + np.array([0, 0, 0.2]), quaternion]).astype(np.float32)


def pose_of(position, rotation_matrix):
    return np.hstack([position, Rotation.from_matrix(rotation_matrix).as_quat()]).astype(np.float32)


def lying(z, x=0.0, y=0.0, *, skin_up=False):
    """A palm parallel to the array's face; n = +z (skin down), or n = -z."""
    n = np.array([0, 0, -1.0 if skin_up else 1.0])
    u = np.array([1.0, 0, 0])
    return pose_of([x, y, z], np.stack([u, n, np.cross(u, n)], axis=1))


def found(batch, pose):
    """Loops and lines of one pose that are longer than rounding."""
    first, stop = batch.pose_start[pose], batch.pose_start[pose + 1]
    lengths = [np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in batch.polylines_of(pose)]
    closed = batch.polyline_closed[first:stop]
    return sum(lengths), [bool(c) for c, length in zip(closed, lengths, strict=True) if length > COUNTED]


def agrees(pose, oc, cc, expected):
    oc_length, oc_closed = found(oc, pose)
    cc_length, cc_closed = found(cc, pose)
    return (
        abs(oc_length - expected.oc_length) <= TOLERANCE
        and abs(cc_length - expected.cc_length) <= TOLERANCE
        and len(oc_closed) == expected.oc_lines
        and sum(oc_closed) == expected.oc_loops
        and len(cc_closed) == expected.cc_loops
        and all(cc_closed)
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["tube", "dog", "rock", "sphere"])
def test_random_poses_agree_with_trimesh(name, device):
    thing = MeshObject.load(name)
    mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
    poses = random_poses(150, seed=7)
    oc = render(thing, PALM, poses, open_contour(), device=device)
    cc = render(thing, PALM, poses, closed_contour(), device=device)
    for i, pose in enumerate(poses):
        if not is_degenerate(thing.vertices, thing.faces, pose, HALF):
            expected = cut_mesh_trimesh(mesh, pose, HALF)
            fits = agrees(i, oc, cc, expected)
        assert fits, (i, expected, found(oc, i), found(cc, i))


def lying_rotation():
    return Rotation.from_quat(lying(0.2)[3:]).as_matrix()


def test_palm_flush_with_a_face_gives_all_of_it_or_nothing_however_it_is_turned(device):
    cube = MeshObject.load("cube")
    half_turn = np.pi * np.arange(400) / 400.0
    c, s = np.cos(half_turn / 2), np.sin(half_turn / 2)
    quaternion = np.stack([c, s, s, c], axis=1) * np.sqrt(0.5)  # n = +z, turned about it
    for z, whole in ((0.135, 0.0), (0.265, 0.34)):
        poses = np.hstack([np.tile([0.0, 0.0, z], (400, 1)), quaternion]).astype(np.float32)
        oc = render(cube, Palm(0.06, 0.06), poses, open_contour(), device=device).length()
        cc = render(cube, PALM, poses, closed_contour(), device=device).length()
        assert not oc.any()
        assert set(np.round(cc, 5)) == {np.float32(whole)}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("given", [0.0, None])
@pytest.mark.parametrize("tilt", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_palms_nearly_flush_with_a_face_are_as_exact_as_any(tilt, given, device):
    """Without `flush` the section is that of the mesh as it is, else that of the mesh as the rule takes it.

    A contour that runs to and fro along an edge on the plane is drawn, and the oracle draws it if it has an area.
    """
    cube = MeshObject.load("cube")
    rng = np.random.default_rng(int(1 / tilt))
    poses = []
    for _ in range(60):
        around = rng.uniform(0, 2 * np.pi)
        lean = Rotation.from_rotvec(tilt * np.array([np.cos(around), np.sin(around), 0]))
        turned = lean * Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)) * Rotation.from_matrix(lying_rotation())
        z = rng.choice([0.135, 0.265]) + rng.uniform(-0.05, 0.05) * tilt
        poses.append(pose_of([*rng.uniform(-0.03, 0.03, 2), z], turned.as_matrix()))
    oc = render(cube, PALM, np.array(poses), replace(open_contour(), flush=given), device=device)
    cc = render(cube, PALM, np.array(poses), replace(closed_contour(), flush=given), device=device)
    for i, pose in enumerate(poses):
        flush = default_flush(cube.vertices, pose) if given is None else given
        answers = [cut_mesh(cube.vertices, cube.faces, pose, HALF, flush=flush, lift=lift) for lift in (0.0, 1e-13)]
        fits = any(agrees(i, oc, cc, expected) for expected in answers)
        assert fits, (i, answers, found(oc, i), found(cc, i))


def test_flush_face_belongs_to_one_side_only(device):
    cube = MeshObject.load("cube")
    heights = [(0.265, False), (0.265, True), (0.135, False), (0.135, True)]
    poses = np.stack([lying(z, skin_up=up) for z, up in heights])
    cc = render(cube, Palm(0.2, 0.2), poses, closed_contour(), device=device)
    # A face on the plane counts as on the +n side: with n = +z the top face is above with nothing, the bottom one
    # is above with all the cube; only where the cube lies below (-n) of the plane is there a contour.
    assert cc.length() == pytest.approx([0.52, 0.0, 0.0, 0.52], abs=TOLERANCE)


def test_contour_along_the_palms_side_is_hand_kind_and_only_where_the_object_is_inside(device):
    cube = MeshObject.load("cube")
    reach = 0.065 - 0.0425
    poses = np.stack([lying(0.2, x=reach), lying(0.2, x=0.065 + 0.0425)])
    oc = render(cube, PALM, poses, open_contour(), device=device)
    cc = render(cube, PALM, poses, closed_contour(), device=device)
    assert oc.length()[1] == 0.0
    assert cc.length()[1] == 0.0
    assert cc.length()[0] == pytest.approx(0.34, abs=TOLERANCE)
    assert (oc.length()[0] == pytest.approx(0.0, abs=TOLERANCE)) or (
        oc.length()[0] == pytest.approx(0.085, abs=TOLERANCE)
    )


def test_real_dog_agrees_with_the_oracle(device, outside_data):
    from palpate.render import Placement

    dog = MeshObject.load(
        outside_data / "meshes" / "dog_1200.stl", placement=Placement(fit=0.13, at=(0, 0, 0.2), rotate=(0, 0, 30))
    )
    assert dog.report.closed
    poses = random_poses(40, seed=3, spread=0.06)
    oc = render(dog, PALM, poses, open_contour(), device=device)
    cc = render(dog, PALM, poses, closed_contour(), device=device)
    for i, pose in enumerate(poses):
        if not is_degenerate(dog.vertices, dog.faces, pose, HALF):
            expected = cut_mesh(dog.vertices, dog.faces, pose, HALF)
            fits = agrees(i, oc, cc, expected)
            assert fits, (i, expected, found(oc, i), found(cc, i))
