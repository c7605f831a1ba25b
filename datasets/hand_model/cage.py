"""The control cage of the parametric hand: 164 quads around the joints of a flat open right hand, open at the wrist.

Hand frame: +X to the little finger, +Y out of the back, -Z to the finger tips; the palm's skin is at y = 0, the origin
midway between index and little knuckles, and between middle knuckle and wrist. Lengths are a medium hand's, 85 mm
broad and 190 mm long, from tables of hand sizes and from recorded hands; `hand_shape` scales them.

          T[4]   web, where fingers begin        rows 0 (wrist's rim) to 4, at both layers T (back) and B (palm)
        4 +--+--+--+--+    columns               columns of vertices 0 (thumb's side) to 4
        3 +--+--+--+--+    index middle          a finger starts from the opening between two columns of row 4,
        2 +--+--+--+--+    ring little           the thumb from that between rows 1 and 2 of column 0
        1 +--+--+--+--+
        0 +--+--+--+--+
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rigid import Numbers, unit
from .frames import joint_orientations, radius_shares
from .joints import BONES, DIGITS, JOINT_COUNT, Joint

BREADTH, LENGTH = 0.085, 0.19  # [m] of the hand that the numbers below are of

_DEPTH = 0.014  # [m] of joints behind the palm's skin
_KNUCKLES = ((-0.0315, -0.0445), (-0.0095, -0.0475), (0.0115, -0.0425), (0.0315, -0.033))  # x, z [m]
_BASES = ((-0.0235, 0.0135), (-0.007, 0.0133), (0.0085, 0.0135), (0.0225, 0.015))
_SPREAD = (-5.0, -1.0, 4.0, 10.0)  # [deg] of fingers from -Z, towards +X
_PHALANGES = (
    (0.040, 0.0235, 0.0175),
    (0.0445, 0.027, 0.0185),
    (0.041, 0.0255, 0.0185),
    (0.032, 0.0185, 0.0165),
)
_THUMB = ((-0.028, 0.009, 0.027), (-0.055, 0.005, -0.002), (-0.0746, 0.0034, -0.0265), (-0.089, 0.0022, -0.0457))
_WRIST = (0.0, _DEPTH, 0.0475)

# Rows of the palm: z, x of column 0 and 4, y of the palm's skin at its edges and its middle, y of the back.
_ROWS = (
    (0.0560, -0.0300, 0.0300, -0.003, -0.003, 0.0340),
    (0.0370, -0.0370, 0.0365, -0.005, -0.001, 0.0310),
    (0.0090, -0.0425, 0.0420, -0.003, 0.001, 0.0290),
    (-0.0150, -0.0440, 0.0430, 0.000, 0.001, 0.0275),
)
_WEB = ((-0.0435, -0.0500), (-0.0212, -0.0620), (0.0008, -0.0630), (0.0215, -0.0560), (0.0425, -0.0420))  # x, z
_WEB_SKIN, _WEB_BACK = 0.0025, 0.0250
_ROUND = 0.93  # a square tube of half width 1 is smoothed to a round one of this radius
_REACH = 0.0075  # [m] from a tip's joint to the cage's end; smoothing takes a third of it back


class Cage(NamedTuple):
    """Quads, what their vertices carry, and the joints they were built around."""

    position: Numbers
    """[m], shape [vertex, 3]."""
    weight: Numbers
    """How far each joint moves a vertex, shape [vertex, 26]; rows sum to 1."""
    palmar: Numbers
    """1 on the palm's side, 0 on the back, shape [vertex]."""
    quads: NDArray[np.int32]
    joint_position: Numbers
    joint_quaternion: Numbers
    joint_radius: Numbers


class _Builder:
    """Vertices and quads as they are added."""

    def __init__(self) -> None:
        self.position: list[Numbers] = []
        self.weight: list[dict[Joint, float]] = []
        self.palmar: list[float] = []
        self.quads: list[list[int]] = []

    def add(self, position: Numbers, weight: dict[Joint, float], *, palmar: bool) -> int:
        self.position.append(position)
        self.weight.append(weight)
        self.palmar.append(float(palmar))
        return len(self.position) - 1

    def weights(self) -> Numbers:
        out = np.zeros((len(self.weight), JOINT_COUNT))
        for row, weight in zip(out, self.weight, strict=True):
            for joint, value in weight.items():
                row[joint] += value
        return out


def hand_cage() -> Cage:
    """The cage of a right hand of 85 x 190 mm."""
    position = _joint_positions()
    quaternion = joint_orientations(position[None], np.eye(3)[None], is_left=False)[0]
    radius = radius_shares() * BREADTH
    built = _Builder()
    back, skin = _palm(built)
    for index, finger in enumerate(DIGITS[1:]):
        loop = [back[4][index], back[4][index + 1], skin[4][index + 1], skin[4][index]]
        _tube(built, loop, finger[1:], position, radius, np.array([1.0, 0.0, 0.0]))
    loop = [back[1][0], back[2][0], skin[2][0], skin[1][0]]
    _tube(built, loop, DIGITS[0], position, radius, np.array([0.72, 0.0, -0.68]))
    quads = np.array(built.quads, dtype=np.int32)
    values = np.array(built.position), built.weights(), np.array(built.palmar)
    return Cage(*values, quads, position, quaternion, radius)


def _joint_positions() -> Numbers:
    position = np.zeros((JOINT_COUNT, 3))
    position[Joint.WRIST] = _WRIST
    position[list(DIGITS[0])] = _THUMB
    for finger, base, knuckle, angle, lengths in zip(DIGITS[1:], _BASES, _KNUCKLES, _SPREAD, _PHALANGES, strict=True):
        ahead = np.array([math.sin(math.radians(angle)), 0.0, -math.cos(math.radians(angle))])
        position[finger[0]] = base[0], _DEPTH, base[1]
        start = np.array([knuckle[0], _DEPTH, knuckle[1]])
        position[list(finger[1:])] = start + np.cumsum([0.0, *lengths])[:, None] * ahead
    position[Joint.PALM] = (position[Joint.MIDDLE_METACARPAL] + position[Joint.MIDDLE_PROXIMAL]) / 2.0
    return position


def _palm(built: _Builder) -> tuple[list[list[int]], list[list[int]]]:
    """Both layers' vertices by row and column; the quads of the palm, its back and its two sides."""
    back: list[list[int]] = []
    skin: list[list[int]] = []
    for row in range(5):
        back.append([])
        skin.append([])
        for column in range(5):
            x, z, low, high = _palm_place(row, column)
            weight = _palm_weight(row, column)
            back[row].append(built.add(np.array([x, high, z]), weight, palmar=False))
            skin[row].append(built.add(np.array([x, low, z]), weight, palmar=True))
    for row in range(4):
        for c in range(4):
            built.quads.append([back[row][c], back[row][c + 1], back[row + 1][c + 1], back[row + 1][c]])
            built.quads.append([skin[row][c], skin[row + 1][c], skin[row + 1][c + 1], skin[row][c + 1]])
        built.quads.append([back[row][4], skin[row][4], skin[row + 1][4], back[row + 1][4]])
        if row != 1:  # the thumb's opening
            built.quads.append([back[row][0], back[row + 1][0], skin[row + 1][0], skin[row][0]])
    return back, skin


def _palm_place(row: int, column: int) -> tuple[float, float, float, float]:
    """x, z, y of the skin, y of the back [m]."""
    if row == 4:
        return *_WEB[column], _WEB_SKIN, _WEB_BACK
    z, first, last, edge, middle, back = _ROWS[row]
    inner = column in (1, 2, 3)
    x = first + (last - first) * column / 4.0
    return x, z, middle if inner else edge, back if inner else back - 0.004


def _palm_weight(row: int, column: int) -> dict[Joint, float]:
    """A column between two fingers is moved by both; the wrist's rim by the wrist, the web by the fingers as well."""
    near = [index for index in (column - 1, column) if 0 <= index < 4]
    bones = {DIGITS[1 + index][0]: 1.0 / len(near) for index in near}
    if row == 0:
        return {Joint.WRIST: 1.0}
    if row == 1:
        return {Joint.WRIST: 0.5} | {joint: share / 2.0 for joint, share in bones.items()}
    if row == 4:
        fingers = {DIGITS[1 + index][1]: 0.5 / len(near) for index in near}
        return {joint: share / 2.0 for joint, share in bones.items()} | fingers
    if row == 2 and column == 0:
        return {Joint.INDEX_METACARPAL: 0.6, Joint.THUMB_METACARPAL: 0.4}
    return bones


def _tube(
    built: _Builder,
    loop: list[int],
    joints: tuple[Joint, ...],
    position: Numbers,
    radius: Numbers,
    across: Numbers,
) -> None:
    """Quads around a digit of three bones, from an opening to a closed tip.

    loop: vertices of the opening: back at -across, back at +across, skin at +across, skin at -across.
    """
    first, second, third, tip = joints
    for bone, share, ends in (
        ((first, second), 0.62, (first, first)),
        ((first, second), 1.0, (first, second)),
        ((second, third), 0.5, (second, second)),
        ((second, third), 1.0, (second, third)),
        ((third, tip), 0.6, (third, third)),
        ((third, tip), None, (third, third)),
    ):
        start, end = position[bone[0]], position[bone[1]]
        ahead = unit(end - start)
        side = unit(across - ahead * float(across @ ahead))
        up = np.cross(side, ahead)
        wide = radius[bone[1]] if share is None else radius[bone[0]] + share * (radius[bone[1]] - radius[bone[0]])
        centre = end + _REACH * ahead if share is None else start + share * (end - start)
        half = wide / _ROUND * (0.7 if share is None else 1.0)
        weight = {ends[0]: 1.0} if ends[0] == ends[1] else {ends[0]: 0.5, ends[1]: 0.5}
        corners = ((-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0))
        ring = [built.add(centre + half * (u * side + v * up), weight, palmar=v < 0.0) for u, v in corners]
        built.quads += [[loop[k], loop[(k + 1) % 4], ring[(k + 1) % 4], ring[k]] for k in range(4)]
        loop = ring
    built.quads.append(loop)


def bone_lengths(position: Numbers) -> Numbers:
    """Length of the bone that starts at each joint [m], shape [..., 26]; 1 for joints where none starts."""
    length = np.ones(position.shape[:-1])
    for start, end in BONES:
        length[..., start] = np.linalg.norm(position[..., end, :] - position[..., start, :], axis=-1)
    return length
