"""Small recordings of each format, made: a hand of average size that moves over the array and opens and closes.

What tests read and users look at to see a format; nothing in them is recorded.
"""

import json
import math
from io import BytesIO
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError
from ..hand_model.joints import (
    DIGITS,
    ENDS_JOINTS,
    JOINT_COUNT,
    JOINT_NAMES,
    LEAP_BONES,
    LEAP_DIGITS,
    MEDIAPIPE_JOINTS,
    MEDIAPIPE_NAMES,
    WEBXR_NAMES,
    Joint,
)
from ..hand_model.shape import hand_shape
from ..motions.hand_motion import PALM_DOWN
from ..rigid import Numbers, matrix_of, pose_inverse, pose_product, rotate
from ..storage.durable import write_file
from .alignment import Y_UP
from .leap import TIP_RADIUS_SHARE
from .recording import HandRecording

_START = 12.0  # [s] on the tracker's clock at the first frame
_HEIGHT, _SWING = 0.2, 0.03  # [m]


def sample_recording(*, frame_count: int = 30, rate: float = 30.0, is_left: bool = False) -> HandRecording:
    """A made hand in a tracker's frame whose y is up (`Y_UP` aligns it): it circles while its fingers close and open.

    Raises RecordingError for less than one frame or an unusable rate.
    """
    if frame_count < 1 or not (math.isfinite(rate) and rate > 0.0):
        raise RecordingError(f"a sample needs at least one frame and a rate, got {frame_count} at {rate!r} Hz")
    shape = hand_shape(is_left=is_left)
    turn = 2.0 * math.pi * np.arange(frame_count) / max(frame_count, 2)
    joints = _bent(shape.joint_pose, 0.45 * (1.0 - np.cos(turn)))
    place = np.stack([_SWING * np.cos(turn), _SWING * np.sin(turn), np.full_like(turn, _HEIGHT)], axis=1)
    hand = np.concatenate([place, np.broadcast_to(np.array(PALM_DOWN), (frame_count, 4))], axis=1)
    pose = pose_product(pose_inverse(np.array(Y_UP)), pose_product(hand[:, None], joints))
    time = _START + np.arange(frame_count) / rate
    return HandRecording(time, pose, shape.joint_radius, None, is_left, hand_id="1")


def write_sample(format: str, path: str | PathLike[str], *, frame_count: int = 30, is_left: bool = False) -> Path:
    """Write a made recording in a format of `load_recording`, as .json or .csv, leap as .npz too; gives the path.

    Raises RecordingError for a format or suffix that there is not, and where the file cannot be written.

    >>> from palpate.datasets import write_sample
    >>> path = write_sample("openxr", "hand.csv", frame_count=2)
    >>> lines = path.read_text().splitlines()
    >>> lines[0], len(lines)  # a header, and 26 joints in each of 2 frames
    ('time_ns,hand,joint,x,y,z,qx,qy,qz,qw,radius', 53)
    """
    target = Path(path)
    writers = {
        ("leap", ".json"): _leap_json,
        ("leap", ".csv"): _leap_csv,
        ("openxr", ".json"): _openxr_json,
        ("openxr", ".csv"): _openxr_csv,
        ("webxr", ".json"): _webxr_json,
        ("webxr", ".csv"): _webxr_csv,
        ("mediapipe", ".json"): _mediapipe_json,
        ("mediapipe", ".csv"): _mediapipe_csv,
        ("webxr-static", ".json"): _static_json,
    }
    write = writers.get((format, target.suffix.lower()))
    recording = sample_recording(frame_count=frame_count, is_left=is_left)
    try:
        if (format, target.suffix.lower()) == ("leap", ".npz"):
            _write_arrays(target, recording)
        elif write is None:
            known = ", ".join(f"{name} {suffix}" for name, suffix in (*writers, ("leap", ".npz")))
            raise RecordingError(f"{target}: no sample of {format!r} as {target.suffix!r}; there are {known}")
        else:
            write_file(target, write(recording).encode())
    except OSError as error:
        raise RecordingError(f"{target}: cannot be written: {error}") from error
    return target


def _bent(rest: Numbers, angle: Numbers) -> Numbers:
    """Joints whose fingers bend by angles [rad] at each of three joints, the thumb by half; shape [frame, 26, 7]."""
    joints = np.broadcast_to(rest, (len(angle), *rest.shape)).copy()
    for digit in DIGITS:
        flex = angle * (0.5 if digit is DIGITS[0] else 1.0)
        bend, still = np.zeros((len(angle), 7)), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        bend[:, 3], bend[:, 6] = -np.sin(flex / 2.0), np.cos(flex / 2.0)  # about -X: from the tips to the palm
        for before, after in pairwise(digit):
            local = pose_product(pose_inverse(rest[before]), rest[after])
            turned = still if after == digit[-1] else bend
            joints[:, after] = pose_product(pose_product(joints[:, before], local), turned)
    return joints


def _side(recording: HandRecording) -> str:
    return "left" if recording.is_left else "right"


def _clock(recording: HandRecording, unit: float) -> list[int]:
    time = recording.time if recording.time is not None else np.arange(len(recording)) / 30.0
    return [round((value + recording.offset) / unit) for value in time.tolist()]


def _round_values(values: Numbers, digits: int = 6) -> list[Any]:
    return np.round(values, digits).tolist()


def _json(head: dict[str, Any], frames: list[dict[str, Any]]) -> str:
    lines = ",\n".join(json.dumps(frame, separators=(",", ":")) for frame in frames)
    return json.dumps(head)[:-1] + f', "frames": [\n{lines}\n]}}\n'


def _csv(columns: list[str], rows: list[list[Any]]) -> str:
    return "\n".join(",".join(map(str, row)) for row in [columns, *rows]) + "\n"


def _leap_bones(pose: Numbers, radius: Numbers, digit: int) -> list[tuple[Numbers, Numbers, float, Numbers]]:
    """Ends [mm], width [mm] and rotation of a digit's four bones; the thumb's metacarpal has no length."""
    joints = DIGITS[digit] if digit else (DIGITS[0][0], *DIGITS[0])
    bones: list[tuple[Numbers, Numbers, float, Numbers]] = []
    for start, end in pairwise(joints):
        wide = radius[joints[1] if start == joints[0] else start]
        bones.append((pose[start, :3] * 1e3, pose[end, :3] * 1e3, 2e3 * float(wide), pose[start, 3:]))
    return bones


def _leap_palm(recording: HandRecording, pose: Numbers) -> tuple[Numbers, Numbers, Numbers, float]:
    """Position [mm], normal, direction and width [mm], as Leap has them: 20 mm behind the middle knuckle."""
    axes = matrix_of(pose[Joint.PALM, 3:])
    position = (pose[Joint.MIDDLE_PROXIMAL, :3] + 0.02 * axes[:, 2]) * 1e3
    return position, -axes[:, 1], -axes[:, 2], recording.breadth * 1e3


def _leap_json(recording: HandRecording) -> str:
    frames: list[dict[str, Any]] = []
    for stamp, pose in zip(_clock(recording, 1e-6), recording.joint_pose, strict=True):
        position, normal, direction, width = _leap_palm(recording, pose)
        palm = {
            "position": _round_values(position, 3),
            "normal": _round_values(normal),
            "direction": _round_values(direction),
        }
        hand: dict[str, Any] = {"id": 1, "type": _side(recording), "palm": {**palm, "width": round(width, 3)}}
        for digit, name in enumerate(LEAP_DIGITS):
            bones = _leap_bones(pose, recording.joint_radius, digit)
            hand[name] = {
                bone: {
                    "prev_joint": _round_values(a, 3),
                    "next_joint": _round_values(b, 3),
                    "width": round(w, 3),
                    "rotation": _round_values(q),
                }
                for bone, (a, b, w, q) in zip(LEAP_BONES, bones, strict=True)
            }
        hand["arm"] = {"next_joint": _round_values(pose[Joint.WRIST, :3] * 1e3, 3)}
        frames.append({"timestamp": stamp, "hands": [hand]})
    return _json({"format": "leap", "length_unit": "mm", "time_unit": "us"}, frames)


def _leap_csv(recording: HandRecording) -> str:
    columns = ["timestamp", "hand_id", "type"]
    columns += [f"palm_{name}_{axis}" for name in ("position", "normal", "direction") for axis in "xyz"]
    columns += ["palm_width", *(f"arm_next_{axis}" for axis in "xyz")]
    for digit in LEAP_DIGITS:
        for bone in LEAP_BONES:
            columns += [f"{digit}_{bone}_{end}_{axis}" for end in ("prev", "next") for axis in "xyz"]
            columns.append(f"{digit}_{bone}_width")
    rows: list[list[Any]] = []
    for stamp, pose in zip(_clock(recording, 1e-6), recording.joint_pose, strict=True):
        position, normal, direction, width = _leap_palm(recording, pose)
        row: list[Any] = [stamp, 1, _side(recording), *_round_values(np.concatenate([position, normal, direction]), 4)]
        row += [round(width, 3), *_round_values(pose[Joint.WRIST, :3] * 1e3, 3)]
        for digit in range(5):
            for start, end, wide, _ in _leap_bones(pose, recording.joint_radius, digit):
                row += [*_round_values(start, 3), *_round_values(end, 3), round(wide, 3)]
        rows.append(row)
    return _csv(columns, rows)


def _write_arrays(path: Path, recording: HandRecording) -> None:
    count = len(recording)
    palm = [_leap_palm(recording, pose) for pose in recording.joint_pose]
    joints = np.stack([recording.joint_pose[:, list(ends), :3] for ends in ENDS_JOINTS], axis=1)
    tips = recording.joint_radius[[digit[-1] for digit in DIGITS]] / TIP_RADIUS_SHARE
    content = BytesIO()
    np.savez_compressed(
        content,
        t=np.array(_clock(recording, 1e-6)) * 1e-6,
        hand_id=np.ones(count, dtype=np.int64),
        is_left=np.full(count, recording.is_left),
        palm_position=np.array([row[0] for row in palm]) * 1e-3,
        palm_normal=np.array([row[1] for row in palm]),
        palm_direction=np.array([row[2] for row in palm]),
        joints=joints,
        finger_width=np.tile(2.0 * tips, (count, 1)),
        length_unit=np.array("m"),
    )
    write_file(path, content.getbuffer())


def _openxr_json(recording: HandRecording) -> str:
    return _joints_json(recording, "openxr", 0)


def _webxr_json(recording: HandRecording) -> str:
    return _joints_json(recording, "webxr", 1)


def _joints_json(recording: HandRecording, form: str, first: int) -> str:
    unit, second = ("ns", 1e-9) if form == "openxr" else ("ms", 1e-3)
    frames: list[dict[str, Any]] = []
    for stamp, pose in zip(_clock(recording, second), recording.joint_pose, strict=True):
        joints: dict[str, Any] = {}
        for joint in range(first, JOINT_COUNT):
            radius = round(float(recording.joint_radius[joint]), 6)
            if form == "openxr":
                values = {"position": _round_values(pose[joint, :3]), "orientation": _round_values(pose[joint, 3:])}
                joints[JOINT_NAMES[joint]] = {**values, "radius": radius}
            else:
                joints[WEBXR_NAMES[joint]] = {"matrix": _columns(pose[joint]), "radius": radius}
        frames.append({"time": stamp, "hands": [{"handedness": _side(recording), "joints": joints}]})
    return _json({"format": form, "length_unit": "m", "time_unit": unit}, frames)


def _columns(pose: Numbers) -> list[float]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = matrix_of(pose[3:]), pose[:3]
    return _round_values(matrix.T.ravel(), 7)


def _openxr_csv(recording: HandRecording) -> str:
    return _joints_csv(recording, JOINT_NAMES, 0)


def _webxr_csv(recording: HandRecording) -> str:
    return _joints_csv(recording, WEBXR_NAMES, 1)


def _joints_csv(recording: HandRecording, names: tuple[str, ...], first: int) -> str:
    columns = ["time_ns", "hand", "joint", "x", "y", "z", "qx", "qy", "qz", "qw", "radius"]
    rows: list[list[Any]] = []
    for stamp, pose in zip(_clock(recording, 1e-9), recording.joint_pose, strict=True):
        for joint in range(first, JOINT_COUNT):
            radius = round(float(recording.joint_radius[joint]), 6)
            rows.append([stamp, _side(recording), names[joint], *_round_values(pose[joint]), radius])
    return _csv(columns, rows)


def _landmarks(pose: Numbers) -> tuple[Numbers, Numbers]:
    """World landmarks around the hand's middle, and the wrist's place, in a camera's frame: y down, z away from it."""
    about_x = np.array([1.0, 0.0, 0.0, 0.0])
    place = rotate(about_x, pose[list(MEDIAPIPE_JOINTS), :3])
    return place - place.mean(axis=0), place[0]


def _mediapipe_json(recording: HandRecording) -> str:
    frames: list[dict[str, Any]] = []
    for stamp, pose in zip(_clock(recording, 1e-3), recording.joint_pose, strict=True):
        landmark, wrist = _landmarks(pose)
        hand = {
            "handedness": _side(recording),
            "world_landmarks": _round_values(landmark),
            "wrist": _round_values(wrist),
        }
        frames.append({"time": stamp, "hands": [hand]})
    head = {"format": "mediapipe", "length_unit": "m", "time_unit": "ms", "image_mirrored": False}
    return _json(head, frames)


def _mediapipe_csv(recording: HandRecording) -> str:
    columns = ["time_ms", "hand", "landmark", "x", "y", "z", "wrist_x", "wrist_y", "wrist_z"]
    rows: list[list[Any]] = []
    for stamp, pose in zip(_clock(recording, 1e-3), recording.joint_pose, strict=True):
        landmark, wrist = _landmarks(pose)
        for name, place in zip(MEDIAPIPE_NAMES, landmark, strict=True):
            rows.append([stamp, _side(recording), name, *_round_values(place), *_round_values(wrist)])
    return _csv(columns, rows)


def _static_json(recording: HandRecording) -> str:
    poses: dict[str, dict[str, Any]] = {}
    for name, pose in (("open", recording.joint_pose[0]), ("closed", recording.joint_pose[len(recording) // 2])):
        poses[name] = {
            WEBXR_NAMES[joint]: {"m": _columns(pose[joint]), "r": round(float(recording.joint_radius[joint]), 6)}
            for joint in range(1, JOINT_COUNT)
        }
    return json.dumps(poses) + "\n"
