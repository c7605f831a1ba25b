"""OpenXR's 26 joints and WebXR's 25, as JSON, CSV, and WebXR's static poses (iwer's shape).

Metres, quaternions xyzw; a joint as position and orientation, or as a 4 x 4 matrix by columns, as WebXR gives it.
"""

import math

import numpy as np

from ..errors import RecordingError
from ..hand_model.joints import JOINT_COUNT, JOINT_NAMES, Joint, joint_from, webxr_name
from ..rigid import Flags, Numbers, quaternion_of
from .clip import SIDES, Clip, Sighting, frame_place, line_place, name_place, side_named, unknown_joints
from .json_fields import (
    LENGTH_UNITS,
    TIME_UNITS,
    Json,
    Table,
    entry,
    flags,
    items,
    mapping,
    number,
    optional,
    truth,
    unit_factor,
    vector,
)

_BOTH_VALID = 2 | 1  # XrSpaceLocationFlags: position and orientation
_STATIC_MATRIX, _STATIC_RADIUS = "m", "r"


def joints_json(content: Json) -> Clip:
    """All hands of an OpenXR or WebXR recording; docs/formats/recordings.md describes its structure."""
    length = unit_factor(content, "length_unit", LENGTH_UNITS, "m")
    second = unit_factor(content, "time_unit", TIME_UNITS, None)
    time: list[float] = []
    seen: list[Sighting] = []
    for index, frame in enumerate(items(entry(content, "frames", "file"), "frames")):
        place = frame_place(index)
        time.append(number(entry(frame, "time", place), f"{place}, time") * second)
        for hand in items(entry(frame, "hands", place), f"{place}, hands"):
            stated = entry(hand, "handedness", place)
            where = f"{place}, {stated} hand"
            joints = _joints(entry(hand, "joints", where), where, length)
            name = optional(hand, "id", where)
            seen.append(Sighting(index, str(stated if name is None else name), _side(stated, place), *joints))
    return Clip(time, seen, frame_place)


def static_poses(content: Json) -> Clip:
    """Named poses of one hand without time: {pose: {WebXR joint: {"m": [16], "r": radius}}}."""
    names = list(mapping(content, "file"))
    seen: list[Sighting] = []
    for index, name in enumerate(names):
        place = f"pose {name!r}"
        node: dict[str, Json] = {}
        for joint, values in mapping(entry(content, name, "file"), place).items():
            matrix = entry(values, _STATIC_MATRIX, f"{place}, {joint}")
            node[joint] = {"matrix": matrix, "radius": optional(values, _STATIC_RADIUS, place)}
        seen.append(Sighting(index, "static", None, *_joints(node, place, 1.0)))
    return Clip(None, seen, name_place(names))


def joints_table(table: Table) -> Clip:
    """All hands of a CSV with a row for each joint of each hand in each frame (docs/formats/recordings.md)."""
    clock = table.time().tolist()
    values = table.numbers(["x", "y", "z", "qx", "qy", "qz", "qw", "radius"])
    valid = table.numbers(["valid"])[:, 0] if table.has("valid") else np.ones(len(values))
    strange = np.flatnonzero(~np.isin(valid, (0.0, 1.0)) & ~np.isnan(valid))
    if strange.size:
        row = int(strange[0])
        raise RecordingError(f"line {table.lines[row]}: valid must be 0 or 1, got {float(valid[row]):g}")
    values[~(valid > 0.0), :7] = math.nan
    sides, names = table.texts("hand"), table.texts("joint")
    ids = table.texts("id") if table.has("id") else sides
    time: list[float] = []
    lines: list[int] = []
    groups: dict[tuple[int, str], Sighting] = {}
    listed: dict[tuple[int, str], Flags] = {}
    for row, stamp in enumerate(clock):
        place = f"line {table.lines[row]}"
        if not time or stamp != time[-1]:
            time.append(stamp)
            lines.append(table.lines[row])
        key = (len(time) - 1, ids[row])
        if key not in groups:
            groups[key] = Sighting(key[0], ids[row], _side(sides[row], place), *unknown_joints())
            listed[key] = np.zeros(JOINT_COUNT, dtype=np.bool_)
        joint, one = _joint(names[row], place), groups[key]
        if _side(sides[row], place) != one.side:
            raise RecordingError(f"{place}: hand {ids[row]!r} is said to be left and right at this time")
        if listed[key][joint] and listed[key][Joint.WRIST :].all() and _is_again(one, joint, values[row]):
            continue  # a program that asks faster than the tracker answers wrote the frame again
        if listed[key][joint]:
            raise RecordingError(f"{place}: {names[row]} is listed twice at this time")
        listed[key][joint] = True
        one.position[joint], one.quaternion[joint], one.radius[joint] = (
            values[row, :3],
            values[row, 3:7],
            values[row, 7],
        )
    for key, joints in listed.items():
        _require_all_joints(joints, f"the frame at line {lines[key[0]]}")
    return Clip(time, list(groups.values()), line_place(lines))


def _is_again(one: Sighting, joint: Joint, row: Numbers) -> bool:
    """Whether a row of position, quaternion and radius repeats a joint."""
    known = np.concatenate([one.position[joint], one.quaternion[joint], one.radius[joint : joint + 1]])
    return np.array_equal(known, row, equal_nan=True)


def _joints(node: Json, place: str, length: float) -> tuple[Numbers, Numbers, Numbers]:
    position, quaternion, radius = unknown_joints()
    listed = np.zeros(JOINT_COUNT, dtype=np.bool_)
    for joint, values in _joint_list(node, place):
        where = f"{place}, {JOINT_NAMES[joint]}"
        if listed[joint]:
            raise RecordingError(f"{where}: is listed twice")
        listed[joint] = True
        if values is None or truth(optional(values, "valid", where), f"{where}, valid") is False:
            continue
        position[joint], quaternion[joint] = _joint_pose(values, where)
        position[joint] *= length
        stated = optional(values, "locationFlags", where)
        if stated is not None and flags(stated, f"{where}, locationFlags") & _BOTH_VALID != _BOTH_VALID:
            position[joint] = math.nan
        radius[joint] = number(optional(values, "radius", where), f"{where}, radius") * length
    _require_all_joints(listed, place)
    if isinstance(node, list):
        _require_palm_first(position, place)
    return position, quaternion, radius


def _require_palm_first(position: Numbers, place: str) -> None:
    """Refuse a list without names whose first joint is the wrist: the palm lies between wrist and middle knuckle."""
    palm, wrist, knuckle = position[[Joint.PALM, Joint.WRIST, Joint.MIDDLE_PROXIMAL]]
    if math.dist(palm, knuckle) > math.dist(wrist, knuckle):  # false where one is not known
        raise RecordingError(
            f"{place}, joints: the second is nearer to the middle knuckle than the first: the list seems to begin with"
            " the wrist, as Unity's XRHandJointID does, not with the palm, as OpenXR's; give each joint its name"
        )


def _joint_list(node: Json, place: str) -> list[tuple[Joint, Json]]:
    """Joints as an object by name, as a list of objects with `joint`, or as a list in OpenXR's or WebXR's order."""
    if isinstance(node, dict):
        return [(_joint(name, place), values) for name, values in mapping(node, place).items()]
    listed = items(node, f"{place}, joints")
    if all(isinstance(values, dict) and "joint" in values for values in listed):
        return [(_joint(str(entry(values, "joint", place)), place), values) for values in listed]
    if len(listed) not in (JOINT_COUNT, JOINT_COUNT - 1):
        raise RecordingError(f"{place}: must have {JOINT_COUNT} joints (OpenXR) or 25 (WebXR), got {len(listed)}")
    first = JOINT_COUNT - len(listed)
    return [(Joint(first + index), values) for index, values in enumerate(listed)]


def _joint_pose(values: Json, where: str) -> tuple[Numbers, Numbers]:
    matrix = optional(values, "matrix", where)
    if matrix is None:
        position = vector(entry(values, "position", where), 3, f"{where}, position")
        name = "orientation" if optional(values, "rotation", where) is None else "rotation"  # Unity's Pose has rotation
        return position, vector(optional(values, name, where), 4, f"{where}, {name}")
    columns = vector(matrix, 16, f"{where}, matrix").reshape(4, 4)
    turn = columns[:3, :3].T
    if np.isfinite(columns).all():
        if np.abs(columns[:, 3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
            raise RecordingError(f"{where}, matrix: is not by columns: elements 3, 7, 11 and 15 must be 0 0 0 1")
        if np.linalg.det(turn) < 0.0:
            raise RecordingError(f"{where}, matrix: mirrors (determinant -1)")
        if np.abs(turn.T @ turn - np.eye(3)).max() > 1e-2:
            raise RecordingError(f"{where}, matrix: is no rotation: its axes are not of length 1 and at right angles")
    return columns[3, :3], quaternion_of(turn)


def _require_all_joints(listed: Flags, place: str) -> None:
    missing = [joint for joint in Joint if not listed[joint] and joint != Joint.PALM]
    if missing:
        names = ", ".join(f"{JOINT_NAMES[joint]} ({webxr_name(joint)})" for joint in missing[:4])
        more = f" and {len(missing) - 4} more" if len(missing) > 4 else ""
        raise RecordingError(f"{place}: joint {names}{more} is missing; a joint that is not tracked is null")


def _joint(name: str, place: str) -> Joint:
    joint = joint_from(name)
    if joint is None:
        raise RecordingError(
            f"{place}: unknown joint {name!r}; known: {', '.join(JOINT_NAMES)}, and the names of WebXR and Unity"
        )
    return joint


def _side(name: Json, place: str) -> str:
    side = side_named(name)
    if side is None:
        raise RecordingError(f"{place}: handedness {name!r} is neither {' nor '.join(SIDES)}")
    return side
