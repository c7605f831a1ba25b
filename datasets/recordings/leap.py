"""Leap (Ultraleap) recordings: LeapC's fields as JSON or CSV, and leapjs recordings decoded to NumPy (.npz).

Leap's frame: x to the right along the device, y up out of it, z towards the user; lengths in mm, times in us. A bone
reaches from `prev_joint` (nearer to the wrist) to `next_joint`. The palm's axes are +Y = -normal, +Z = -direction.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..array_file import ONLY, read_arrays
from ..errors import RecordingError
from ..hand_model.frames import PALM_RADIUS_SHARE, axes_from
from ..hand_model.joints import DIGITS, ENDS_JOINTS, LEAP_BONES, LEAP_DIGITS, Joint, leap_starts
from ..rigid import Numbers, quaternion_of, rotate
from .clip import SIDES, Clip, Sighting, frame_place, line_place, side_named, unknown_joints
from .json_fields import LENGTH_UNITS, TIME_UNITS, Json, Table, entry, items, number, optional, unit_factor, vector

_PALM_VECTORS = ("position", "normal", "direction")

TIP_RADIUS_SHARE = 0.85
"""Radius of a tip, in half widths of the distal bone."""
PALM_BACK = 0.3
"""A palm without bones: OpenXR's PALM lies behind Leap's palm position by this share of the palm's width."""

_SIDE_OF = dict(zip("01", SIDES, strict=True))  # eLeapHandType


class Bone(NamedTuple):
    """A bone of a digit; NaN is unknown."""

    start: Numbers
    end: Numbers
    width: float
    rotation: Numbers


def leap_json(content: Json, *, is_left_handed: bool = False) -> Clip:
    """All hands of a LeapC recording as JSON; docs/formats/recordings.md describes its structure.

    is_left_handed: whether the frame is, as Unity's; the same for the other readers.
    """
    head: Json = {} if isinstance(content, list) else content
    frames = items(content if isinstance(content, list) else entry(content, "frames", "file"), "frames")
    length = unit_factor(head, "length_unit", LENGTH_UNITS, "mm")
    second = unit_factor(head, "time_unit", TIME_UNITS, "us")
    time: list[float] = []
    seen: list[Sighting] = []
    for index, frame in enumerate(frames):
        place = frame_place(index)
        stamp = optional(frame, "timestamp", place)
        stamp = entry(entry(frame, "info", place), "timestamp", place) if stamp is None else stamp
        time.append(number(stamp, f"{place}, timestamp") * second)
        for hand in items(entry(frame, "hands", place), f"{place}, hands"):
            seen.append(_hand(hand, index, length, is_left_handed=is_left_handed))
    return Clip(time, seen, frame_place)


def leap_table(table: Table, *, is_left_handed: bool = False) -> Clip:
    """All hands of a Leap CSV: a row for each hand in each frame; docs/formats/recordings.md describes the columns."""
    clock = table.numbers(["timestamp"])[:, 0] * TIME_UNITS["us"]
    ids, sides = table.texts("hand_id"), table.texts("type")
    palm = {name: table.numbers(_xyz(f"palm_{name}")) for name in _PALM_VECTORS}
    width = table.numbers(["palm_width"])[:, 0] * 1e-3
    boned = table.has("index_proximal_prev_x")
    arm = table.numbers(_xyz("arm_next")) if table.has("arm_next_x") else np.full((len(clock), 3), np.nan)
    bones = {(d, b): _bone_columns(table, d, b) for d in range(5) for b in range(4)} if boned else {}
    time: list[float] = []
    lines: list[int] = []
    seen: list[Sighting] = []
    for row, stamp in enumerate(clock.tolist()):
        if not time or stamp != time[-1]:
            time.append(stamp)
            lines.append(table.lines[row])
        joints = unknown_joints()
        if boned:
            for digit in range(5):
                chain = [
                    Bone(v[row, :3], v[row, 3:6], v[row, 6], np.full(4, np.nan))
                    for v in (bones[digit, bone] for bone in range(4))
                ]
                _set_digit(joints, digit, chain)
            joints[0][Joint.WRIST] = arm[row] * 1e-3
        side = _side(sides[row], f"line {table.lines[row]}")
        position, normal, direction = (palm[name][row] for name in _PALM_VECTORS)
        set_palm(joints, position, normal, direction, width[row], 1e-3, boned=boned, is_left_handed=is_left_handed)
        seen.append(Sighting(len(time) - 1, ids[row], side, *joints))
    return Clip(time, seen, line_place(lines))


def leap_arrays(path: Path, *, is_left_handed: bool = False) -> Clip:
    """Hands of a decoded leapjs recording (.npz): one hand a frame, lengths in `length_unit` (m by default)."""
    found = _read_archive(path)
    count = len(found["t"]) if "t" in found and found["t"].ndim == 1 else 0
    shapes = {"t": (), "hand_id": (), "is_left": (), "joints": (5, 4, 3), "finger_width": (5,)}
    shapes |= {f"palm_{name}": (3,) for name in _PALM_VECTORS}
    for name, shape in shapes.items():
        if name not in found:
            raise RecordingError(f"array {name!r} is missing; there is {', '.join(sorted(found))}")
        if found[name].shape != (count, *shape) or not count:
            raise RecordingError(
                f"array {name!r} must have shape {[max(count, 1), *shape]}, got {list(found[name].shape)}"
            )
    length = unit_factor({"length_unit": str(found.get("length_unit", "m"))}, "length_unit", LENGTH_UNITS, None)
    numbers = [name for name in shapes if name not in ("hand_id", "is_left")]
    for name in numbers:
        if found[name].dtype.kind not in "iuf":
            raise RecordingError(f"array {name!r} must be numbers, got {found[name].dtype}")
    is_left = found["is_left"]
    if is_left.dtype.kind not in "biuf" or not np.isin(is_left, (0, 1)).all():
        raise RecordingError(f"array 'is_left' must be true or false, got {is_left.dtype} like {is_left[0]}")
    values = {name: found[name].astype(np.float64) for name in numbers}
    seen: list[Sighting] = []
    for index in range(count):
        joints = unknown_joints()
        for digit, names in enumerate(ENDS_JOINTS):
            half = values["finger_width"][index, digit] * length / 2.0
            for place, joint in enumerate(names):
                joints[0][joint] = values["joints"][index, digit, place] * length
                joints[2][joint] = half * (TIP_RADIUS_SHARE if place == 3 else 1.0)
        position, normal, direction = (values[f"palm_{name}"][index] for name in _PALM_VECTORS)
        set_palm(joints, position, normal, direction, math.nan, length, boned=True, is_left_handed=is_left_handed)
        side = SIDES[0] if is_left[index] else SIDES[1]
        seen.append(Sighting(index, str(found["hand_id"][index]), side, *joints))
    return Clip(values["t"].tolist(), seen, frame_place)


def _read_archive(path: Path) -> dict[str, NDArray[Any]]:
    """Arrays of a .npz by name; OSError where there is no such file."""
    try:
        found = read_arrays(path)
    except ValueError as error:
        raise RecordingError(f"not a NumPy archive of arrays: {error}") from None
    if ONLY in found:
        raise RecordingError("not a NumPy archive of arrays (.npz)")
    return found


def _hand(hand: Json, frame: int, length: float, *, is_left_handed: bool) -> Sighting:
    place = f"{frame_place(frame)}, hand {optional(hand, 'id', frame_place(frame))}"
    palm = entry(hand, "palm", place)
    joints = unknown_joints()
    digits = [_digit(hand, digit, name, place) for digit, name in enumerate(LEAP_DIGITS)]
    boned = any(node is not None for node in digits)
    for digit, (name, node) in enumerate(zip(LEAP_DIGITS, digits, strict=True)):
        if node is not None:
            _set_digit(joints, digit, [_bone(node, k, f"{place}, {name}") for k in range(4)], length)
        elif boned:
            raise RecordingError(f"{place}: digit {name!r} is missing")
    arm = optional(hand, "arm", place)
    if arm is not None and boned:
        joints[0][Joint.WRIST] = vector(entry(arm, "next_joint", place), 3, f"{place}, arm") * length
    position = vector(entry(palm, "position", place), 3, f"{place}, palm position")
    width = number(optional(palm, "width", place), f"{place}, palm width") * length
    normal, direction = _palm_directions(palm, place, is_left_handed=is_left_handed)
    set_palm(joints, position, normal, direction, width, length, boned=boned, is_left_handed=is_left_handed)
    return Sighting(frame, str(entry(hand, "id", place)), _side(str(entry(hand, "type", place)), place), *joints)


def _palm_directions(palm: Json, place: str, *, is_left_handed: bool) -> tuple[Numbers, Numbers]:
    if optional(palm, "normal", place) is None and optional(palm, "orientation", place) is not None:
        turn = vector(entry(palm, "orientation", place), 4, f"{place}, palm orientation")
        return rotate(turn, np.array([0.0, -1.0, 0.0])), rotate(turn, np.array([0.0, 0.0, _tips_sign(is_left_handed)]))
    normal = vector(entry(palm, "normal", place), 3, f"{place}, palm normal")
    return normal, vector(entry(palm, "direction", place), 3, f"{place}, palm direction")


def _digit(hand: Json, digit: int, name: str, place: str) -> Json:
    digits = optional(hand, "digits", place)
    if digits is None:
        return optional(hand, name, place)
    listed = items(digits, f"{place}, digits")
    if len(listed) != 5:
        raise RecordingError(f"{place}: must have 5 digits, got {len(listed)}")
    return listed[digit]


def _bone(digit: Json, index: int, place: str) -> Bone:
    bones = optional(digit, "bones", place)
    name = LEAP_BONES[index]
    if bones is None:
        node = entry(digit, name, place)
    else:
        listed = items(bones, f"{place}, bones")
        if len(listed) != 4:
            raise RecordingError(f"{place}: must have 4 bones, got {len(listed)}")
        node = listed[index]
    where = f"{place} {name}"
    start, end = (vector(entry(node, key, where), 3, f"{where} {key}") for key in ("prev_joint", "next_joint"))
    width = number(optional(node, "width", where), f"{where} width")
    return Bone(start, end, width, vector(optional(node, "rotation", where), 4, f"{where} rotation"))


def _set_digit(joints: tuple[Numbers, Numbers, Numbers], digit: int, bones: list[Bone], length: float = 1e-3) -> None:
    """Joints of a digit from its bones; a metacarpal's radius, which its width is not, is left out."""
    position, quaternion, radius = joints
    for index, joint in leap_starts(digit):
        bone = bones[index]
        position[joint], quaternion[joint] = bone.start * length, bone.rotation
        if index > 0:
            radius[joint] = bone.width * length / 2.0
    tip, last = DIGITS[digit][-1], bones[-1]
    position[tip], quaternion[tip] = last.end * length, last.rotation
    radius[tip] = TIP_RADIUS_SHARE * last.width * length / 2.0


def set_palm(
    joints: tuple[Numbers, Numbers, Numbers],
    position: Numbers,
    normal: Numbers,
    direction: Numbers,
    width: float,
    length: float,
    *,
    boned: bool,
    is_left_handed: bool,
) -> None:
    """PALM and WRIST: with bones the palm's place follows from these, without from Leap's palm position."""
    back = _tips_sign(is_left_handed) * direction
    axes = axes_from(back, np.cross(back, normal))
    joints[1][Joint.PALM] = joints[1][Joint.WRIST] = quaternion_of(axes)
    if np.isfinite(width):
        joints[2][Joint.PALM] = PALM_RADIUS_SHARE * width
    if not boned:
        joints[0][Joint.PALM] = position * length - direction * PALM_BACK * (0.085 if np.isnan(width) else width)
        joints[2][Joint.PALM] = PALM_RADIUS_SHARE * (0.085 if np.isnan(width) else width)


def _tips_sign(is_left_handed: bool) -> float:
    """Which end of the palm's Z axis points to the tips; a left-handed frame has its Z axis reversed, as Unity."""
    return 1.0 if is_left_handed else -1.0


def _side(name: str, place: str) -> str:
    side = _SIDE_OF.get(name.strip()) or side_named(name)
    if side is None:
        raise RecordingError(f"{place}: type {name!r} is neither left nor right")
    return side


def _xyz(name: str) -> list[str]:
    return [f"{name}_{axis}" for axis in "xyz"]


def _bone_columns(table: Table, digit: int, bone: int) -> Numbers:
    name = f"{LEAP_DIGITS[digit]}_{LEAP_BONES[bone]}"
    return table.numbers([*_xyz(f"{name}_prev"), *_xyz(f"{name}_next"), f"{name}_width"])
