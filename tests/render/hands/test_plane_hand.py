"""Hands of several planes: one plane is a palm to the bit, each patch is a palm of its own, joints give patches."""

import json
import warnings

import numpy as np
import pytest
import warp as wp
from mesh_cases import generic_poses
from scipy.spatial.transform import Rotation

from palpate.datasets import ContourFile, HandMotion
from palpate.datasets.hand_model.joints import JOINT_COUNT
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.rigid import compose
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
from palpate.render.errors import PoseError, StrategyError
from palpate.render.hands.hand import Hand, PatchHand
from palpate.render.hands.plane_hand import FINGERS, HandPatch, PatchJoint, PlaneHand, flat_hand
from palpate.render.hands.stored_hand import hand_from
from palpate.render.intersection.mesh_section import intersect
from palpate.render.reports.contour_figure import draw_figure

STRATEGIES = {"raw": IntersectionStrategy(), "oc": open_contour(), "cc": closed_contour()}


def contours_of(thing, hand, pose, strategy, device):
    section = wp.array(hand.section_poses(pose, 0), dtype=wp.transform, device=device)
    return intersect(thing, hand, section, strategy)[0].numpy()


def assert_same(one, two, fields=None):
    for name, array in one.arrays().items():
        if fields is None or name in fields:
            assert array.tobytes() == two.arrays()[name].tobytes(), name


def articulated(pose_count, seed=3):
    """Three patches that move against the hand."""
    rng = np.random.default_rng(seed)
    own = np.zeros((pose_count, 3, 7))
    own[..., :3] = rng.uniform(-0.03, 0.03, (pose_count, 3, 3))
    own[..., 3:] = Rotation.random(3 * pose_count, random_state=seed).as_quat().reshape(pose_count, 3, 4)
    patches = (HandPatch("a", 0.08, 0.09), HandPatch("b", 0.05, 0.04), HandPatch("c", 0.02, 0.06))
    return PlaneHand(patches, (), own)


@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("articulated", [False, True])
def test_one_patch_is_a_palm_to_the_bit(strategy, articulated, device):
    pose, palm = generic_poses(300, 0), Palm(0.07, 0.085)
    own = np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (len(pose), 1, 1)) if articulated else None
    hand = PlaneHand((HandPatch("palm", 0.07, 0.085),), (), own)
    for name in ("tube", "dog"):
        thing = MeshObject.load(name)
        expected = contours_of(thing, palm, pose, STRATEGIES[strategy], device)
        assert expected.point_count > 1000
        assert_same(contours_of(thing, hand, pose, STRATEGIES[strategy], device), expected)
    np.testing.assert_array_equal(hand.on("cpu").numpy(), palm.on("cpu").numpy())
    np.testing.assert_allclose(hand.corners(pose), palm.corners(pose), atol=1e-7)
    for mine, theirs in zip(hand.frames(pose), palm.frames(pose), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-15)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_every_patch_of_an_articulated_hand_is_a_palm_at_its_own_pose(strategy, device):
    pose, thing = generic_poses(150, 1), MeshObject.load("tube")
    hand = articulated(len(pose))
    whole = contours_of(thing, hand, pose, STRATEGIES[strategy], device)
    for k, patch in enumerate(hand.patches):
        own = compose(pose, hand.patch_pose[:, k]).astype(np.float32)
        alone = contours_of(thing, Palm(patch.width, patch.length), own, STRATEGIES[strategy], device)
        mine = [line for line in range(whole.polyline_count) if whole.polyline_patch[line] == k]
        assert len(mine) == alone.polyline_count > 0
        for line, other in zip(mine, range(alone.polyline_count), strict=True):
            a = whole.points[whole.polyline_start[line] : whole.polyline_start[line + 1]]
            b = alone.points[alone.polyline_start[other] : alone.polyline_start[other + 1]]
            assert a.tobytes() == b.tobytes()
    assert (
        np.diff(whole.polyline_patch)[np.diff(np.repeat(np.arange(150), np.diff(whole.pose_start))) == 0] >= 0
    ).all()


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_nothing_is_drawn_on_a_patch_that_is_not_there(strategy, device):
    pose, thing = generic_poses(60, 4), MeshObject.load("cube")
    hand = articulated(len(pose))
    own = hand.patch_pose.copy()
    own[::2, 1] = np.nan
    own[5, 1, 3] = np.nan  # a row that is not wholly there is not there
    gone = PlaneHand(hand.patches, (), own)
    np.testing.assert_array_equal(np.flatnonzero(gone.absent[:, 1]), sorted([*range(0, 60, 2), 5]))
    assert gone.described()["absent"] == gone.absent.sum() == 31
    whole, part = (contours_of(thing, h, pose, STRATEGIES[strategy], device) for h in (hand, gone))
    line_pose = np.repeat(np.arange(60), np.diff(whole.pose_start))
    kept = ~gone.absent[line_pose, whole.polyline_patch]
    assert part.polyline_count == kept.sum() < whole.polyline_count
    np.testing.assert_array_equal(part.polyline_patch, whole.polyline_patch[kept])
    assert np.abs(part.points).max() < 1.0
    corners = gone.corners(pose)
    np.testing.assert_array_equal(np.isnan(corners).all(axis=(2, 3)), gone.absent)
    np.testing.assert_array_equal(gone.corners(pose[5:8], 5), corners[5:8])
    assert np.isfinite(gone.frames(pose).origin).all()


@pytest.mark.parametrize("hand", [Palm(0.08, 0.1), flat_hand(), articulated(4), articulated(1)], ids=range(4))
def test_hands_follow_the_protocol_and_read_back_from_a_file(hand):
    assert isinstance(hand, Hand)
    assert isinstance(hand, PatchHand)
    back = hand_from(json.loads(json.dumps(hand.described())), hand.arrays())
    assert type(back) is type(hand)
    assert back.described() == hand.described()
    assert (back.patch_count, back.pose_count) == (hand.patch_count, hand.pose_count)
    pose = generic_poses(hand.pose_count or 3, 0)
    np.testing.assert_array_equal(back.section_poses(pose), hand.section_poses(pose))
    np.testing.assert_array_equal(back.corners(pose), hand.corners(pose))
    np.testing.assert_array_equal(back.on("cpu").numpy(), hand.on("cpu").numpy())
    for array in hand.arrays().values():
        assert array.ndim == 2
        assert array.dtype == np.float32


def test_the_hash_tells_patch_poses_apart_but_not_one_missing_patch_from_another_nan():
    hand = articulated(4)
    other = hand.patch_pose.copy()
    other[3, 2, 1] = np.nextafter(other[3, 2, 1], np.float32(1))
    assert PlaneHand(hand.patches, (), other).described()["sha256"] != hand.described()["sha256"]
    gaps = [hand.patch_pose.copy() for _ in range(2)]
    gaps[0][0, 0, 0] = np.nan
    gaps[1][0, 0] = np.array(0xFFC01234, np.uint32).view(np.float32)
    assert len({PlaneHand(hand.patches, (), gap).described()["sha256"] for gap in gaps}) == 1


def test_what_is_no_hand_is_refused():
    palm, other = HandPatch("palm", 0.08, 0.1), HandPatch("other", 0.02, 0.03)
    for make, error, said in [
        (lambda: PlaneHand(()), StrategyError, "one patch at least"),
        (lambda: PlaneHand((palm, palm)), StrategyError, "'palm' is there twice"),
        (lambda: HandPatch("palm", 0.0, 0.1), StrategyError, "palm.* width must lie between"),
        (lambda: HandPatch("palm", "wide", 0.1), StrategyError, "width must lie between .* not 'wide'"),
        (lambda: Palm(0.1, True), StrategyError, "palm length must lie between .* not True"),
        (lambda: PlaneHand((Palm(),)), StrategyError, "patches must be of type HandPatch, not Palm"),
        (lambda: PatchJoint("palm", 1.5, "other", 0), StrategyError, "must be 0, 1, 2 or 3, not 1.5"),
        (lambda: hand_from({"kind": "planes", "patches": "xx", "joints": []}), StrategyError, "cannot be read"),
        (
            lambda: hand_from({"kind": "mesh", "vertices": 5}, {"skin_vertices": np.zeros((7, 3))}),
            StrategyError,
            "'mesh' cannot be read: .*reshape",
        ),
        (lambda: HandPatch("palm", 0.1, 0.1, (0, 0, 0, 0, 0, 0, 2)), PoseError, "norm 2"),
        (lambda: HandPatch("palm", 0.1, 0.1, (0, 0, np.nan, 0, 0, 0, 1)), PoseError, "not finite"),
        (lambda: HandPatch("palm", 0.1, 0.1, (0, 0, 1)), PoseError, r"shape \[7\], not \[3\]"),
        (lambda: PlaneHand((palm,), (PatchJoint("palm", 2, "tip", 0),)), StrategyError, "no patch 'tip'"),
        (lambda: PlaneHand((palm, other), (PatchJoint("palm", 4, "other", 0),)), StrategyError, "not 4"),
        (lambda: PlaneHand((palm,), (PatchJoint("palm", 2, "palm", 0),)), StrategyError, "to itself"),
        (lambda: PlaneHand((palm,), (), np.zeros((3, 2, 7))), PoseError, r"\[pose, 1, 7\], not \[3, 2, 7\]"),
        (lambda: PlaneHand((palm,), (), np.zeros((3, 1, 7))), PoseError, r"row \[0, 0\] has quaternion norm 0"),
        (lambda: PlaneHand((palm,), (), np.full((3, 1, 7), np.inf)), PoseError, r"row \[0, 0\] is infinite"),
        (lambda: PlaneHand((palm,)).patch_index("thumb"), StrategyError, "no patch 'thumb'"),
        (lambda: hand_from({"kind": "glove"}), StrategyError, "unknown hand 'glove'"),
        (lambda: hand_from({"kind": "planes", "patches": []}), StrategyError, "lacks 'joints'"),
        (lambda: hand_from(articulated(2).described()), StrategyError, "lacks 'patch_pose'"),
        (lambda: hand_from(articulated(2).described(), articulated(2, 4).arrays()), StrategyError, "SHA-256 differs"),
    ]:
        with pytest.raises(error, match=said):
            make()


def test_chunks_of_an_articulated_hand_are_cut_anywhere():
    motion, hand, thing = generic_poses(400, 9), articulated(400), MeshObject.load("dog")
    batches = [render(thing, hand, motion, closed_contour(), memory=memory) for memory in (None, 2**21)]
    with pytest.raises(PoseError, match=r"articulated for 400 poses, but the motion has 399"):
        render(thing, hand, motion[1:], closed_contour())
    assert_same(*batches)
    assert batches[0].length().max() > 0.2


@pytest.mark.exhaustive
def test_a_file_of_an_articulated_hand_gives_the_hand_back(tmp_path):
    pose = generic_poses(30, 10)
    own = np.tile(np.array([patch.pose for patch in flat_hand().patches]), (30, 1, 1))
    own[3, 2] = np.nan
    hand = PlaneHand(flat_hand().patches, flat_hand().joints, own)
    tube, motion = MeshObject.load("tube"), HandMotion(np.arange(30) / 90, pose)
    record(tmp_path / "hand.h5", tube, hand, motion, closed_contour())
    with ContourFile(tmp_path / "hand.h5") as file:
        back = hand_from(file.hand, file.hand_arrays())
        stored = ContourBatch.from_arrays(file.contours())
    assert back.described() == hand.described()
    assert back.patch_pose.tobytes() == hand.patch_pose.tobytes()
    assert_same(stored, render(tube, back, motion, closed_contour()))
    draw_figure({"hand": tmp_path / "hand.h5"}, tmp_path / "hand.png")
    assert (tmp_path / "hand.png").stat().st_size > 10_000


def straight_joints(is_left=False):
    """A flat hand whose fingers are straight and 20 mm apart: bones of 40, 25 and 20 mm, radii of 10 mm."""
    joints = np.zeros((1, JOINT_COUNT, 7))
    joints[..., 6] = 1.0
    side = -1.0 if is_left else 1.0
    joints[0, 0, :3], joints[0, 1, :3] = [0, 0.01, 0], [0, 0.01, 0.05]
    for k, start in enumerate((6, 11, 16, 21)):
        joints[0, start : start + 5, 0] = side * 0.02 * (k - 1.5)
        joints[0, start : start + 5, 1] = 0.01
        joints[0, start : start + 5, 2] = [0.04, -0.05, -0.09, -0.115, -0.135]
    joints[0, 2:6, 0] = side * np.array([-0.03, -0.05, -0.08, -0.105])
    joints[0, 2:6, 1] = 0.01
    joints[0, 2:6, 3:] = Rotation.from_euler("y", side * 90, degrees=True).as_quat()  # -Z to the thumb's side
    return joints, np.full(JOINT_COUNT, 0.01)


@pytest.mark.parametrize("is_left", [False, True])
def test_patches_of_a_straight_hand_lie_under_its_bones(is_left):
    joints, radius = straight_joints(is_left)
    hand = PlaneHand.from_joints(np.tile(joints, (3, 1, 1)), radius, is_left=is_left)
    assert hand.patch_count == 15
    assert hand.pose_count == 3
    sizes = {patch.name: (round(patch.width, 9), round(patch.length, 9)) for patch in hand.patches}
    assert sizes["palm"] == (0.08, 0.1)
    assert sizes["index-proximal"] == (0.02, 0.04)
    assert sizes["little-distal"] == (0.02, 0.02)
    assert sizes["thumb-proximal"] == (0.02, 0.03)
    f = hand.frames(np.array([[0, 0, 0, 0, 0, 0, 1.0]] * 3))
    np.testing.assert_allclose(f.n, np.broadcast_to([0.0, 1.0, 0.0], f.n.shape), atol=1e-7)
    np.testing.assert_allclose(f.origin[..., 1], 0.0, atol=1e-8)  # the skin, 10 mm below the joints
    index = hand.patch_index("index-intermediate")
    side = -1.0 if is_left else 1.0
    np.testing.assert_allclose(f.origin[1, index], [-0.03 * side, 0, -0.1025], atol=1e-8)
    np.testing.assert_allclose(f.v[1, index], [0, 0, -1], atol=1e-8)
    thumb = hand.patch_index("thumb-distal")
    np.testing.assert_allclose(f.v[1, thumb], [-side, 0, 0], atol=1e-7)
    np.testing.assert_allclose(f.origin[1, thumb], [-0.0925 * side, 0, 0], atol=1e-8)
    assert {(j.patch, j.other) for j in hand.joints if "index" in j.other} == {
        ("palm", "index-proximal"),
        ("index-proximal", "index-intermediate"),
        ("index-intermediate", "index-distal"),
    }
    assert not [j for j in hand.joints if j.other == "thumb-proximal"]


def test_a_bent_finger_turns_its_patches_and_a_lost_joint_takes_them_away():
    joints, radius = straight_joints()
    joints = np.tile(joints, (5, 1, 1))
    down = Rotation.from_euler("x", -90, degrees=True)  # the finger points out of the palm, its back to the tips
    joints[2, 8:11, :3] = np.array([-0.03, 0.01, -0.09]) + down.apply([[0, 0, 0], [0, 0, -0.025], [0, 0, -0.045]])
    joints[2, 8:11, 3:] = down.as_quat()
    joints[3, 9, 0] = np.nan
    hand = PlaneHand.from_joints(joints, np.tile(radius, (5, 1)), is_left=False, palm=False, fingers=("index",))
    assert [patch.name for patch in hand.patches] == ["index-proximal", "index-intermediate", "index-distal"]
    f = hand.frames(np.tile(np.array([0, 0, 0, 0, 0, 0, 1.0]), (5, 1)))
    np.testing.assert_allclose(f.v[2], [[0, 0, -1], [0, -1, 0], [0, -1, 0]], atol=1e-7)
    np.testing.assert_allclose(f.n[2], [[0, 1, 0], [0, 0, -1], [0, 0, -1]], atol=1e-7)
    np.testing.assert_allclose(f.origin[2, 1], [-0.03, 0.01 - 0.0125, -0.09 + 0.01], atol=1e-8)
    np.testing.assert_array_equal(np.argwhere(hand.absent), [[3, 1], [3, 2]])
    assert hand.described()["absent"] == 2


def test_joints_that_make_no_hand_are_named():
    joints, radius = straight_joints()

    def without(*numbers):
        changed = joints.copy()
        changed[:, list(numbers)] = np.nan
        return changed

    standing = joints.copy()
    standing[0, 8, 3:] = Rotation.from_euler("x", 90, degrees=True).as_quat()
    for given, options, said in [
        (joints, {"is_left": True}, "of a right hand, not of a left one"),
        (straight_joints(True)[0], {}, "of a left hand, not of a right one"),
        (joints[0], {}, r"\[frame, 26, 7\], not \[26, 7\]"),
        (joints[:0], {}, r"not \[0, 26, 7\]"),
        (without(1), {}, "palm: in no frame are wrist, .* all there"),
        (without(10), {}, "index-distal: index_distal and index_tip are in no frame"),
        (standing, {}, "index-intermediate: in frame 0 the back .* of index_intermediate points along its bone"),
    ]:
        with pytest.raises(PoseError, match=said):
            PlaneHand.from_joints(given, radius, **{"is_left": False, **options})
    with pytest.raises(PoseError, match=r"radius of wrist in frame 0 must be above 0 m, not 0\.0"):
        PlaneHand.from_joints(joints, np.where(np.arange(26) == 1, 0.0, radius), is_left=False)
    with pytest.raises(PoseError, match=r"radius must have shape \[26\]"):
        PlaneHand.from_joints(joints, radius[:5], is_left=False)
    for options, said in [({"fingers": ("toe",)}, "no finger 'toe'"), ({"palm": False, "fingers": ()}, "no patch")]:
        with pytest.raises(StrategyError, match=said):
            PlaneHand.from_joints(joints, radius, is_left=False, **options)


def test_a_flat_hand_has_the_size_it_is_asked_for_and_a_mirror_image():
    right, left = flat_hand(0.08, 0.18), flat_hand(0.08, 0.18, is_left=True)
    here = np.array([[0, 0, 0, 0, 0, 0, 1.0]])
    corners, mirrored = right.corners(here)[0], left.corners(here)[0]
    np.testing.assert_allclose(corners[..., 1], 0.0, atol=1e-12)
    fingers = [k for k, patch in enumerate(right.patches) if "thumb" not in patch.name]
    np.testing.assert_allclose(np.ptp(corners[fingers].reshape(-1, 3), axis=0), [0.08, 0, 0.18], atol=1e-9)
    for one, two in zip(corners, mirrored, strict=True):
        np.testing.assert_allclose(np.sort(one[:, 0]), np.sort(-two[:, 0]), atol=1e-12)
    assert [patch.name.split("-")[0] for patch in right.patches][1::3] == ["index", "middle", "ring", "little", "thumb"]
    assert corners[right.patch_index("index-distal"), 0, 0] < 0 < corners[right.patch_index("little-distal"), 0, 0]
    assert corners[right.patch_index("thumb-distal"), :, 0].max() < -0.04
    assert set(FINGERS) == {patch.name.split("-")[0] for patch in right.patches[1:]}
    assert len(right.joints) == 13
    with pytest.raises(StrategyError, match="hand length"):
        flat_hand(0.08, 3.0)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("source", "breadth"),
    [("hands/webxr_poses.json", 0.077), ("leap/grab.npz", 0.083), ("leap/rollAndPitchCropped.npz", 0.079)],
)
def test_patches_of_real_joints_render(source, breadth, outside_data):
    recording = load_recording(outside_data / source)
    hand = PlaneHand.from_joints(recording.joints_in_hand(), recording.radii(), is_left=recording.is_left)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # in the tracker's frame the hand is not in front of the array
        pose = recording.motion().pose
    assert hand.patch_count == 15
    assert not hand.absent.any()
    assert hand.patches[0].width == pytest.approx(breadth, abs=0.001)
    sizes = np.array([[patch.width, patch.length] for patch in hand.patches])
    assert sizes[1:, 0].min() > 0.011
    assert sizes[1:, 0].max() < 0.023
    assert sizes[1:, 1].min() > 0.015
    assert sizes[0, 1] == pytest.approx(0.095, abs=0.005)
    reach = np.linalg.norm(hand.corners(pose) - pose[:, None, None, :3], axis=3)
    assert reach.max() < 0.17
    pose = pose + np.pad([0, 0, 0.2] - np.median(pose[:, :3], axis=0), (0, 4))
    tube = MeshObject.load("tube")
    closed, opened = (render(tube, hand, pose, strategy) for strategy in (closed_contour(), open_contour()))
    assert np.isfinite(closed.points).all()
    assert len(np.unique(closed.polyline_patch)) > 10
    assert (closed.length("object") - opened.length() > -1e-5).all()
    assert closed.length().max() > 0.1
