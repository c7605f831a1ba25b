"""Content of a tracker's file, frame by frame, and the choice of one hand.

| asked for             | hands in the file                                        | what is taken                 |
|-----------------------|----------------------------------------------------------|-------------------------------|
| nothing               | one, or several of one side that share no frame          | it: lost and found again      |
| nothing               | others                                                   | refused, listing them         |
| `left` or `right`     | of that side, none sharing a frame with another          | them, as one hand             |
| an id                 | that one                                                 | it                            |
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, name_nothing
from ..hand_model.frames import complete_joints, side_from_axes, side_from_bends
from ..hand_model.joints import JOINT_COUNT, JOINT_NAMES
from ..known_names import likely_name
from ..rigid import Numbers, is_finite
from .conventions import mirrored, palm_quaternion, require_agreement
from .recording import HandRecording

SIDES = ("left", "right")


class Sighting(NamedTuple):
    """One hand in one frame; values that the tracker does not give are NaN."""

    frame: int
    hand_id: str
    side: str | None
    """`left` or `right`; None if the file does not state it."""
    position: Numbers
    """[m], shape [26, 3]."""
    quaternion: Numbers
    """xyzw, shape [26, 4]."""
    radius: Numbers
    """[m], shape [26]."""


class Clip(NamedTuple):
    """All hands of a file."""

    time: list[float] | None
    """Of each frame [s], as the file counts it."""
    sightings: list[Sighting]
    place: Callable[[int], str]
    """Names a frame as its file counts it."""


def unknown_joints() -> tuple[Numbers, Numbers, Numbers]:
    """Positions, quaternions and radii of a hand of which nothing is known yet."""
    return np.full((JOINT_COUNT, 3), np.nan), np.full((JOINT_COUNT, 4), np.nan), np.full(JOINT_COUNT, np.nan)


def side_named(name: object) -> str | None:
    """`left` or `right` by a file's word for it, enumerations of libraries included; None for any other word."""
    word = str(name).strip().lower().rpartition(".")[2]  # "HandType.Right" is how Python writes a member
    word = word.removeprefix("eleaphandtype_").removeprefix("xr_hand_").removesuffix("_ext")
    return word if word in SIDES else None


def frame_place(frame: int) -> str:
    """Name a frame of a list, counted from 0."""
    return f"frame {frame}"


def line_place(lines: list[int]) -> Callable[[int], str]:
    """Names a frame by the line where it starts in its file."""

    def place(frame: int) -> str:
        return f"line {lines[frame]}"

    return place


def name_place(names: list[str]) -> Callable[[int], str]:
    """Names a pose that has a name."""

    def place(frame: int) -> str:
        return f"pose {names[frame]!r}"

    return place


def recording_of(clip: Clip, hand: str | int | None, *, is_left_handed: bool = False) -> HandRecording:
    """One hand of a clip as a recording. Raises RecordingError; the table above describes the choice of the hand.

    is_left_handed: whether the file's frame is left-handed; the recording is then in the frame that has z reversed.
    """
    clip, repeated = _without_repeats(clip)
    seen = _choose(clip.sightings, None if hand is None else str(hand))
    time = _validate_time(clip)
    first, count = seen[0].frame, seen[-1].frame - seen[0].frame + 1
    position, quaternion = np.full((count, JOINT_COUNT, 3), np.nan), np.full((count, JOINT_COUNT, 4), np.nan)
    radius = np.full((count, JOINT_COUNT), np.nan)
    for one in seen:
        row = one.frame - first
        position[row], quaternion[row], radius[row] = one.position, one.quaternion, one.radius
    frames = np.array([one.frame - first for one in seen])
    for array in (position, quaternion, radius):
        array[~np.isfinite(array)] = np.nan
    _check_norms(quaternion, clip.place, first)
    if is_left_handed:
        position, quaternion = mirrored(position, quaternion)
    require_agreement(position, quaternion, seen[0].side, is_mirrored=is_left_handed)
    side = _side(seen, position, quaternion)
    whole = complete_joints(position, quaternion, radius, is_left=side == "left")
    pose = np.concatenate([whole.position, whole.quaternion], axis=2)
    known = is_finite(pose)
    pose[~known] = np.nan
    missing = known.any(axis=0) & ~known[frames]
    # The median radius of each joint: trackers guess a hand's size anew in each frame. NaN, never used, becomes 1 mm.
    measured = np.isfinite(whole.radius).any(axis=0)
    typical = np.full(JOINT_COUNT, 1e-3)
    typical[measured] = np.nanmedian(whole.radius[:, measured], axis=0)
    return HandRecording(
        None if time is None else time[first : first + count],
        pose,
        typical,
        known,
        side == "left",
        hand_id=", ".join(dict.fromkeys(one.hand_id for one in seen)),
        derived=tuple(JOINT_NAMES[joint] for joint in np.flatnonzero(whole.derived & known.any(axis=0))),
        counts={"absent_frames": count - len(frames), "missing_joints": int(missing.sum())}
        | ({"repeated_frames": repeated} if repeated else {}),
    )


def _without_repeats(clip: Clip) -> tuple[Clip, int]:
    """A clip without what a program that asks faster than the tracker answers wrote again, and how many frames or rows.

    The same hands at the same time are the same frame; other hands at the same time are a contradiction, and stay.
    """
    if clip.time is None:
        return clip, 0
    hands: list[list[Sighting]] = [[] for _ in clip.time]
    last: dict[tuple[int, str], Sighting] = {}
    repeated = 0
    for one in clip.sightings:
        before = last.get((one.frame, one.hand_id))
        if before is not None and _is_same(one, before):
            repeated += 1
            continue
        last[one.frame, one.hand_id] = one
        hands[one.frame].append(one)
    kept: list[int] = []
    for frame, time in enumerate(clip.time):
        latest = hands[kept[-1]] if kept and time == clip.time[kept[-1]] else None
        if latest is not None and len(hands[frame]) == len(latest) and all(map(_is_same, hands[frame], latest)):
            repeated += 1
        else:
            kept.append(frame)
    if not repeated:
        return clip, 0
    sightings = [one._replace(frame=index) for index, frame in enumerate(kept) for one in hands[frame]]

    def place(frame: int) -> str:
        return clip.place(kept[frame])

    return Clip([clip.time[frame] for frame in kept], sightings, place), repeated


def _is_same(one: Sighting, other: Sighting) -> bool:
    return (one.hand_id, one.side) == (other.hand_id, other.side) and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(one[3:], other[3:], strict=True)
    )


def _choose(sightings: list[Sighting], hand: str | None) -> list[Sighting]:
    if not sightings:
        raise RecordingError("no hand in any frame")
    seen = [s for s in sightings if hand is None or (s.side == hand if hand in SIDES else s.hand_id == hand)]
    if not seen:
        known = list(dict.fromkeys(name for s in sightings for name in (s.side, s.hand_id) if name))
        meant = "" if hand in SIDES else likely_name(hand, [*SIDES, *known])
        raise name_nothing(RecordingError(f"no hand {hand!r}{meant}; there is {_list_hands(sightings)}"))
    frames = [s.frame for s in seen]
    if len({s.side for s in seen}) > 1 or len(set(frames)) < len(frames):
        raise RecordingError(f"several hands: {_list_hands(seen)}; choose one by id" + ("" if hand else " or side"))
    return sorted(seen, key=lambda s: s.frame)


def _list_hands(sightings: list[Sighting]) -> str:
    count: dict[tuple[str, str], int] = {}
    for s in sightings:
        key = (s.side or "a", s.hand_id)
        count[key] = count.get(key, 0) + 1
    return ", ".join(f"{side} hand {name!r} ({number} frames)" for (side, name), number in count.items())


def _validate_time(clip: Clip) -> Numbers | None:
    if clip.time is None:
        return None
    time = np.array(clip.time, dtype=np.float64)
    bad = np.flatnonzero(~np.isfinite(time) | (np.diff(time, prepend=-np.inf) <= 0.0))
    if bad.size:
        frame = int(bad[0])
        before = f" {float(time[frame - 1])!r} s of the frame before" if frame else " a clock's start"
        same = ", and its hands are others" if frame and time[frame] == time[frame - 1] else ""
        raise RecordingError(f"{clip.place(frame)}: time {float(time[frame])!r} s is not after{before}{same}")
    return time


def _check_norms(quaternion: Numbers, place: Callable[[int], str], first: int) -> None:
    norm = np.linalg.norm(quaternion, axis=2)
    bad = np.argwhere(np.abs(norm - 1.0) > 1e-2)  # files round; HandRecording gets unit quaternions
    if bad.size:
        frame, joint = (int(index) for index in bad[0])
        message = f"{place(first + frame)}: {JOINT_NAMES[joint]} has quaternion norm {norm[frame, joint]:.6g}, not 1"
        raise RecordingError(message)
    quaternion /= norm[..., None]


def _side(seen: list[Sighting], position: Numbers, quaternion: Numbers) -> str:
    """The side that the file states, otherwise the side of the joints; refused if bent fingers contradict the file."""
    stated = seen[0].side
    palm = palm_quaternion(quaternion)
    turned = is_finite(palm).any()
    found = side_from_axes(position, palm) if turned else side_from_bends(position)
    if stated is None and found is None:
        raise RecordingError("the file does not say whether the hand is left or right, and its joints do not tell")
    if turned and stated != found and side_from_bends(position) == stated:
        raise RecordingError(
            f"said to be a {stated} hand, as which its fingers bend, but the palm's X axis runs the other way;"
            " likely cause: the joints' axes are turned by 180 degrees about Z: multiply each orientation by"
            " (0, 0, 1, 0) on the right"
        )
    if stated is not None and found not in (None, stated):
        raise RecordingError(
            f"said to be a {stated} hand, but its joints are those of a {found} one"
            + ("" if turned else ": its fingers bend to the back") + "; wrong handedness or mirrored positions, as in"
            " Unity's left-handed frame (alignment=unity)"
        )  # fmt: skip
    return stated or found or "right"
