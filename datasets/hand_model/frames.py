"""Derivation of orientations, wrist, metacarpals, palm and radii that a tracker does not give.

| missing                      | derived as                                                                            |
|------------------------------|---------------------------------------------------------------------------------------|
| orientation of the palm      | MIDDLE_METACARPAL's; else Z from MIDDLE_PROXIMAL to the wrist, X along the knuckles   |
| wrist                        | behind MIDDLE_PROXIMAL by 1.45 times the width of the knuckles                        |
| metacarpals of fingers       | 0.36 of the way from wrist to knuckle, spread to 0.75 of the knuckles' width          |
| palm                         | middle between MIDDLE_METACARPAL and MIDDLE_PROXIMAL                                  |
| orientation of another joint | Z back along the bone, X as near to the palm's as can be, the thumb's turned aside    |
| radius                       | a share of the hand's breadth, by joint                                               |

Derived is what a recording never has; what is missing in some frames only is a gap. The proportions are those of
recorded hands (Ultraleap's and WebXR's), rounded; they carry an error of some millimetres.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rigid import Numbers, is_finite, matrix_of, quaternion_of, unit
from .joints import BONES, DIGITS, FINGERS, TIPS, Joint

WRIST_SHARE = 1.45
"""From MIDDLE_PROXIMAL back to the wrist, in widths of the knuckles (INDEX_PROXIMAL to LITTLE_PROXIMAL)."""
BREADTH_SHARE = 1.27
"""The hand's breadth, in widths of the knuckles between their joints."""
PALM_RADIUS_SHARE = 0.165
"""From the palm's joint to its skin, in breadths: a hand is a third as thick as broad."""

_BASE_ALONG, _BASE_ACROSS = 0.36, 0.75
_THUMB_X = np.array([0.0, 0.85, -0.52])  # of a right hand, in the palm's axes: the thumb's nail faces sideways
_SHARES = {
    "THUMB": (0.17, 0.155, 0.125, 0.11),
    "INDEX": (PALM_RADIUS_SHARE, 0.13, 0.108, 0.098, 0.085),
    "MIDDLE": (PALM_RADIUS_SHARE, 0.135, 0.105, 0.098, 0.085),
    "RING": (PALM_RADIUS_SHARE, 0.125, 0.1, 0.093, 0.08),
    "LITTLE": (PALM_RADIUS_SHARE, 0.11, 0.088, 0.083, 0.07),
}
_BEND_LEAST = 0.3  # sum of sines over 8 joints: flatter fingers do not show their direction of bending


class CompletedJoints(NamedTuple):
    """Joints of a recording with what it never gives derived."""

    position: Numbers
    quaternion: Numbers
    radius: Numbers
    derived: NDArray[np.bool_]
    """Joints whose position was not given, shape [26]."""


def radius_shares() -> Numbers:
    """Radius of each joint in breadths of the hand, shape [26]."""
    digits = [share for shares in _SHARES.values() for share in shares]
    return np.array([PALM_RADIUS_SHARE, 0.2, *digits])


def knuckle_width(position: Numbers) -> float:
    """Between INDEX_PROXIMAL and LITTLE_PROXIMAL [m], median over frames; NaN where either is never seen."""
    width = np.linalg.norm(position[:, Joint.INDEX_PROXIMAL] - position[:, Joint.LITTLE_PROXIMAL], axis=1)
    return _median(width)


def complete_joints(position: Numbers, quaternion: Numbers, radius: Numbers, *, is_left: bool) -> CompletedJoints:
    """Positions [m], quaternions and radii [m] with what no frame gives derived.

    Shapes [frame, 26, 3], [frame, 26, 4] and [frame, 26]; NaN is unknown.
    """
    position, quaternion, radius = position.copy(), quaternion.copy(), radius.copy()
    derived = ~_has_values(position)
    width = knuckle_width(position)
    axes = _palm_axes(position, quaternion, is_left=is_left)
    if derived[Joint.WRIST]:
        position[:, Joint.WRIST] = position[:, Joint.MIDDLE_PROXIMAL] + WRIST_SHARE * width * axes[..., 2]
    for finger in FINGERS:
        if derived[finger[0]]:
            wrist, knuckle = position[:, Joint.WRIST], position[:, finger[1]]
            reach = np.einsum("fki,fk->fi", axes, knuckle - wrist) * [_BASE_ACROSS, _BASE_ALONG, _BASE_ALONG]
            position[:, finger[0]] = wrist + np.einsum("fik,fk->fi", axes, reach)
    if derived[Joint.PALM]:
        position[:, Joint.PALM] = (position[:, Joint.MIDDLE_METACARPAL] + position[:, Joint.MIDDLE_PROXIMAL]) / 2.0
    turned = joint_orientations(position, axes, is_left=is_left)
    for joint in np.flatnonzero(~_has_values(quaternion)):
        quaternion[:, joint] = turned[:, joint]
    shares = radius_shares() * (BREADTH_SHARE * width)
    for joint in np.flatnonzero(~np.isfinite(radius).any(axis=0)):
        radius[:, joint] = shares[joint]
    return CompletedJoints(position, quaternion, radius, derived)


def joint_orientations(position: Numbers, palm_axes: Numbers, *, is_left: bool) -> Numbers:
    """Quaternions of all joints from their positions and the palm's axes; shapes [frame, 26, 3], [frame, 3, 3].

    The flexion axis X of fingers is the palm's, of the thumb one turned about its length, made orthogonal to the bone.
    """
    matrix = np.full((*position.shape[:2], 3, 3), np.nan)
    matrix[:, Joint.PALM] = matrix[:, Joint.WRIST] = palm_axes
    thumb = palm_axes @ (_THUMB_X if not is_left else _THUMB_X * [1.0, -1.0, -1.0])
    for start, end in BONES:
        across = thumb if start in DIGITS[0] else palm_axes[..., 0]
        matrix[:, start] = axes_from(position[:, start] - position[:, end], across)
        if end in TIPS:
            matrix[:, end] = matrix[:, start]
    return quaternion_of(matrix)


def side_from_axes(position: Numbers, palm: Numbers) -> str | None:
    """Side of a hand from its axes: `left` if the knuckles run from index to little finger along -X of the palm.

    position: [frame, 26, 3]; palm: quaternions, [frame, 4]. None if no frame determines it.
    """
    across = position[:, Joint.LITTLE_PROXIMAL] - position[:, Joint.INDEX_PROXIMAL]
    along = _median(np.sum(across * matrix_of(palm)[..., 0], axis=1))
    return None if np.isnan(along) else ("right" if along > 0.0 else "left")


def side_from_bends(position: Numbers) -> str | None:
    """Side of a hand from positions only: fingers bend towards the palm. None for flat fingers."""
    across = unit(position[:, Joint.LITTLE_PROXIMAL] - position[:, Joint.INDEX_PROXIMAL])
    total = np.zeros(len(position))
    for finger in FINGERS:
        bone = unit(np.diff(position[:, finger[1:]], axis=1))
        total += np.sum(np.cross(bone[:, :-1], bone[:, 1:]) * across[:, None], axis=(1, 2))
    bend = _median(total)
    return None if not abs(bend) > _BEND_LEAST else ("left" if bend > 0.0 else "right")


def _palm_axes(position: Numbers, quaternion: Numbers, *, is_left: bool) -> Numbers:
    for joint in (Joint.PALM, Joint.MIDDLE_METACARPAL):
        if is_finite(quaternion[:, joint]).any():
            return matrix_of(quaternion[:, joint])
    back = position[:, Joint.WRIST] - position[:, Joint.MIDDLE_PROXIMAL]
    across = position[:, Joint.LITTLE_PROXIMAL] - position[:, Joint.INDEX_PROXIMAL]
    return axes_from(back, -across if is_left else across)


def axes_from(back: Numbers, across: Numbers) -> Numbers:
    """Columns X, Y, Z of frames, shape [..., 3, 3]: Z as `back`, X as near to `across` as can be; NaN if parallel."""
    z = unit(back)
    y = unit(np.cross(z, across))
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _has_values(values: Numbers) -> NDArray[np.bool_]:
    return np.asarray(is_finite(values).any(axis=0))


def _median(values: Numbers) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
