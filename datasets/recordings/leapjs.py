"""Recordings of leapjs (protocol 6, as leapjs-playback and UltraleapTrackingWebSocket give frames), packed or not.

A frame has `hands`, and `pointables`: fingers, each with the `handId` of its hand and a `type`, 0 thumb to 4 little
finger. Lengths are in mm, times in us, in Leap's frame. leapjs-playback packs frames: the first row then names the
values of the others.
"""

from collections.abc import Iterator
from typing import cast

import numpy as np

from ..errors import RecordingError
from ..hand_model.joints import DIGITS, Joint
from ..rigid import Numbers, quaternion_of
from .clip import Clip, Sighting, frame_place, side_named, unknown_joints
from .json_fields import LENGTH_UNITS, TIME_UNITS, Json, entry, items, mapping, number, optional, vector
from .leap import TIP_RADIUS_SHARE, set_palm

_LENGTH, _SECOND = LENGTH_UNITS["mm"], TIME_UNITS["us"]
_ENDS = ("carpPosition", "mcpPosition", "pipPosition", "dipPosition", "tipPosition")
_WIDTH_LEAST = 8.0  # [mm]; a service wrote a third of the width, which no finger has
_DEPTH_MOST = 4  # of structures in each other


def is_leapjs(content: Json) -> bool:
    """Whether a file's JSON is of leapjs: frames that are packed, or whose hands have palmPosition."""
    for frame in _frames(content)[:1000]:
        if isinstance(frame, list):
            return "timestamp" in frame
        hands: Json = cast("dict[str, Json]", frame).get("hands") if isinstance(frame, dict) else None
        for hand in cast("list[Json]", hands) if isinstance(hands, list) else []:
            return isinstance(hand, dict) and "palmPosition" in hand
    return False


def leapjs_frames(content: Json, *, is_left_handed: bool = False) -> Clip:
    """All hands of a recording of leapjs; is_left_handed: whether its frame is, as Unity's."""
    time: list[float] = []
    seen: list[Sighting] = []
    for frame in _unpacked(_frames(content)):
        found = frame_hands(frame, len(time), is_left_handed=is_left_handed)
        if found is not None:
            time.append(found[0])
            seen += found[1]
    return Clip(time, seen, frame_place)


def frame_hands(frame: Json, index: int, *, is_left_handed: bool = False) -> tuple[float, list[Sighting]] | None:
    """Time [s] and hands of one frame; None for what a service says about itself and its devices.

    index: what the frame is called where it is refused.
    """
    place = frame_place(index)
    if "hands" not in mapping(frame, place) and ("event" in frame or "version" in frame):
        return None
    time = number(entry(frame, "timestamp", place), f"{place}, timestamp") * _SECOND
    fingers: dict[str, list[Json]] = {}
    for finger in items(optional(frame, "pointables", place) or [], f"{place}, pointables"):
        if not optional(finger, "tool", place):
            fingers.setdefault(str(optional(finger, "handId", place)), []).append(finger)
    hands = items(entry(frame, "hands", place), f"{place}, hands")
    return time, [_sighting(hand, fingers, index, is_left_handed=is_left_handed) for hand in hands]


def _frames(content: Json) -> list[Json]:
    frames: Json = cast("dict[str, Json]", content).get("frames") if isinstance(content, dict) else content
    return cast("list[Json]", frames) if isinstance(frames, list) else []


def _unpacked(frames: list[Json]) -> Iterator[Json]:
    if not frames or not isinstance(frames[0], list):
        yield from frames
        return
    for index, row in enumerate(frames[1:]):
        yield _named(frames[0], row, frame_place(index), 0)


def _named(structure: Json, row: Json, place: str, depth: int) -> Json:
    """Values of a row by the names of a structure: texts, objects of one name and what it holds, a list for many."""
    names, values = items(structure, "packed names"), items(row, place)
    if depth > _DEPTH_MOST:
        raise RecordingError(f"packed names: lists lie more than {_DEPTH_MOST} deep in each other")
    if len(names) == 1 and isinstance(names[0], list):
        return [_named(names[0], value, place, depth + 1) for value in values]
    if len(names) != len(values):
        raise RecordingError(f"{place}: {len(values)} packed values, {len(names)} names")
    found: dict[str, Json] = {}
    for name, value in zip(names, values, strict=True):
        if isinstance(name, str):
            found[name] = value
            continue
        for own, below in mapping(name, "packed names").items():
            found[own] = None if value is None else _named(below, value, place, depth + 1)
    return found


def _sighting(hand: Json, fingers: dict[str, list[Json]], frame: int, *, is_left_handed: bool) -> Sighting:
    name = entry(hand, "id", frame_place(frame))
    place = f"{frame_place(frame)}, hand {name}"
    joints = unknown_joints()
    own = fingers.get(str(name), [])
    for order, finger in enumerate(own):
        digit = optional(finger, "type", place)
        digit = order if digit is None else digit  # version 0.2.0 left out the type; fingers stand in order
        if digit not in range(5) or isinstance(digit, bool):
            raise RecordingError(f"{place}: finger {digit!r:.40} is none of 0 to 4")
        _set_finger(joints, int(digit), finger, f"{place}, finger {digit}")
    wrist = optional(hand, "wrist", place)
    if wrist is not None and own:
        joints[0][Joint.WRIST] = vector(wrist, 3, f"{place}, wrist") * _LENGTH
    position, normal, direction = (
        vector(entry(hand, key, place), 3, f"{place}, {key}") for key in ("palmPosition", "palmNormal", "direction")
    )
    width = number(optional(hand, "palmWidth", place), f"{place}, palmWidth") * _LENGTH
    given = (joints, position, normal, direction, width, _LENGTH)
    set_palm(*given, boned=bool(own), is_left_handed=is_left_handed)
    stated = optional(hand, "type", place)
    side = None if stated is None else side_named(stated)
    if stated is not None and side is None:
        raise RecordingError(f"{place}: type {stated!r} is neither left nor right")
    return Sighting(frame, str(name), side, *joints)


def _set_finger(joints: tuple[Numbers, Numbers, Numbers], digit: int, finger: Json, place: str) -> None:
    position, quaternion, radius = joints
    chain = DIGITS[digit]
    width = number(optional(finger, "width", place), f"{place}, width")
    half = width * _LENGTH / 2.0 if width >= _WIDTH_LEAST else float("nan")
    for joint, key in zip(chain, _ENDS[-len(chain) :], strict=True):
        position[joint] = vector(optional(finger, key, place), 3, f"{place}, {key}") * _LENGTH
        if joint != chain[0] or digit == 0:
            radius[joint] = half * (TIP_RADIUS_SHARE if joint == chain[-1] else 1.0)
    bases = optional(finger, "bases", place)
    if bases is None:
        return
    axes = [_rotation(basis, f"{place}, bases") for basis in items(bases, f"{place}, bases")]
    if len(axes) != 4:
        raise RecordingError(f"{place}, bases: must be 4, one of each bone, got {len(axes)}")
    for joint, turn in zip(chain, [*axes[5 - len(chain) :], axes[-1]], strict=True):
        quaternion[joint] = turn


def _rotation(basis: Json, place: str) -> Numbers:
    """The orientation of a bone's axes X, Y, Z; of a left hand, whose X is reversed, the right-handed ones."""
    rows = [vector(axis, 3, place) for axis in items(basis, place)]
    if len(rows) != 3:
        raise RecordingError(f"{place}: a basis has 3 axes, got {len(rows)}")
    matrix = np.stack(rows, axis=1)
    if not np.isfinite(matrix).all():
        return np.full(4, np.nan)
    if np.abs(matrix.T @ matrix - np.eye(3)).max() > 1e-2:
        raise RecordingError(f"{place}: its axes are not of length 1 and at right angles")
    return quaternion_of(matrix * [np.sign(np.linalg.det(matrix)), 1.0, 1.0])
