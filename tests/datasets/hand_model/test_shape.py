"""The parametric hand: a clean surface of the size asked for, and where recorded joints take it."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

from palpate.datasets.errors import RecordingError, ShapeError
from palpate.datasets.hand_model.cage import hand_cage
from palpate.datasets.hand_model.joints import BONES, DIGITS, FINGERS, Joint
from palpate.datasets.hand_model.quads import subdivide, triangulate
from palpate.datasets.hand_model.shape import hand_shape
from palpate.datasets.hand_model.skinning import posed_vertices
from palpate.datasets.recordings.alignment import Y_UP
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import sample_recording
from palpate.datasets.rigid import pose_product

COUNTS = {1: 1312, 2: 5248, 3: 20992}
LEAP = ["HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards"]
SIDES = pytest.mark.parametrize("is_left", [False, True])


def edges_of(faces):
    """Directed edges, shape [edge, 2]."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def rim_of(faces):
    """Directed edges with one face, as a mapping; fails where a vertex starts two of them."""
    rows = edges_of(faces).tolist()
    directed = {tuple(row) for row in rows}
    assert len(directed) == len(rows)  # oriented, and two faces an edge at most
    rim = [(a, b) for a, b in directed if (b, a) not in directed]
    assert len({a for a, _ in rim}) == len(rim)
    return dict(rim)


def loop_count(rim):
    left, count = dict(rim), 0
    while left:
        vertex = next(iter(left))
        while vertex in left:
            vertex = left.pop(vertex)
        count += 1
    return count


def part_count(faces):
    """Connected parts, and the vertices that are used."""
    used, index = np.unique(faces, return_inverse=True)
    edge = edges_of(index.reshape(-1, 3))
    graph = coo_array((np.ones(len(edge)), edge.T), shape=(len(used), len(used)))
    return connected_components(graph, directed=False)[0], len(used)


def volume(vertices, faces):
    """Of the hand with its wrist closed by a fan around the rim's middle [m3], and less its shift."""
    rim = np.array(list(rim_of(faces).items()))
    middle = vertices[rim[:, 0]].mean(axis=0)
    a, b, c = (vertices[faces[:, k]] - middle for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0


def distance_to_bones(vertices, pose):
    """From each vertex to the nearest bone [m]."""
    starts = [(start, end) for start, end in BONES] + [(Joint.WRIST, finger[0]) for finger in FINGERS]
    best = np.full(len(vertices), np.inf)
    for start, end in starts:
        a, b = pose[start, :3], pose[end, :3]
        t = np.clip((vertices - a) @ (b - a) / np.dot(b - a, b - a), 0, 1)
        best = np.minimum(best, np.linalg.norm(vertices - a - t[:, None] * (b - a), axis=1))
    return best


# --- the surface ---------------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("detail", [1, 2, 3])
@SIDES
def test_the_skin_is_one_oriented_surface_open_at_the_wrist_only(detail, is_left):
    shape = hand_shape(detail=detail, is_left=is_left)
    assert len(shape.faces) == COUNTS[detail]
    rim = rim_of(shape.faces)
    assert loop_count(rim) == 1
    assert (shape.vertices[list(rim), 2] > shape.joint_pose[Joint.WRIST, 2]).all()
    parts, used = part_count(shape.faces)
    assert (parts, used) == (1, len(shape.vertices))
    edge_count = (3 * len(shape.faces) + len(rim)) // 2
    assert used - edge_count + len(shape.faces) == 1  # a disc
    corner = shape.vertices[shape.faces].astype(float)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1) / 2
    assert area.min() > 1e-9
    assert 250e-6 < volume(shape.vertices.astype(float), shape.faces) < 420e-6


@pytest.mark.parametrize("detail", [1, 2])
@SIDES
def test_the_glabrous_region_is_one_disc_on_the_palm_s_side(detail, is_left):
    shape = hand_shape(detail=detail, is_left=is_left)
    region = shape.faces[shape.glabrous]
    rim = rim_of(region)
    parts, used = part_count(region)
    assert (parts, loop_count(rim)) == (1, 1)
    assert used - (3 * len(region) + len(rim)) // 2 + len(region) == 1
    corner = shape.vertices[shape.faces].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    down = -normal[:, 1] / np.linalg.norm(normal, axis=1)
    assert np.median(down[shape.glabrous]) > 0.8
    assert np.median(down[~shape.glabrous]) < -0.8
    assert shape.glabrous[down > 0.6].all()
    assert not shape.glabrous[down < -0.6].any()
    tips = shape.joint_pose[[digit[-1] for digit in DIGITS], :3]
    for tip in tips:  # every finger has its pad in it
        assert np.linalg.norm(shape.vertices[np.unique(region)] - tip, axis=1).min() < 0.01


@pytest.mark.parametrize(("breadth", "length"), [(0.085, 0.19), (0.07, 0.17), (0.095, 0.2)])
def test_sizes_are_those_asked_for_and_the_palm_s_skin_is_at_the_origin(breadth, length):
    shape = hand_shape(breadth=breadth, length=length)
    mover = shape.weight_joint[:, 0]
    palm = np.isin(mover, [finger[0] for finger in FINGERS])
    assert np.ptp(shape.vertices[palm, 0]) == pytest.approx(breadth, abs=1e-4)
    assert shape.joint_pose[Joint.WRIST, 2] - shape.vertices[:, 2].min() == pytest.approx(length, abs=1e-6)
    middle = (np.hypot(shape.vertices[:, 0], shape.vertices[:, 2]) < 0.012) & (shape.vertices[:, 1] < 0.01)
    assert middle.sum() > 5
    assert np.abs(shape.vertices[middle, 1]).max() < 0.002
    knuckles = shape.joint_pose[[Joint.INDEX_PROXIMAL, Joint.LITTLE_PROXIMAL], 0]
    assert knuckles.sum() == pytest.approx(0.0, abs=1e-9)
    ends = shape.joint_pose[[Joint.MIDDLE_PROXIMAL, Joint.WRIST], 2]
    assert ends.sum() == pytest.approx(0.0, abs=1e-9)


def test_a_left_hand_mirrors_the_right_one():
    right, left = hand_shape(), hand_shape(is_left=True)
    assert np.array_equal(left.vertices * np.float32([-1, 1, 1]), right.vertices)
    assert np.array_equal(left.faces[:, ::-1], right.faces)
    assert np.array_equal(left.glabrous, right.glabrous)
    turned = left.joint_pose * [-1, 1, 1, 1, -1, -1, 1]
    apart = np.abs(np.sum(turned[:, 3:] * right.joint_pose[:, 3:], axis=1))
    assert np.allclose(turned[:, :3], right.joint_pose[:, :3])
    assert np.allclose(apart, 1.0)


def test_weights_are_few_sum_to_one_and_are_of_the_nearest_joints():
    shape = hand_shape()
    assert shape.weight.sum(axis=1) == pytest.approx(np.ones(len(shape.vertices)), abs=1e-6)
    assert (shape.weight >= 0).all()
    assert np.bincount(shape.weight_joint[:, 0], minlength=26)[list(DIGITS[4][1:4])].min() > 20
    near = {Joint.WRIST} | {finger[0] for finger in FINGERS} | set(DIGITS[0])
    thumb = np.linalg.norm(shape.vertices - shape.joint_pose[Joint.THUMB_TIP, :3], axis=1) < 0.02
    assert set(shape.weight_joint[thumb, 0].tolist()) <= near


def test_a_cube_subdivides_to_a_smooth_closed_surface():
    corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]], dtype=np.int32
    )
    assert volume_of_closed(corner, triangulate(quads)) == pytest.approx(8.0)
    values, quads = subdivide(corner, quads)
    assert np.allclose(values[:8], corner * 5 / 9)  # (mean of face points + 2 mean of edge middles) / 3
    assert np.allclose(np.abs(values[8:20]).max(axis=1), 0.75)
    assert (len(values), len(quads), rim_of(triangulate(quads))) == (26, 24, {})


def volume_of_closed(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0


def test_the_cage_is_made_of_quads_that_fit():
    cage = hand_cage()
    assert len(cage.quads) == 164
    assert loop_count(rim_of_quads(cage.quads)) == 1
    assert cage.weight.sum(axis=1) == pytest.approx(np.ones(len(cage.weight)))


def rim_of_quads(quads):
    directed = {tuple(row) for row in np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2).tolist()}
    assert len(directed) == quads.size
    return {a: b for a, b in directed if (b, a) not in directed}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"breadth": 0.0}, r"breadth must be 0\.05 to 0\.12 m, got 0\.0"),
        ({"breadth": 85.0}, r"got 85\.0"),
        ({"length": float("nan")}, r"length must be 0\.1 to 0\.26 m, got nan"),
        ({"detail": 4}, r"detail must be one of \(1, 2, 3\), got 4"),
    ],
)
def test_sizes_that_are_no_hand_s_are_refused(options, said):
    with pytest.raises(ShapeError, match=said):
        hand_shape(**options)


# --- posed ---------------------------------------------------------------------------------------


@SIDES
def test_at_rest_the_skin_is_the_rest_skin(is_left):
    shape = hand_shape(is_left=is_left)
    posed = posed_vertices(shape, shape.joint_pose[None], shape.joint_radius)
    assert (posed.dtype, posed.shape) == (np.float32, (1, *shape.vertices.shape))
    assert np.abs(posed[0] - shape.vertices).max() < 1e-7


def test_a_hand_moved_as_one_moves_its_skin_as_one(rng):
    shape = hand_shape(detail=1)
    turn = Rotation.from_rotvec(0.5 * rng.normal(size=(5, 3)))
    pose = np.concatenate([0.1 * rng.normal(size=(5, 3)), turn.as_quat()], axis=1)
    posed = posed_vertices(shape, pose_product(pose[:, None], shape.joint_pose))
    wanted = [turn[k].apply(shape.vertices) + pose[k, :3] for k in range(5)]
    assert np.abs(posed - np.array(wanted)).max() < 1e-6


def test_a_hand_of_another_size_is_that_size():
    shape, larger = hand_shape(), hand_shape(breadth=0.102, length=0.228)  # 1.2 times
    posed = posed_vertices(shape, larger.joint_pose[None], larger.joint_radius)[0]
    assert np.abs(posed - larger.vertices).max() < 2e-4


def test_longer_bones_stretch_the_skin_along_them():
    shape, longer = hand_shape(), hand_shape(length=0.228)
    posed = posed_vertices(shape, longer.joint_pose[None], shape.joint_radius)[0]
    fingers = np.isin(shape.weight_joint[:, 0], [joint for finger in FINGERS for joint in finger[1:]])
    assert np.abs(posed - longer.vertices)[fingers].max() < 1e-3  # 8 mm if they kept their length


def test_one_bent_finger_leaves_the_others_alone():
    shape = hand_shape()
    pose = shape.joint_pose.copy()
    finger = DIGITS[1]
    at, axis = pose[finger[2], :3].copy(), np.array([-1.0, 0.0, 0.0])
    turn = Rotation.from_rotvec(1.2 * axis)
    for joint in finger[2:]:
        pose[joint, :3] = turn.apply(pose[joint, :3] - at) + at
        pose[joint, 3:] = (turn * Rotation.from_quat(pose[joint, 3:])).as_quat()
    posed = posed_vertices(shape, pose[None])[0]
    moved = np.linalg.norm(posed - shape.vertices, axis=1)
    assert moved[~np.isin(shape.weight_joint, finger[1:]).any(axis=1)].max() < 1e-7
    tip = np.linalg.norm(shape.vertices - shape.joint_pose[finger[-1], :3], axis=1) < 0.008
    assert (np.linalg.norm(posed[tip] - pose[finger[-1], :3], axis=1) < 0.009).all()


@pytest.mark.exhaustive(after=1)
@SIDES
def test_a_made_recording_poses_the_skin(is_left):
    recording, shape = sample_recording(frame_count=5, is_left=is_left), hand_shape(is_left=is_left)
    posed = posed_vertices(shape, recording.joints_in_hand(), recording.radii())
    assert np.abs(posed[0] - shape.vertices).max() < 1e-4
    rest = volume(shape.vertices.astype(float), shape.faces)
    for vertices in posed:
        assert volume(vertices.astype(float), shape.faces) == pytest.approx(rest, rel=0.15)


def without(joints, joint):
    torn = joints.copy()
    torn[1, joint] = np.nan
    return torn


def squeezed(joints):
    same = joints.copy()
    same[:, Joint.LITTLE_PROXIMAL] = joints[:, Joint.INDEX_PROXIMAL]
    return same


@pytest.mark.parametrize(
    ("change", "radius", "said"),
    [
        (lambda j: j[0], None, r"shape \[frame, 26, 7\], got \[26, 7\]"),
        (lambda j: without(j, 9), None, r"frame 1: index_distal is not known.*held\(whole=True\)"),
        (lambda j: j * [-1, 1, 1, 1, -1, -1, 1], None, "the shape is a right hand, the joints are the other hand's"),
        (lambda j: j * [0, 0, 0, 1, 1, 1, 1], None, "frame 0: the bone from thumb_metacarpal has no length"),
        (squeezed, None, "index and little knuckle lie in the same place"),
        (lambda j: j, np.ones(25), r"radius must have shape \[26\] or \[3, 26\], got \[25\]"),
        (lambda j: j, np.full(26, np.nan), "radius must be finite"),
    ],
)
def test_joints_that_cannot_pose_a_skin_are_refused(change, radius, said):
    joints = sample_recording(frame_count=3).joints_in_hand()
    with pytest.raises(RecordingError, match=said):
        posed_vertices(hand_shape(detail=1), change(joints), radius)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", LEAP)
def test_real_leap_recordings_pose_the_skin_plausibly(outside_data, name):
    recording = load_recording(outside_data / "leap" / f"{name}.npz", alignment=Y_UP)
    shape = hand_shape(detail=1)
    joints = recording.joints_in_hand()[::10]
    posed = posed_vertices(shape, joints, recording.radii()).astype(float)
    assert np.isfinite(posed).all()
    volumes = np.array([volume(vertices, shape.faces) for vertices in posed])
    assert np.abs(volumes / np.median(volumes) - 1).max() < 0.3
    rest = volume(shape.vertices.astype(float), shape.faces)
    assert np.median(volumes) == pytest.approx(rest * (recording.breadth / 0.081) ** 3, rel=0.3)
    for vertices, pose in zip(posed, joints, strict=True):
        assert distance_to_bones(vertices, pose).max() < 0.04


def test_real_webxr_poses_pose_a_left_hand(outside_data):
    recording = load_recording(outside_data / "hands" / "webxr_poses.json")
    shape = hand_shape(is_left=True, detail=1)
    posed = posed_vertices(shape, recording.joints_in_hand(), recording.radii()).astype(float)
    volumes = [volume(vertices, shape.faces) for vertices in posed]
    assert min(volumes) > 0.7 * max(volumes)
