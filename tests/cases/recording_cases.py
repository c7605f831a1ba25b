"""Recordings of hands as tests write and change them."""

import json

import numpy as np

from palpate.datasets.hand_model.joints import (
    Joint,
)
from palpate.datasets.recordings.recording import HandRecording
from palpate.datasets.recordings.sample import sample_recording, write_sample

PALM, TIP = Joint.PALM, Joint.LITTLE_TIP


def written(tmp_path, content, name="hand.json"):
    path = tmp_path / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def content_of(tmp_path, form):
    return json.loads(write_sample(form, tmp_path / f"{form}.json", frame_count=6).read_text())


def remade(recording, **fields):
    values = {
        "time": recording.time,
        "joint_pose": recording.joint_pose,
        "joint_radius": recording.joint_radius,
        "valid": None,
        "is_left": recording.is_left,
    }
    return HandRecording(**(values | fields))


def lossy(lost, frame_count=40, rate=100.0):
    """A hand whose little finger's tip is missing in `lost` frames."""
    made = sample_recording(frame_count=frame_count, rate=rate)
    pose = made.joint_pose.copy()
    pose[lost, TIP] = np.nan
    return made, remade(made, joint_pose=pose)
