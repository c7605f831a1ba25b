"""Recordings in other conventions are refused by the cause, and a left-handed frame's are read by an alignment.

Outside truths: Unity's frame is OpenXR's with z reversed, so a position is (x, y, -z) there and a rotation matrix R is
M R M with M = diag(1, 1, -1); scipy's rotations; the cosines of the project's table of wrong inputs (-0.87, -0.99).
"""

import json

import numpy as np
import pytest
from recording_cases import content_of, remade, written
from scipy.spatial.transform import Rotation

from palpate.datasets.errors import RecordingError
from palpate.datasets.hand_model.joints import Joint
from palpate.datasets.recordings.alignment import Y_UP, alignment_pose, split_alignment, write_alignment
from palpate.datasets.recordings.conventions import agreement_of, require_agreement
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import sample_recording, write_sample

M = np.diag([1.0, 1.0, -1.0])
UNITY = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # x right, y up, z away -> array's x, z, y


def tilted(angle=28.65, axis="x"):
    """Joints of a made right hand, turned as a whole: positions [frame, 26, 3] and rotations of frame x 26."""
    made = sample_recording(frame_count=4)
    turn = Rotation.from_euler(axis, angle, degrees=True)
    position = turn.apply(made.joint_pose[..., :3].copy().reshape(-1, 3)).reshape(4, 26, 3)
    return position, turn * Rotation.from_quat(made.joint_pose[..., 3:].reshape(-1, 4))


def dump(tmp_path, position, quaternion):
    """An OpenXR recording with these positions and orientations, whatever they mean."""
    content = content_of(tmp_path, "openxr")
    content["frames"] = content["frames"][: len(position)]
    for frame, places, turns in zip(content["frames"], position, quaternion.reshape(len(position), 26, 4), strict=True):
        joints = frame["hands"][0]["joints"].values()
        for joint, place, turn in zip(joints, places.tolist(), turns.tolist(), strict=True):
            joint |= {"position": place, "orientation": turn}
    return written(tmp_path, content)


def unity(position, turn):
    """The same in Unity's frame: positions, and quaternions of M R M."""
    return position @ M, Rotation.from_matrix(M @ turn.as_matrix() @ M)


def on_right(turn, euler):
    return (turn * Rotation.from_euler("xyz", euler, degrees=True)).as_quat()


def wrong(name):
    position, turn = tilted(axis="xyz", angle=[28.65, 15.0, 10.0]) if name != "w first" else tilted()
    if name == "Unity":
        position, turn = unity(position, turn)
    return position, {
        "w first": lambda: np.roll(turn.as_quat(), 1, axis=1),
        "Unity": turn.as_quat,
        "inverse": turn.inv().as_quat,
        "about X": lambda: on_right(turn, [180, 0, 0]),
        "about Y": lambda: on_right(turn, [0, 180, 0]),
        "about Z": lambda: on_right(turn, [0, 0, 180]),
        "other axes": lambda: on_right(turn, [0, 90, 0]),
        "half": lambda: unity(position, turn)[1].as_quat(),
    }[name]()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (
            "w first",
            r"the palm has the cosine -0\.87 .* least 0\.9 is needed; likely cause: quaternions are w x y z",
        ),
        ("Unity", r"cosine -0\.99 .* likely cause: the frame is left-handed, as Unity's: alignment=unity"),
        ("inverse", r"likely cause: quaternions are inverse: conjugate them"),
        ("about X", r"cosine -0\.99 .* \+Z axis runs to the tips, and -Z must: .* by \(1, 0, 0, 0\) on the right"),
        ("about Y", r"cosine -0\.99 .* \+Z axis runs to the tips, and -Z must: .* by \(0, 1, 0, 0\) on the right"),
        ("about Z", r"the joints' axes are turned by 180 degrees about Z"),
        (
            "other axes",
            r"[+-]X axis runs to the tips, and -Z must: .* by \(0, -0\.707, 0, 0\.707\)",
        ),
        ("half", r"likely cause: orientations have z reversed, positions have not"),
    ],
)
def test_orientations_that_contradict_positions_are_refused_by_the_likely_cause(tmp_path, name, said):
    with pytest.raises(RecordingError, match=rf"hand\.json: .*{said}"):
        load_recording(dump(tmp_path, *wrong(name)))


def test_the_same_hand_in_palpate_s_convention_is_read(tmp_path):
    position, turn = tilted()
    found = load_recording(dump(tmp_path, position, turn.as_quat()))
    assert agreement_of(found.joint_pose[..., :3], found.joint_pose[..., 3:]).palm == pytest.approx(0.995, abs=2e-3)


def test_conjugates_of_a_nearly_level_hand_are_found_by_its_fingers(tmp_path):
    """Turned by 8 degrees the palm agrees (cosine 0.95); bent fingers do not, and conjugates explain both."""
    position, turn = tilted(8.0)
    quaternion = turn.inv().as_quat().reshape(4, 26, 4)
    assert agreement_of(position, quaternion).palm > 0.9
    with pytest.raises(RecordingError, match=r"the mean cosine 0\.\d\d, .* likely cause: quaternions are inverse"):
        require_agreement(position, quaternion, "right")


def test_a_leap_recording_s_rotations_count_although_its_palm_has_none(tmp_path):
    """The palm's axes are its normal and direction; rotations of bones with w first contradict the bones."""
    content = content_of(tmp_path, "leap")
    for bone in bones_of(content):
        bone["rotation"] = [bone["rotation"][3], *bone["rotation"][:3]]
    with pytest.raises(
        RecordingError, match=r"-Z axis of fingers' joints has .* likely cause: quaternions are w x y z"
    ):
        load_recording(written(tmp_path, content))


def bones_of(node):
    below = node.values() if isinstance(node, dict) else node if isinstance(node, list) else []
    own = [node] if isinstance(node, dict) and "rotation" in node else []
    return own + [bone for value in below for bone in bones_of(value)]


def test_a_recording_made_by_a_script_is_checked_too():
    made = sample_recording(frame_count=3)
    pose = made.joint_pose.copy()
    pose[..., 3:] = on_right(Rotation.from_quat(pose[..., 3:].reshape(-1, 4)), [180, 0, 0]).reshape(3, 26, 4)
    with pytest.raises(RecordingError, match="orientations contradict positions"):
        remade(made, joint_pose=pose)


@pytest.mark.parametrize("alignment", ["unity", UNITY])
def test_a_left_handed_dump_gives_the_motion_of_the_right_handed_recording(tmp_path, alignment):
    position, turn = tilted()
    plain = load_recording(dump(tmp_path, position, turn.as_quat()), alignment=Y_UP)
    mirrored, turned = unity(position, turn)
    found = load_recording(dump(tmp_path, mirrored, turned.as_quat()), alignment=alignment)
    assert not found.is_left
    np.testing.assert_allclose(found.joint_pose[..., :3], plain.joint_pose[..., :3], atol=1e-12)
    np.testing.assert_allclose(found.motion().pose, plain.motion().pose, atol=1e-6)
    same = np.abs(np.sum(found.joint_pose[..., 3:] * plain.joint_pose[..., 3:], axis=2))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)


@pytest.mark.parametrize("suffix", [".json", ".csv", ".npz"])
def test_a_left_handed_leap_recording_of_vectors_is_read_as_the_right_handed_one(tmp_path, suffix):
    """Every z is reversed, as Unity has it: of positions, of the palm's normal and direction; rotations left out."""
    path = write_sample("leap", tmp_path / f"hand{suffix}", frame_count=3)
    if suffix == ".json":
        path.write_text(json.dumps(reversed_z(json.loads(path.read_text()))))
        plain = load_recording(write_sample("leap", tmp_path / "plain.csv", frame_count=3), alignment=Y_UP)
    else:
        plain = load_recording(path, alignment=Y_UP)
    if suffix == ".csv":
        rows = [line.split(",") for line in path.read_text().splitlines()]
        z = [k for k, name in enumerate(rows[0]) if name.endswith("_z")]
        for row in rows[1:]:
            for k in z:
                row[k] = str(-float(row[k]))
        path.write_text("\n".join(",".join(row) for row in rows))
    if suffix == ".npz":
        with np.load(path) as file:
            arrays = dict(file)
        for name in ("palm_position", "palm_normal", "palm_direction", "joints"):
            arrays[name] = arrays[name] * [1, 1, -1]
        np.savez(path, **arrays)
    with pytest.raises(RecordingError, match=r"mirrored positions, as in Unity's .*alignment=unity"):
        load_recording(path)
    found = load_recording(path, alignment="unity")
    np.testing.assert_allclose(found.joint_pose[..., :3], plain.joint_pose[..., :3], atol=1e-5)
    np.testing.assert_allclose(found.motion().pose, plain.motion().pose, atol=1e-5)


def reversed_z(node):
    if isinstance(node, dict):
        return {name: reversed_z(value) for name, value in node.items() if name != "rotation"}
    if isinstance(node, list) and len(node) == 3 and all(isinstance(value, (int, float)) for value in node):
        return [node[0], node[1], -node[2]]
    return [reversed_z(value) for value in node] if isinstance(node, list) else node


def test_an_alignment_that_mirrors_a_right_handed_recording_is_named(tmp_path):
    position, turn = tilted()
    with pytest.raises(RecordingError, match="frame is right-handed, but the alignment mirrors"):
        load_recording(dump(tmp_path, position, turn.as_quat()), alignment=UNITY)


def test_an_alignment_that_mirrors_is_kept_in_its_file_and_is_no_rigid_transform(tmp_path):
    matrix = UNITY.copy()
    matrix[:3, 3] = [0.1, 0.2, 0.3]
    write_alignment(tmp_path / "unity.json", matrix)
    np.testing.assert_allclose(json.loads((tmp_path / "unity.json").read_text())["matrix"], matrix, atol=1e-15)
    found = split_alignment(tmp_path / "unity.json")
    assert found.mirrors
    np.testing.assert_allclose(found.pose, [0.1, 0.2, 0.3, *Y_UP[3:]], atol=1e-15)
    with pytest.raises(RecordingError, match=r"mirrors .*; load_recording takes it"):
        alignment_pose(tmp_path / "unity.json")


@pytest.mark.parametrize("name", ["leap/grab.npz", "leap/rollAndPitchCropped.npz", "hands/webxr_poses.json"])
def test_real_hands_agree(outside_data, name):
    """Real recordings: cosines of at least 0.99 in every frame."""
    found = load_recording(outside_data / name)
    palm = Rotation.from_quat(found.joint_pose[:, Joint.PALM, 3:]).apply([0, 0, -1])
    along = found.joint_pose[:, Joint.MIDDLE_PROXIMAL, :3] - found.joint_pose[:, Joint.WRIST, :3]
    assert (np.sum(palm * along, axis=1) / np.linalg.norm(along, axis=1)).min() > 0.99
    assert agreement_of(found.joint_pose[..., :3], found.joint_pose[..., 3:]).is_enough


@pytest.mark.parametrize("name", ["leap/grab.npz", "hands/webxr_poses.json"])
def test_conventions_of_real_hands_are_told_apart_and_noise_is_none(outside_data, name):
    """Real hands, written in three other conventions, and with 20 degrees of noise (rms) at each joint."""
    found = load_recording(outside_data / name)
    position, quaternion = found.joint_pose[:40, :, :3].copy(), found.joint_pose[:40, :, 3:].copy()
    side, turn = "left" if found.is_left else "right", Rotation.from_quat(quaternion.reshape(-1, 4))
    noise = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(len(turn), 3)) * np.radians(20) / np.sqrt(3))
    require_agreement(position, (turn * noise).as_quat().reshape(quaternion.shape), side)
    mirrored, turned = unity(position, turn)
    for places, turns, cause in (
        (position, turn.inv().as_quat(), "quaternions are inverse"),
        (position, np.roll(turn.as_quat(), 1, axis=1), "quaternions are w x y z"),
        (mirrored, turned.as_quat(), "the frame is left-handed"),
    ):
        with pytest.raises(RecordingError, match=f"likely cause: {cause}"):
            require_agreement(places, turns.reshape(quaternion.shape), side)
