"""Recorded hands: what each file says, what is derived, aligned, held and resampled, and what is refused."""

import json
import math

import numpy as np
import pytest
from recording_cases import PALM, TIP, content_of, lossy, remade, written
from scipy.spatial.transform import Rotation, Slerp

from palpate.datasets import rigid
from palpate.datasets.errors import RecordingError, RecordingWarning
from palpate.datasets.hand_model.frames import joint_orientations, side_from_bends
from palpate.datasets.hand_model.joints import (
    FINGERS,
    JOINT_NAMES,
    MEDIAPIPE_JOINTS,
    MEDIAPIPE_NAMES,
    WEBXR_NAMES,
    Joint,
    joint_from,
    joint_parent,
)
from palpate.datasets.recordings.alignment import Y_UP, alignment_pose, write_alignment
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import sample_recording, write_sample

FILES = [
    *(("leap", suffix) for suffix in (".json", ".csv", ".npz")),
    *((form, suffix) for form in ("openxr", "webxr", "mediapipe") for suffix in (".json", ".csv")),
]
CAMERA = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)  # the sample camera's frame -> the sample tracker's: half a turn about x
LEAP = ["HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards"]


def angle(a, b):
    """Between rotations [deg]."""
    return np.degrees(2.0 * np.arccos(np.clip(np.abs(np.sum(a * b, axis=-1)), 0.0, 1.0)))


def aligned(recording):
    """Above the array."""
    return recording.transformed(Y_UP)


# --- rigid motions, joints -----------------------------------------------------------------------


def test_rigid_motions_are_those_of_scipy(rng):
    a, b = Rotation.random(50, rng), Rotation.random(50, rng)
    x, share = rng.normal(size=(50, 3)), rng.random((50, 1))
    assert np.allclose(rigid.rotate(a.as_quat(), x), a.apply(x), atol=1e-14)
    assert np.allclose(rigid.matrix_of(a.as_quat()), a.as_matrix(), atol=1e-14)
    assert angle(rigid.quaternion_of(a.as_matrix()), a.as_quat()).max() < 1e-5
    assert angle(rigid.quaternion_product(a.as_quat(), b.as_quat()), (a * b).as_quat()).max() < 1e-5
    between = [Slerp([0, 1], Rotation.concatenate([p, q]))(t[0]).as_quat() for p, q, t in zip(a, b, share, strict=True)]
    assert angle(rigid.slerp(a.as_quat(), b.as_quat(), share), np.array(between)).max() < 1e-5
    pose = np.concatenate([x, a.as_quat()], axis=1)
    there_and_back = rigid.pose_product(rigid.pose_inverse(pose), pose)
    assert np.allclose(np.abs(there_and_back), [0, 0, 0, 0, 0, 0, 1], atol=1e-14)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, -1, 1], [0, 0, 0]])
def test_half_turns_have_a_quaternion_too(axis):
    turn = Rotation.from_rotvec(np.pi * np.array(axis) / max(np.linalg.norm(axis), 1.0))
    assert angle(rigid.quaternion_of(turn.as_matrix()), turn.as_quat()) < 1e-5


def test_joints_have_the_names_of_all_who_name_them():
    assert len(JOINT_NAMES) == len(set(WEBXR_NAMES)) == 26
    for joint in Joint:
        for name in (JOINT_NAMES[joint], WEBXR_NAMES[joint], f"XR_HAND_JOINT_{joint.name}_EXT"):
            assert joint_from(name) is joint
    unity = ("Wrist", "Palm", "ThumbMetacarpal", "IndexProximal", "RingIntermediate", "LittleTip")  # of XRHandJointID
    assert [joint_from(name) for name in unity] == [1, 0, 2, 7, 18, 25]
    assert joint_from("index-toe") is None
    assert [joint_parent(j) for j in (1, 0, 2, 3, 6, 10, 25)] == [-1, 1, 1, 2, 1, 9, 24]
    named = dict(zip(MEDIAPIPE_NAMES, MEDIAPIPE_JOINTS, strict=True))
    assert named["THUMB_CMC"] == Joint.THUMB_METACARPAL
    assert named["PINKY_DIP"] == Joint.LITTLE_DISTAL


# --- every format --------------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("is_left", [False, True])
@pytest.mark.parametrize(("form", "suffix"), FILES)
def test_a_format_gives_back_the_hand_it_was_made_of(tmp_path, form, suffix, is_left):
    made = sample_recording(frame_count=8, is_left=is_left)
    path = write_sample(form, tmp_path / f"hand{suffix}", frame_count=8, is_left=is_left)
    found = load_recording(path, alignment=CAMERA if form == "mediapipe" else None)
    assert found.is_left is is_left
    assert (made.offset, found.offset) == (12.0, pytest.approx(12.0, abs=1e-3))
    assert found.time == pytest.approx(made.time, abs=1e-3)
    given = np.array([name not in found.derived for name in JOINT_NAMES])
    apart = np.linalg.norm(found.joint_pose[..., :3] - made.joint_pose[..., :3], axis=2)
    assert apart[:, given].max() < 2e-6
    assert apart.max() < 0.011  # the wrist that leapjs leaves out
    turned = angle(found.joint_pose[..., 3:], made.joint_pose[..., 3:])
    if form != "mediapipe":
        phalanges = [joint for finger in FINGERS for joint in finger[1:-1]]
        assert found.joint_radius[phalanges] == pytest.approx(made.joint_radius[phalanges], abs=4e-3)
    said = form in ("openxr", "webxr") or (form, suffix) == ("leap", ".json")
    assert turned[:, given].max() < (0.1 if said else 25.0)
    assert np.abs(aligned(found).motion().pose[:, :3] - aligned(made).motion().pose[:, :3]).max() < 4e-3


def test_a_file_s_word_and_a_caller_s_word_on_its_format(tmp_path):
    content = content_of(tmp_path, "webxr")
    del content["format"]
    assert len(load_recording(written(tmp_path, content))) == 6
    assert len(load_recording(written(tmp_path, content), format="webxr")) == 6
    with pytest.raises(RecordingError, match=r"frame 0.*'world_landmarks' is missing"):
        load_recording(written(tmp_path, content), format="mediapipe")


def test_static_poses_have_no_time_and_tell_their_side(tmp_path):
    for is_left in (False, True):
        path = write_sample("webxr-static", tmp_path / "poses.json", is_left=is_left)
        found = load_recording(path)
        assert (found.time, len(found), found.is_left) == (None, 2, is_left)
        assert aligned(found).motion().time is None
        with pytest.raises(RecordingError, match="without time"):
            found.resampled(30.0)


def test_leap_bones_as_lists_and_vectors_as_objects_are_the_same_hand(tmp_path):
    content = content_of(tmp_path, "leap")
    plain = load_recording(written(tmp_path, content))
    for frame in content["frames"]:
        frame["info"] = {"timestamp": frame.pop("timestamp")}
        for hand in frame["hands"]:
            digits = [list(hand.pop(name).values()) for name in ("thumb", "index", "middle", "ring", "pinky")]
            hand["digits"] = [{"bones": bones} for bones in digits]
            hand["type"] = "eLeapHandType_Right"
            hand["palm"]["position"] = dict(zip("xyz", hand["palm"]["position"], strict=True))
    assert np.array_equal(load_recording(written(tmp_path, content["frames"])).joint_pose, plain.joint_pose)


def test_a_leap_palm_without_bones_moves_but_has_no_fingers(tmp_path):
    content = content_of(tmp_path, "leap")
    whole = load_recording(written(tmp_path, content), alignment=Y_UP).motion()
    for frame in content["frames"]:
        for hand in frame["hands"]:
            for name in ("thumb", "index", "middle", "ring", "pinky", "arm"):
                del hand[name]
    palm = load_recording(written(tmp_path, content), alignment=Y_UP)
    assert np.abs(palm.motion().pose - whole.pose).max() < 0.01  # 10 mm: where a palm's middle lies is a guess
    assert np.isnan(palm.joints_in_hand()[:, TIP]).all()


def test_a_mirrored_image_is_turned_back(tmp_path):
    content = content_of(tmp_path, "mediapipe")
    plain = load_recording(written(tmp_path, content))
    for frame in content["frames"]:
        for hand in frame["hands"]:
            hand["world_landmarks"] = [[-x, y, z] for x, y, z in hand["world_landmarks"]]
    path = written(tmp_path, content)
    assert np.allclose(load_recording(path, image_mirrored=True).joint_pose, plain.joint_pose)
    with pytest.raises(RecordingError, match=r"said to be a right hand.*left one.*bend to the back"):
        load_recording(path)


# --- which hand ----------------------------------------------------------------------------------


def two_hands(tmp_path):
    right, left = (
        json.loads(write_sample("openxr", tmp_path / "one.json", frame_count=4, is_left=side).read_text())
        for side in (False, True)
    )
    for a, b in zip(right["frames"], left["frames"], strict=True):
        a["hands"] += b["hands"]
    return right


def test_of_several_hands_one_is_chosen_by_side_or_id(tmp_path):
    path = written(tmp_path, two_hands(tmp_path))
    assert load_recording(path, hand="left").is_left
    assert not load_recording(path, hand="right").is_left
    with pytest.raises(RecordingError, match=r"several hands: right hand 'right' \(4 frames\), left hand 'left'"):
        load_recording(path)
    with pytest.raises(RecordingError, match=r"no hand '7'; there is right hand 'right'"):
        load_recording(path, hand=7)
    with pytest.raises(RecordingError, match=r"no hand 'lefd' \(did you mean 'left'\?\); there is right hand 'right'"):
        load_recording(path, hand="lefd")
    with pytest.raises(RecordingError, match=r"no hand 'left'; there is right hand 'right' \(6 frames\)$"):
        load_recording(written(tmp_path, content_of(tmp_path, "openxr")), hand="left")


def test_a_list_in_unity_s_order_is_refused_unless_its_joints_have_names(tmp_path):
    """XRHandJointID of Unity's XR Hands counts Wrist, Palm, ThumbMetacarpal ...; OpenXR's XrHandJointEXT Palm, Wrist.

    Unity's Pose has the fields position and rotation.
    """
    content = content_of(tmp_path, "openxr")
    plain = load_recording(written(tmp_path, content))
    hands = [frame["hands"][0] for frame in content["frames"]]
    named = [list(hand["joints"].values()) for hand in hands]
    for hand, joints in zip(hands, named, strict=True):
        hand["joints"] = joints
    assert np.array_equal(load_recording(written(tmp_path, content)).joint_pose, plain.joint_pose)
    for hand, joints in zip(hands, named, strict=True):
        hand["joints"] = [joints[1], joints[0], *joints[2:]]
    with pytest.raises(RecordingError, match=r"frame 0, right hand, joints: .*begin with the wrist, as Unity's"):
        load_recording(written(tmp_path, content))
    names = ["Wrist", "Palm", *("".join(map(str.capitalize, name.split("_"))) for name in JOINT_NAMES[2:])]
    for hand in hands:
        hand["joints"] = dict(zip(names, hand["joints"], strict=True))
        for joint in hand["joints"].values():
            joint["rotation"] = joint.pop("orientation")
    assert np.array_equal(load_recording(written(tmp_path, content)).joint_pose, plain.joint_pose)


def test_two_hands_of_one_side_at_once_are_told_apart_by_id_only(tmp_path):
    content = two_hands(tmp_path)
    for frame in content["frames"]:
        frame["hands"] = [{**frame["hands"][0], "id": 3}, {**frame["hands"][0], "id": 4}]
    path = written(tmp_path, content)
    assert load_recording(path, hand=4).hand_id == "4"
    with pytest.raises(RecordingError, match=r"right hand '3' \(4 frames\), right hand '4' .*choose one by id$"):
        load_recording(path, hand="right")


def test_a_hand_lost_and_found_again_is_one(tmp_path):
    content = content_of(tmp_path, "leap")
    for frame in content["frames"][3:]:
        frame["hands"][0]["id"] = 2
    content["frames"][2]["hands"] = []
    found = load_recording(written(tmp_path, content))
    assert (found.hand_id, len(found), found.counts["absent_frames"]) == ("1, 2", 6, 1)
    assert len(aligned(found).motion()) == 5
    assert len(load_recording(written(tmp_path, content), hand=2)) == 3


# --- gaps, resampling, alignment -----------------------------------------------------------------


def test_frames_that_are_not_known_are_gaps_of_time_and_counted(tmp_path):
    content = content_of(tmp_path, "openxr")
    content["frames"][2]["hands"][0]["joints"]["palm"]["position"] = [None, 0.1, 0.2]
    content["frames"][3]["hands"][0]["joints"]["index_tip"] = None
    content["frames"][4]["hands"][0]["joints"]["ring_tip"]["locationFlags"] = 1
    found = load_recording(written(tmp_path, content))
    assert found.counts["missing_joints"] == 3
    assert aligned(found).motion().time == pytest.approx([0, 1 / 30, 3 / 30, 4 / 30, 5 / 30])
    missing = np.argwhere(np.isnan(found.joints_in_hand()[..., 0])).tolist()
    assert missing == [[2, Joint.INDEX_TIP], [3, Joint.RING_TIP]]


def test_missing_joints_keep_their_place_in_the_hand_for_as_long_as_said():
    _, torn = lossy(range(10, 30))
    held = torn.held(0.1)
    assert np.flatnonzero(~held.known[:, TIP]).tolist() == list(range(20, 30))  # frame 19 is 0.1 s after frame 9
    assert held.counts["held_joints"] == 10
    local = rigid.pose_product(rigid.pose_inverse(held.joint_pose[:, PALM]), held.joint_pose[:, TIP])
    assert np.allclose(local[10:20], local[9])
    whole = torn.held(0.1, whole=True)
    assert (whole.counts["dropped_frames"], len(aligned(whole).motion())) == (10, 30)
    assert np.isfinite(whole.joints_in_hand()).all()


def test_resampling_is_exact_at_frames_and_never_bridges_a_long_gap():
    made, torn = lossy(range(10, 30))
    again = torn.resampled(100.0, 0.1)
    assert np.allclose(again.joint_pose, torn.joint_pose, atol=1e-9, equal_nan=True)
    finer = made.resampled(400.0)
    assert len(finer) == 157
    assert np.allclose(finer.joint_pose[::4], made.joint_pose, atol=1e-9)
    assert np.allclose(finer.joint_pose[2, :, :3], made.joint_pose[:2, :, :3].mean(axis=0))
    assert angle(finer.joint_pose[2, :, 3:], made.joint_pose[0, :, 3:]) == pytest.approx(
        angle(made.joint_pose[0, :, 3:], made.joint_pose[1, :, 3:]) / 2, abs=1e-4
    )
    assert torn.resampled(100.0, 0.25).known[:, TIP].all()
    assert not torn.resampled(100.0, 0.2).known[10:30, TIP].any()  # the gap is 0.21 s


def test_alignment_moves_everything_and_reads_back_from_its_file(tmp_path, rng):
    made = sample_recording(frame_count=3)
    pose = np.concatenate([rng.normal(size=3), Rotation.random(None, rng).as_quat()])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    write_alignment(tmp_path / "a.json", pose)
    by_rows = written(tmp_path, {"matrix": matrix.tolist()}, "b.json")
    wanted = made.joint_pose[..., :3] @ matrix[:3, :3].T + pose[:3]
    for alignment in (pose, matrix, tmp_path / "a.json", str(by_rows)):
        moved = made.transformed(alignment)
        assert np.allclose(moved.joint_pose[..., :3], wanted)
        assert np.allclose(moved.joints_in_hand(), made.joints_in_hand())


@pytest.mark.parametrize(
    ("alignment", "said"),
    [
        (np.diag([2.0, 2.0, 2.0, 1.0]), "scales by"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "mirrors"),
        (np.array([[1, 0.5, 0, 0], [0, math.sqrt(0.75), 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), "right angles"),
        (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [5, 0, 0, 1]]), r"last row .* 0 0 0 1"),
        ([0, 0, 0, 0, 0, 0, 0.9], "quaternion norm 0.9"),
        ([0, 0, 0], r"shape \[7\] or \[4, 4\], got \[3\]"),
        ([0, 0, math.nan, 0, 0, 0, 1], "not finite"),
        ([0, 1e30, 0, 0, 0, 0, 1], r"position \[0\.0, 1e\+30, 0\.0\] m must lie within 1e\+06 m"),
        (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2e6], [0, 0, 0, 1]]), "must lie within"),
        ("nowhere.json", "nowhere.json: cannot be read"),
    ],
)
def test_what_is_no_rigid_transform_is_refused(alignment, said):
    with pytest.raises(RecordingError, match=said):
        alignment_pose(alignment)


def test_a_hand_nowhere_in_front_of_the_array_is_warned_of():
    made = sample_recording(frame_count=5)
    with pytest.warns(RecordingWarning, match="nowhere in front of the array.*alignment"):
        made.motion()
    above = made.transformed(Y_UP).motion()
    assert above.pose[:, 2] == pytest.approx([0.2] * 5, abs=1e-4)  # the sample's height of the palm's skin


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"time": [0.0, 0.1, 0.1]}, r"frame 2: time 0\.1 s is not after 0\.1 s"),
        ({"time": [0.0, 0.1]}, r"time must have shape \[3\]"),
        ({"joint_radius": np.ones(25)}, r"joint_radius must have shape \[26\] or \[3, 26\]"),
        ({"joint_radius": np.full(26, -0.01)}, r"frame 0: palm has radius -0\.01 m"),
        ({"is_left": True}, "said to be a left hand, but its joints are those of a right one"),
        ({"valid": np.ones((3, 25), bool)}, r"valid must have shape \[3, 26\]"),
    ],
)
def test_a_recording_that_is_none_is_refused(fields, said):
    with pytest.raises(RecordingError, match=said):
        remade(sample_recording(frame_count=3), **fields)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: p * np.where(np.arange(7) < 3, 1e3, 1.0), r"measures 81\.\d* m across the palm.*another unit"),
        (lambda p: p * np.where(np.arange(7) < 3, 1e-3, 1.0), r"measures 8\.\d*e-05 m across"),
        (lambda p: p * np.where(np.arange(7) < 3, 1.0, 1.1), r"frame 0: palm has quaternion norm 1\.1"),
        (lambda p: p * [-1, 1, 1, 1, 1, 1, 1], "joints are those of a left one"),
        (lambda p: p * np.nan, "the palm is known in none of 3 frames"),
        (lambda p: p[:, :25], r"shape \[frame, 26, 7\], got \[3, 25, 7\]"),
    ],
)
def test_joints_that_are_no_hand_s_are_refused(change, said):
    made = sample_recording(frame_count=3)
    in_palm = rigid.pose_product(rigid.pose_inverse(made.joint_pose[:1, :1]), made.joint_pose)
    with pytest.raises(RecordingError, match=said):
        remade(made, joint_pose=change(in_palm))


def test_valid_joints_must_be_finite():
    made = sample_recording(frame_count=3)
    pose = made.joint_pose.copy()
    pose[1, 4, 2] = np.inf
    with pytest.raises(RecordingError, match="frame 1: thumb_distal is said to be valid, but is not finite"):
        remade(made, joint_pose=pose, valid=np.ones((3, 26), bool))


def drop(*keys):
    """Remove what these keys lead to."""

    def change(content):
        node = content
        for key in keys[:-1]:
            node = node[key]
        del node[keys[-1]]

    return change


def put(value, *keys):
    """Put a value where these keys lead to."""

    def change(content):
        node = content
        for key in keys[:-1]:
            node = node[key]
        node[keys[-1]] = value

    return change


FIRST = ("frames", 1, "hands", 0)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("form", "change", "said"),
    [
        ("openxr", drop(*FIRST, "joints", "index_tip"), r"frame 1, right hand: joint index_tip \(index-finger-tip\)"),
        ("openxr", put({}, *FIRST, "joints", "big_toe"), "frame 1, right hand: unknown joint 'big_toe'; known: palm"),
        ("openxr", drop("time_unit"), "'time_unit' is missing; it must be one of s, ms, us, ns"),
        ("openxr", put("inch", "length_unit"), "'length_unit' is 'inch'"),
        ("openxr", put("mm", "length_unit"), r"measures 8\.\d*e-05 m across the palm"),
        ("openxr", put("both", *FIRST, "handedness"), "handedness 'both' is neither left nor right"),
        ("openxr", put(0, "frames", 3, "time"), "frame 3: time 0.0 s is not after"),
        ("openxr", put([[0.0] * 3] * 9, *FIRST, "joints"), r"must have 26 joints \(OpenXR\) or 25 \(WebXR\), got 9"),
        ("openxr", put([0, 0, 0, 2], *FIRST, "joints", "palm", "orientation"), "frame 1: palm has quaternion norm 2"),
        ("openxr", put("x", *FIRST, "joints", "palm", "radius"), "palm, radius: must be a number, got 'x'"),
        ("openxr", put("svg", "format"), "unknown format 'svg'; known: leap, leapjs, openxr"),
        ("openxr", put([], "frames"), "looks like no known recording|no hand in any frame"),
        (
            "webxr",
            put(list(np.diag([1.0, 1, -1, 1]).ravel()), *FIRST, "joints", "wrist", "matrix"),
            "wrist, matrix: mir",
        ),
        ("webxr", put([1.0] * 12, *FIRST, "joints", "wrist", "matrix"), "wrist, matrix: must have 16 numbers, got 12"),
        ("mediapipe", drop(*FIRST, "wrist"), r"frame 1: world landmarks do not say where the hand is.*`wrist`"),
        (
            "mediapipe",
            drop(*FIRST, "world_landmarks", 20),
            "frame 1, right hand: 20 landmarks, not 21; missing: PINKY_TIP",
        ),
        ("leap", drop(*FIRST, "ring"), "frame 1, hand 1: digit 'ring' is missing"),
        ("leap", drop(*FIRST, "index", "distal"), "frame 1, hand 1, index: 'distal' is missing"),
        ("leap", drop(*FIRST, "palm", "normal"), "frame 1, hand 1: 'normal' is missing"),
        ("leap", put("left", *FIRST, "type"), "several hands: right hand '1'"),
    ],
)
def test_a_bad_file_is_refused_with_its_place(tmp_path, form, change, said):
    content = content_of(tmp_path, form)
    change(content)
    path = written(tmp_path, content)
    with pytest.raises(RecordingError, match=said) as caught:
        load_recording(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.json", '{"frames": [{"time": 1,', r"a\.json: line 1 column 24: not JSON"),
        ("a.json", '{"frames": [{"hands": []}]}', "looks like no known recording; say its format: leap"),
        (
            "a.bvh",
            "HIERARCHY",
            r"unknown suffix '.bvh' for a recording; known: .json, .jsonl, .ndjson, .lz, .npz, .csv",
        ),
        ("a.csv", "time_s,x,y\n1,2,3\n", "header is of no known recording: time_s, x, y"),
        ("a.csv", "", "empty file"),
        ("a.csv", "time_s,hand,joint\n1,left\n", "line 2: 2 columns, the header has 3"),
        ("a.csv", "time_s,hand,joint\n1,left,palm\n", "column x is missing; the header has time_s, hand, joint"),
        ("a.csv", "time_s,hand,landmark,x,y,z\n1,left,0,0,0,0\n", "do not say where the hand is"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(tmp_path, name, content, said):
    with pytest.raises(RecordingError, match=said):
        load_recording(written(tmp_path, content, name))


def test_csv_mistakes_are_named_with_their_line(tmp_path):
    lines = write_sample("openxr", tmp_path / "a.csv", frame_count=3).read_text().splitlines()
    for number, change, said in (
        (30, lambda line: line.replace(line.split(",")[3], "left"), r"line 31: 'left' in column x is not a number"),
        (30, lambda line: line.replace(line.split(",")[9], "3.0"), "line 28: thumb_proximal has quaternion norm 3"),
        (30, lambda line: "", r"the frame at line 28: joint thumb_proximal \(thumb-phalanx-proximal\)"),
        (30, lambda line: lines[29], "line 31: thumb_metacarpal is listed twice at this time"),
    ):
        torn = "\n".join([*lines[:number], change(lines[number]), *lines[number + 1 :]])
        with pytest.raises(RecordingError, match=said):
            load_recording(written(tmp_path, torn, "b.csv"))


def test_no_file_and_no_sample_are_named(tmp_path):
    with pytest.raises(RecordingError, match=r"gone\.json: no such recording"):
        load_recording(tmp_path / "gone.json")
    with pytest.raises(RecordingError, match=r"no sample of 'mano' as '\.json'; there are leap \.json"):
        write_sample("mano", tmp_path / "a.json")


# --- real recordings -----------------------------------------------------------------------------


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", LEAP)
def test_real_leap_recordings_become_hands_over_the_array(outside_data, name):
    with np.load(outside_data / "leap" / f"{name}.npz") as file:
        time, palm, normal = file["t"], file["palm_position"], file["palm_normal"]
    found = load_recording(outside_data / "leap" / f"{name}.npz", alignment=Y_UP)
    motion = found.motion()
    assert motion.time == pytest.approx(time - time[0], abs=1e-9)
    assert 0.075 < found.breadth < 0.09
    skin = -rigid.rotate(motion.pose[:, 3:].astype(float), np.array([0.0, 1.0, 0.0]))
    assert np.allclose(skin, normal[:, [0, 2, 1]] * [1, -1, 1], atol=2e-3)
    assert np.linalg.norm(motion.pose[:, :3] - palm[:, [0, 2, 1]] * [1, -1, 1], axis=1).max() < 0.035
    assert (motion.pose[:, 2] > 0.1).all()
    joints = found.joints_in_hand()
    assert np.isfinite(joints).all()
    assert np.abs(joints[:, list(Joint)[2:], 1]).max() < 0.15


def test_real_webxr_poses_have_the_orientations_that_are_derived_from_their_positions(outside_data):
    found = load_recording(outside_data / "hands" / "webxr_poses.json")
    assert (found.is_left, len(found)) == (True, 3)
    assert found.breadth == pytest.approx(0.0783, abs=1e-3)
    position, given = found.joint_pose[..., :3], found.joint_pose[..., 3:]
    derived = joint_orientations(position, rigid.matrix_of(given[:, PALM]), is_left=True)
    fingers = [joint for finger in FINGERS for joint in finger[1:]]
    assert np.median(angle(derived, given)[:, fingers]) < 12.0
    assert angle(derived, given)[:, fingers].max() < 40.0  # a curled finger's roll is not in its positions
    assert angle(derived, given)[:, list(Joint)[2:6]].max() < 35.0
    assert side_from_bends(position) == "left"
    assert side_from_bends(position * [-1, 1, 1]) == "right"
