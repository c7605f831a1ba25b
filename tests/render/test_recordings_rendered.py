"""Recorded hands over the array: their palms, finger patches and skins render, and what they feel plays."""

import numpy as np
import pytest

from palpate.datasets.hand_model.shape import hand_shape
from palpate.datasets.hand_model.skinning import posed_vertices
from palpate.datasets.recordings.alignment import Y_UP
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.recording import HandRecording
from palpate.datasets.recordings.sample import sample_recording
from palpate.datasets.rigid import pose_inverse, pose_product
from palpate.render import MeshObject, Palm, closed_contour, record, render
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.hands.plane_hand import PlaneHand
from palpate.render.playback.file_playback import Connection, play_file
from palpate.render.sampling.strategy import SamplingStrategy

VIRTUAL = Connection(clock="virtual")
LEAP = ["HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards"]
SLOW = SamplingStrategy(update_rate=1000.0)


@pytest.fixture(scope="module")
def tube():
    return MeshObject.load("tube")


def centred(recording):
    """The recording, so shifted that its palm is at the middle of the objects at the median."""
    middle = np.median(recording.skin_pose()[:, :3], axis=0)
    return recording.transformed([*(np.array([0.0, 0.05, 0.2]) - middle), 0.0, 0.0, 0.0, 1.0])


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", LEAP)
def test_real_leap_palms_render_and_play(outside_data, tube, tmp_path, name):
    motion = centred(load_recording(outside_data / "leap" / f"{name}.npz", alignment=Y_UP)).resampled(60.0).motion()
    path = tmp_path / "hand.h5"
    record(path, tube, Palm(), motion, closed_contour())
    touched = np.count_nonzero(render(tube, Palm(), motion, closed_contour()).length())
    assert touched > len(motion) / 4
    playback = play_file(path, sampling=SLOW, connection=VIRTUAL)
    assert playback.played.underruns == 0
    assert playback.played.frames == pytest.approx(1000 * motion.duration, abs=2)


def test_real_webxr_poses_render(outside_data, tube):
    recording = load_recording(outside_data / "hands" / "webxr_poses.json")
    still = HandRecording(
        None,
        pose_product(np.array([0.0, 0.05, 0.2, *Y_UP[3:]]), recording.joints_in_hand()),
        recording.joint_radius,
        is_left=recording.is_left,
    )
    assert (render(tube, Palm(), still.motion(), closed_contour()).length() > 0.05).all()


def test_where_the_hand_is_lost_playing_holds_the_last_pose_then_fades(tube, tmp_path):
    made = sample_recording(frame_count=60, rate=60.0)
    pose = made.joint_pose.copy()
    pose[20:50] = np.nan  # from frame 19 to 50 there are 31 / 60 s
    torn = centred(HandRecording(made.time, pose, made.joint_radius).transformed(Y_UP))
    motion = torn.motion()
    assert (len(motion), motion.duration) == (30, pytest.approx(1.0))
    record(tmp_path / "hand.h5", tube, Palm(), motion, closed_contour())
    played = play_file(tmp_path / "hand.h5", sampling=SLOW, connection=VIRTUAL).as_dict()
    held = 1000 * (31 / 60 - SLOW.hold)
    assert played["held"] == pytest.approx(held, abs=3)
    assert played["silent"] == pytest.approx(held - 1000 * SLOW.fade, abs=4)


@pytest.mark.parametrize("is_left", [False, True])
def test_finger_patches_and_skins_of_a_recording_feel_what_its_palm_feels(tube, is_left):
    recording = centred(sample_recording(frame_count=6, is_left=is_left).transformed(Y_UP))
    motion, joints, radius = recording.motion(), recording.joints_in_hand(), recording.radii()
    shape = hand_shape(is_left=is_left, detail=1)
    skin = MeshHand(posed_vertices(shape, joints, radius), shape.faces, glabrous=shape.glabrous)
    planes = PlaneHand.from_joints(joints, radius, is_left=is_left)
    lengths = [render(tube, hand, motion, closed_contour()).length() for hand in (planes, skin)]
    for length in lengths:
        assert (length > 0.05).all()
    assert lengths[1] == pytest.approx(lengths[0], rel=0.5)


def test_a_recording_s_own_poses_put_its_joints_back():
    recording = sample_recording(frame_count=4).transformed(Y_UP)
    pose = recording.motion().pose.astype(float)
    assert np.allclose(
        pose_product(pose_inverse(pose)[:, None], recording.joint_pose), recording.joints_in_hand(), atol=1e-6
    )
