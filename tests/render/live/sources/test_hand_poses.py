"""Poses of the palm and of patches from joints of one frame, beside those of whole recordings, which are other code."""

import os
from pathlib import Path

import numpy as np
import pytest
from live_senders import palm_at

from palpate.datasets import Y_UP, HandRecording, load_recording
from palpate.datasets.hand_model.joints import Joint
from palpate.datasets.recordings.conventions import mirrored
from palpate.datasets.recordings.leap import leap_arrays
from palpate.datasets.recordings.sample import sample_recording
from palpate.render.hands.plane_hand import PlaneHand
from palpate.render.live.sources.hand_frame import SeenHand
from palpate.render.live.sources.hand_poses import MEASURED, HandPoses
from palpate.render.live.sources.named_sources import patch_layout
from palpate.render.live.sources.plausibility import Implausible

DATA = Path(os.environ.get("PALPATE_TEST_DATA", ""))
needs_data = pytest.mark.skipif("PALPATE_TEST_DATA" not in os.environ, reason="set PALPATE_TEST_DATA")


def recorded(*, is_left=False, frame_count=40):
    return sample_recording(frame_count=frame_count, rate=100.0, is_left=is_left).transformed(Y_UP)


def planes_of(recording):
    return PlaneHand.from_joints(recording.joints_in_hand(), recording.radii(), is_left=recording.is_left)


HANDS = {is_left: planes_of(recorded(is_left=is_left)) for is_left in (False, True)}


def frame_of(recording, k, **changes):
    side = "left" if recording.is_left else "right"
    values = {"side": side, "hand_id": "1", "joints": recording.joint_pose[k], "radius": recording.joint_radius}
    return SeenHand(float(recording.time[k]), **(values | changes))


@pytest.mark.parametrize("is_left", [False, True], ids=["right", "left"])
def test_palm_and_patches_are_those_of_the_recording(is_left):
    recording = recorded(is_left=is_left)
    hand = HANDS[is_left]
    poses = HandPoses(None, patch_layout(hand))
    skin = recording.skin_pose()
    for k in range(len(recording)):
        pose, patch_pose = poses.posed(frame_of(recording, k))
        assert patch_pose.dtype == np.float32
        if k < MEASURED - 1:
            continue
        assert np.allclose(pose, skin[k], atol=2e-4)  # a median over the first frames, beside one over all
        exact, patch_pose = poses.posed(frame_of(recording, k, pose=skin[k]))
        assert np.array_equal(exact, skin[k])
        expected = hand.patch_pose[k]
        flip = np.sign(np.sum(expected[:, 3:] * patch_pose[:, 3:], axis=1, keepdims=True))
        assert np.allclose(patch_pose[:, :3], expected[:, :3], atol=1e-6)
        assert np.allclose(patch_pose[:, 3:] * flip, expected[:, 3:], atol=1e-6)


def test_what_is_measured_of_a_hand_stays_and_is_measured_anew_for_another():
    recording = recorded(frame_count=MEASURED + 5)
    poses = HandPoses()
    for k in range(MEASURED):
        poses.posed(frame_of(recording, k))
    thick = frame_of(recording, MEASURED, radius=recording.joint_radius * 2.0)
    palm = recording.joint_pose[MEASURED, Joint.PALM]
    kept, _ = poses.posed(thick)
    assert np.linalg.norm(kept[:3] - palm[:3]) < 1.5 * recording.joint_radius[0] + 0.03
    poses.restart()
    anew, _ = poses.posed(thick)
    assert anew[2] - kept[2] == pytest.approx(-recording.joint_radius[0], abs=2e-3)  # palm down: its skin is lower


@pytest.mark.parametrize("alignment", [Y_UP, "y-up", [0.1, 0.2, 0.0, 0.0, 0.0, 1.0, 0.0]])
def test_poses_are_aligned_as_a_recording_is(alignment):
    made = sample_recording(frame_count=3)
    pose, _ = HandPoses(alignment).posed(frame_of(made, 1))
    one = HandRecording(made.time[:1], made.joint_pose[1:2], made.joint_radius).transformed(
        Y_UP if isinstance(alignment, str) else alignment
    )
    assert np.allclose(pose, one.skin_pose()[0], atol=1e-12)


def test_a_left_handed_frame_is_mirrored():
    made = sample_recording(frame_count=1)
    position, quaternion = mirrored(made.joint_pose[0, :, :3], made.joint_pose[0, :, 3:])
    frame = frame_of(made, 0, joints=np.concatenate([position, quaternion], axis=1))
    assert np.allclose(HandPoses("unity").posed(frame)[0], HandPoses(Y_UP).posed(frame_of(made, 0))[0], atol=1e-12)
    with pytest.raises(Implausible, match="the frame is left-handed, as Unity's: alignment=unity"):
        HandPoses("y-up").posed(frame)


def test_what_a_tracker_does_not_give_is_derived():
    """Leap gives no place of PALM; a tracker of points gives no orientations, metacarpals and radii."""
    recording = recorded()
    whole, _ = HandPoses().posed(frame_of(recording, 0))
    leap = recording.joint_pose[0].copy()
    leap[Joint.PALM, :3] = np.nan
    points = recording.joint_pose[0].copy()
    points[:, 3:] = np.nan
    points[[Joint.PALM, Joint.INDEX_METACARPAL, Joint.MIDDLE_METACARPAL]] = np.nan
    for joints, tolerance in ((leap, 3e-3), (points, 10e-3)):
        pose, _ = HandPoses().posed(frame_of(recording, 0, joints=joints, radius=None))
        assert np.linalg.norm(pose[:3] - whole[:3]) < tolerance
        assert abs(pose[3:] @ whole[3:]) > 0.99


def test_a_frame_without_what_the_palm_follows_from_has_no_pose():
    recording = recorded()
    joints = recording.joint_pose[0].copy()
    joints[:11] = np.nan
    joints[Joint.MIDDLE_METACARPAL :: 1][:2] = np.nan
    assert HandPoses().posed(frame_of(recording, 0, joints=joints)) == (None, None)


def test_a_joint_that_is_missing_keeps_its_place_for_a_tenth_of_a_second():
    recording = recorded()
    hand = HANDS[False]
    poses = HandPoses(None, patch_layout(hand))
    tip = hand.patch_index("index-distal")
    joints = recording.joint_pose.copy()
    joints[1:, Joint.INDEX_TIP] = np.nan
    there = []
    for k in range(20):
        frame = frame_of(recording, k, joints=joints[k])
        there.append(not np.isnan(poses.posed(frame)[1][tip]).any())
    assert there == [k <= 10 for k in range(20)]  # at 100 Hz


def test_a_palm_alone_has_its_fingers_at_rest():
    layout = patch_layout(HANDS[False])
    pose, patch_pose = HandPoses(None, layout).posed(SeenHand(0.0, "right", "1", palm_at(0.0)))
    assert np.array_equal(pose, palm_at(0.0))
    assert np.array_equal(patch_pose, layout.rest)


@needs_data
@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["grab", "rollAndPitchCropped", "HandSplay-110fps", "test-paddle-rightwards"])
def test_recorded_hands_frame_by_frame_have_the_palms_of_the_whole_recording(name):
    """Real hands as the tracker gave them: what is missing is derived in each frame alone."""
    path = DATA / "leap" / f"{name}.npz"
    recording, clip = load_recording(path).transformed(Y_UP), leap_arrays(path)
    poses, found = HandPoses(Y_UP), []
    for one in clip.sightings[: MEASURED + 100]:
        joints = np.concatenate([one.position, one.quaternion], axis=1)
        frame = SeenHand(clip.time[one.frame], one.side, one.hand_id, None, joints, one.radius)
        found.append(poses.posed(frame)[0])
    skin = recording.skin_pose()[: len(found)]
    away = np.linalg.norm(np.array(found)[:, :3] - skin[:, :3], axis=1)
    assert away.max() < 1e-5
    assert np.allclose(np.abs(np.sum(np.array(found)[:, 3:] * skin[:, 3:], axis=1)), 1.0, atol=1e-9)
