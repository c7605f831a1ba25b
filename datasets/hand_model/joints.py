"""The 26 joints of OpenXR's hand (XR_EXT_hand_tracking) by name and number, and their mapping from other trackers.

Each joint has a frame: -Z along its bone towards the finger tip, +Y out of the back of the finger or hand, +X by the
right-hand rule: to the little finger on a right hand, to the thumb on a left one. A joint's radius is its distance to
the skin. PALM is the middle of the middle finger's metacarpal bone; the palm's skin is on its -Y side.

| source                   | joints it gives                     | missing joints and their substitute                 |
|--------------------------|-------------------------------------|-----------------------------------------------------|
| OpenXR, 26               | all                                 | nothing                                             |
| WebXR, 25                | all but PALM                        | PALM: between MIDDLE_METACARPAL and MIDDLE_PROXIMAL |
| Leap, 5 digits x 4 bones | starts of bones, end of the last    | PALM as above, WRIST from the arm bone              |
| leapjs, 5 digits x 4     | PROXIMAL..TIP (thumb METACARPAL..)  | WRIST and fingers' METACARPAL, by mean proportions  |
| MediaPipe, 21 landmarks  | WRIST, PROXIMAL..TIP, thumb as Leap | fingers' METACARPAL as leapjs, all orientations     |

Leap's thumb has a metacarpal bone of length 0; its proximal bone is the anatomical (and OpenXR's) metacarpal.
"""

from enum import IntEnum
from itertools import pairwise


class Joint(IntEnum):
    """OpenXR's hand joints with OpenXR's numbers."""

    PALM = 0
    WRIST = 1
    THUMB_METACARPAL = 2
    THUMB_PROXIMAL = 3
    THUMB_DISTAL = 4
    THUMB_TIP = 5
    INDEX_METACARPAL = 6
    INDEX_PROXIMAL = 7
    INDEX_INTERMEDIATE = 8
    INDEX_DISTAL = 9
    INDEX_TIP = 10
    MIDDLE_METACARPAL = 11
    MIDDLE_PROXIMAL = 12
    MIDDLE_INTERMEDIATE = 13
    MIDDLE_DISTAL = 14
    MIDDLE_TIP = 15
    RING_METACARPAL = 16
    RING_PROXIMAL = 17
    RING_INTERMEDIATE = 18
    RING_DISTAL = 19
    RING_TIP = 20
    LITTLE_METACARPAL = 21
    LITTLE_PROXIMAL = 22
    LITTLE_INTERMEDIATE = 23
    LITTLE_DISTAL = 24
    LITTLE_TIP = 25


JOINT_COUNT = len(Joint)

JOINT_NAMES: tuple[str, ...] = tuple(joint.name.lower() for joint in Joint)
"""OpenXR's names without prefix and suffix, in lower case: `palm`, `wrist`, `thumb_metacarpal` ... `little_tip`."""

_UNSEPARATED_NAMES = tuple(name.replace("_", "") for name in JOINT_NAMES)

DIGITS: tuple[tuple[Joint, ...], ...] = tuple(
    tuple(joint for joint in Joint if joint.name.startswith(name))
    for name in ("THUMB", "INDEX", "MIDDLE", "RING", "LITTLE")
)
"""Joints of thumb, index, middle, ring and little finger, each from metacarpal to tip."""

FINGERS = DIGITS[1:]

TIPS: tuple[Joint, ...] = tuple(digit[-1] for digit in DIGITS)

BONES: tuple[tuple[Joint, Joint], ...] = tuple((start, end) for digit in DIGITS for start, end in pairwise(digit))
"""Bones as (start joint, end joint); a bone moves with the frame of its start joint."""


def joint_parent(joint: int) -> int:
    """The parent joint in the kinematic tree; -1 for the wrist, the root."""
    if joint == Joint.WRIST:
        return -1
    before = {end: start for start, end in BONES}
    return int(before.get(Joint(joint), Joint.WRIST))


_WEBXR_FINGER = {
    "THUMB": "thumb",
    "INDEX": "index-finger",
    "MIDDLE": "middle-finger",
    "RING": "ring-finger",
    "LITTLE": "pinky-finger",
}
_WEBXR_BONE = {
    "METACARPAL": "metacarpal",
    "PROXIMAL": "phalanx-proximal",
    "INTERMEDIATE": "phalanx-intermediate",
    "DISTAL": "phalanx-distal",
    "TIP": "tip",
}


def webxr_name(joint: Joint) -> str:
    """WebXR's name of a joint (WebXR Hand Input); `palm` for PALM, which WebXR lacks."""
    finger, _, bone = joint.name.partition("_")
    return f"{_WEBXR_FINGER[finger]}-{_WEBXR_BONE[bone]}" if bone else finger.lower()


WEBXR_NAMES: tuple[str, ...] = tuple(webxr_name(joint) for joint in Joint)


def joint_from(name: str) -> Joint | None:
    """The joint of a name from OpenXR, Unity, WebXR or JOINT_NAMES, in upper or lower case; None for any other name.

    `XR_HAND_JOINT_INDEX_TIP_EXT`, `index_tip`, `IndexTip` (Unity's XRHandJointID) and `index-finger-tip` are the same.
    """
    plain = name.strip().lower()
    if plain in WEBXR_NAMES:
        return Joint(WEBXR_NAMES.index(plain))
    plain = plain.removeprefix("xr_hand_joint_").removesuffix("_ext").replace("_", "")
    return Joint(_UNSEPARATED_NAMES.index(plain)) if plain in _UNSEPARATED_NAMES else None


_MEDIAPIPE_FINGERS = ("INDEX_FINGER", "MIDDLE_FINGER", "RING_FINGER", "PINKY")

MEDIAPIPE_NAMES: tuple[str, ...] = (
    "WRIST",
    *(f"THUMB_{part}" for part in ("CMC", "MCP", "IP", "TIP")),
    *(f"{finger}_{part}" for finger in _MEDIAPIPE_FINGERS for part in ("MCP", "PIP", "DIP", "TIP")),
)
"""MediaPipe's names of its 21 landmarks, in its order."""

MEDIAPIPE_JOINTS: tuple[Joint, ...] = (
    Joint.WRIST,
    *DIGITS[0],
    *(joint for finger in FINGERS for joint in finger[1:]),
)
"""The joint of each of MediaPipe's 21 landmarks, in MediaPipe's order."""

LEAP_DIGITS = ("thumb", "index", "middle", "ring", "pinky")
LEAP_BONES = ("metacarpal", "proximal", "intermediate", "distal")


def leap_starts(digit: int) -> tuple[tuple[int, Joint], ...]:
    """(bone, joint) for each bone of a Leap digit (0 thumb .. 4 pinky) that starts at a joint; the last bone ends at
    the tip."""
    joints = DIGITS[digit][:-1]
    return tuple((len(LEAP_BONES) - len(joints) + place, joint) for place, joint in enumerate(joints))


ENDS_JOINTS: tuple[tuple[Joint, ...], ...] = tuple(digit[-4:] for digit in DIGITS)
"""Joints of the four positions that leapjs gives of each digit (mcp, pip, dip, tip), thumb to little finger."""
