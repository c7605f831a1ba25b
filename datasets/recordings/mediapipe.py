"""MediaPipe's 21 world landmarks with the wrist's place in space, as JSON or CSV.

World landmarks [m] have their origin in the middle of the hand: they say what a hand looks like, not where it is. So
the wrist's position, from a depth camera or another tracker, is needed. Camera's frame: x right, y down, z away.
A mirrored image (a selfie view) gives the landmarks of the other hand; `image_mirrored` turns them back.
"""

import math

import numpy as np

from ..errors import RecordingError
from ..hand_model.joints import MEDIAPIPE_JOINTS, MEDIAPIPE_NAMES
from ..rigid import Numbers
from .clip import SIDES, Clip, Sighting, frame_place, line_place, side_named, unknown_joints
from .json_fields import (
    LENGTH_UNITS,
    TIME_UNITS,
    Json,
    Table,
    entry,
    items,
    number,
    optional,
    truth,
    unit_factor,
    vector,
)

_COUNT = len(MEDIAPIPE_NAMES)
_NUMBERS = [str(index) for index in range(_COUNT)]
_NO_PLACE = (
    "world landmarks do not say where the hand is (their origin is its own middle): the wrist's position [m], from a"
    " depth camera or another tracker, is needed as `wrist`"
)


def landmarks_json(content: Json, image_mirrored: bool | None) -> Clip:
    """All hands of a recording (docs/formats/recordings.md). image_mirrored: None keeps the file's value."""
    length = unit_factor(content, "length_unit", LENGTH_UNITS, "m")
    second = unit_factor(content, "time_unit", TIME_UNITS, None)
    stated = truth(optional(content, "image_mirrored", "file"), "image_mirrored")
    mirrored = bool(stated) if image_mirrored is None else image_mirrored
    time: list[float] = []
    seen: list[Sighting] = []
    for index, frame in enumerate(items(entry(content, "frames", "file"), "frames")):
        place = frame_place(index)
        time.append(number(entry(frame, "time", place), f"{place}, time") * second)
        for hand in items(entry(frame, "hands", place), f"{place}, hands"):
            side = _side(entry(hand, "handedness", place), place)
            landmark = _landmarks(entry(hand, "world_landmarks", place), f"{place}, {side} hand") * length
            wrist = optional(hand, "wrist", place)
            if wrist is None and "wrist" not in hand:
                raise RecordingError(f"{place}: {_NO_PLACE}")
            at = vector(wrist, 3, f"{place}, wrist") * length
            name = optional(hand, "id", place)
            seen.append(_sighting(index, str(side if name is None else name), side, landmark, at, mirrored=mirrored))
    return Clip(time, seen, frame_place)


def landmarks_table(table: Table, image_mirrored: bool | None) -> Clip:
    """All hands of a CSV with a row for each landmark of each hand in each frame (docs/formats/recordings.md)."""
    clock = table.time().tolist()
    wrist_columns = [f"wrist_{axis}" for axis in "xyz"]
    if not table.has(wrist_columns[0]):
        raise RecordingError(_NO_PLACE)
    values, wrist = table.numbers(["x", "y", "z"]), table.numbers(wrist_columns)
    sides, names = table.texts("hand"), table.texts("landmark")
    ids = table.texts("id") if table.has("id") else sides
    time: list[float] = []
    lines: list[int] = []
    groups: dict[tuple[int, str], tuple[str, dict[int, Numbers], Numbers]] = {}
    for row, stamp in enumerate(clock):
        place = f"line {table.lines[row]}"
        if not time or stamp != time[-1]:
            time.append(stamp)
            lines.append(table.lines[row])
        key = (len(time) - 1, ids[row])
        side = _side(sides[row], place)
        group = groups.setdefault(key, (side, {}, wrist[row]))
        if side != group[0]:
            raise RecordingError(f"{place}: hand {ids[row]!r} is said to be left and right at this time")
        if not np.array_equal(wrist[row], group[2], equal_nan=True):
            before, now = group[2].tolist(), wrist[row].tolist()
            raise RecordingError(f"{place}: the wrist is at {now}, and at {before} in a row before of this time")
        index = _landmark(names[row], place)
        if len(group[1]) == _COUNT and np.array_equal(group[1][index], values[row], equal_nan=True):
            continue  # a program that asks faster than the tracker answers wrote the frame again
        if index in group[1]:
            raise RecordingError(f"{place}: landmark {names[row]} is listed twice at this time")
        group[1][index] = values[row]
    seen: list[Sighting] = []
    for (frame, name), (side, landmarks, at) in groups.items():
        _check_count(list(landmarks), f"the frame at line {lines[frame]}")
        rows = np.stack([landmarks[index] for index in range(_COUNT)])
        seen.append(_sighting(frame, name, side, rows, at, mirrored=bool(image_mirrored)))
    return Clip(time, seen, line_place(lines))


def _sighting(frame: int, name: str, side: str, landmark: Numbers, wrist: Numbers, *, mirrored: bool) -> Sighting:
    joints = unknown_joints()
    shape = landmark - landmark[0]
    joints[0][list(MEDIAPIPE_JOINTS)] = wrist + shape * ([-1.0, 1.0, 1.0] if mirrored else [1.0, 1.0, 1.0])
    return Sighting(frame, name, side, *joints)


def _landmarks(node: Json, place: str) -> Numbers:
    if node is None:
        return np.full((_COUNT, 3), math.nan)
    listed = items(node, f"{place}, world_landmarks")
    _check_count(list(range(len(listed))), place)
    return np.stack([vector(row, 3, f"{place}, {MEDIAPIPE_NAMES[k]}") for k, row in enumerate(listed)])


def _check_count(found: list[int], place: str) -> None:
    missing = [name for index, name in enumerate(MEDIAPIPE_NAMES) if index not in found]
    if missing:
        raise RecordingError(
            f"{place}: {_COUNT - len(missing)} landmarks, not {_COUNT}; missing: {', '.join(missing[:4])}"
        )
    if len(found) > _COUNT:
        raise RecordingError(f"{place}: {len(found)} landmarks, not {_COUNT}")


def _landmark(name: str, place: str) -> int:
    if name in MEDIAPIPE_NAMES:
        return MEDIAPIPE_NAMES.index(name)
    if name in _NUMBERS:
        return _NUMBERS.index(name)
    raise RecordingError(f"{place}: unknown landmark {name!r}; known: 0 to {_COUNT - 1}, {', '.join(MEDIAPIPE_NAMES)}")


def _side(name: Json, place: str) -> str:
    side = side_named(name)
    if side is None:
        raise RecordingError(f"{place}: handedness {name!r} is neither {' nor '.join(SIDES)}")
    return side
