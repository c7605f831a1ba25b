"""Check whether a recording's orientations agree with its positions, and which other convention they follow if not.

A joint's -Z axis runs along its bone to the tip, and the palm's from the wrist to the middle knuckle. Files of other
conventions give other directions there; the convention under which both agree is the likely cause.

| convention                        | what it takes to read it                                       |
|-----------------------------------|----------------------------------------------------------------|
| quaternions w x y z               | x y z w                                                        |
| a left-handed frame (Unity)       | positions and orientations mirrored in z                       |
| inverse quaternions               | their conjugates                                               |
| only one of the two mirrored      | the other one mirrored in z, too                               |
| axes of joints that are others    | each orientation multiplied on the right by one rotation       |
"""

from collections.abc import Callable, Iterator
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError
from ..hand_model.frames import side_from_axes, side_from_bends
from ..hand_model.joints import BONES, DIGITS, Joint
from ..rigid import Numbers, conjugate, is_finite, quaternion_of, quaternion_product, rotate, unit

PALM_LEAST = 0.9
"""Least median cosine between the palm's -Z and the way from wrist to middle knuckle; of real hands it is 0.99."""
BONES_LEAST = 0.8
"""Least median cosine between the -Z of the fingers' joints and their bones."""

MIRRORED = np.array([1.0, 1.0, -1.0])
"""Of a position, mirrored in z."""
_MIRRORED_TURN = np.array([-1.0, -1.0, 1.0, 1.0])  # of a quaternion, whose rotation is then that of mirrored vectors
_HALF_TURN = np.array([1.0, 0.0, 0.0, 0.0])  # about X
_FRAMES_MOST = 10_000  # so many frames, evenly chosen, decide
_MISFIT_MOST = 0.02  # mean of 1 - cosine from which on another convention may explain a recording better ...
_FAR_BETTER = 4.0  # ... by a misfit that is so many times smaller

_FINGER_BONES = [(start, end) for start, end in BONES if start not in DIGITS[0]]

Change = Callable[[Numbers, Numbers], tuple[Numbers, Numbers]]


class Convention(NamedTuple):
    """Another way to write poses of joints."""

    cause: str
    """What the file may have done, as the end of a sentence, with the way out."""
    change: Change
    """Positions and quaternions -> those of palpate."""


class AxesAgreement(NamedTuple):
    """How well orientations agree with positions; NaN is not known."""

    palm: float
    """Median cosine at the palm."""
    bones: float
    """Median cosine along the bones of fingers."""
    misfit: float
    """Mean of 1 - cosine over all of these."""

    @property
    def is_enough(self) -> bool:
        """Whether neither the palm nor the bones contradict; what is not known does not."""
        return not (self.palm < PALM_LEAST or self.bones < BONES_LEAST)


def mirrored(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    """Positions [..., 3] and quaternions [..., 4] of a left-handed frame in the right-handed one with z reversed."""
    return position * MIRRORED, quaternion * _MIRRORED_TURN


def palm_quaternion(quaternion: Numbers) -> Numbers:
    """The palm's orientation, shape [frame, 4]: PALM's, or MIDDLE_METACARPAL's where PALM has none in any frame."""
    palm = quaternion[:, Joint.PALM]
    return palm if is_finite(palm).any() else quaternion[:, Joint.MIDDLE_METACARPAL]


def palm_agreement(position: Numbers, quaternion: Numbers) -> float:
    """Median cosine between the palm's -Z and the way from wrist to middle knuckle; NaN where nothing shows it."""
    return _median(_palm_cosines(position, quaternion))


def agreement_of(position: Numbers, quaternion: Numbers) -> AxesAgreement:
    """Agreement of positions [frame, 26, 3] and quaternions [frame, 26, 4], NaN where unknown, of one hand."""
    palm = _palm_cosines(position, quaternion)
    start, end = (list(joints) for joints in zip(*_FINGER_BONES, strict=True))
    bones = _cosines(quaternion[:, start], position[:, end] - position[:, start])
    both = np.concatenate([palm, bones])
    return AxesAgreement(_median(palm), _median(bones), float(np.mean(1.0 - both)) if both.size else float("nan"))


def require_agreement(position: Numbers, quaternion: Numbers, side: str | None, *, is_mirrored: bool = False) -> None:
    """Raise RecordingError, naming the likely cause, where orientations contradict positions.

    Also where they do not, but agree far better by another convention: conjugates of a hand that is nearly level do.
    position, quaternion: as the file gives them, NaN where unknown. side: `left` or `right` as the file states it.
    is_mirrored: whether an alignment mirrored them before.
    """
    step = -(-len(position) // _FRAMES_MOST)
    position, quaternion = position[::step], quaternion[::step]
    found = agreement_of(position, quaternion)
    if found.is_enough and not found.misfit > _MISFIT_MOST:
        return
    bones_alone = not found.palm < PALM_LEAST and found.bones < BONES_LEAST
    if bones_alone:  # the palm's axes may be vectors, which have no order of quaternions
        quaternion = quaternion.copy()
        quaternion[:, Joint.PALM] = np.nan
    causes = _causes(position, quaternion, side, agreement_of(position, quaternion), is_mirrored=is_mirrored)
    if found.is_enough and not causes:
        return
    at, value, least = "of the palm", found.palm, PALM_LEAST
    along = "the way from wrist to middle knuckle"
    if bones_alone:
        at, value, least, along = "of fingers' joints", found.bones, BONES_LEAST, "their bones"
    likely = "; likely cause: " + ", or ".join(causes[:2]) if causes else "; no convention known to palpate explains it"
    if found.is_enough:
        raise RecordingError(
            f"orientations contradict positions: the joints' -Z axes and their bones have the mean cosine"
            f" {1.0 - found.misfit:.2f}, and a higher one by another convention{likely}"
        )
    raise RecordingError(
        f"orientations contradict positions: the -Z axis {at} has the cosine {value:.2f} (median) with {along}, at"
        f" least {least:g} is needed{likely}"
    )


def _causes(
    position: Numbers, quaternion: Numbers, side: str | None, found: AxesAgreement, *, is_mirrored: bool
) -> list[str]:
    """Conventions under which a recording agrees far better than as it is; other axes only where none else does."""
    changed = [(one.cause, one.change(position, quaternion)) for one in _conventions(is_mirrored=is_mirrored)]
    likely = {cause: agreement_of(*pose).misfit for cause, pose in changed if _explains(pose, side, found)}
    if likely:
        most = 2.0 * min(likely.values()) + 1e-3
        return [cause for cause, misfit in likely.items() if misfit <= most]
    turned = ((turn, quaternion_product(quaternion, turn)) for turn in _turns())
    explaining = [(_lies_across(position, q), turn) for turn, q in turned if _explains((position, q), side, found)]
    return [_axes_cause(max(explaining, key=lambda one: one[0])[1])] if explaining else []


def _conventions(*, is_mirrored: bool) -> list[Convention]:
    frame = (
        "the tracker's frame is right-handed, but the alignment mirrors (determinant -1)"
        if is_mirrored
        else "the frame is left-handed, as Unity's: alignment=unity, or a matrix that mirrors, reads it"
    )
    return [
        Convention("quaternions are w x y z, and must be x y z w", _w_last),
        Convention(frame, mirrored),
        Convention("quaternions are inverse: conjugate them", _conjugated),
        Convention(_axes_cause(_HALF_TURN), _turned_about_x),
        Convention("positions have z reversed, orientations have not", _positions_mirrored),
        Convention("orientations have z reversed, positions have not", _orientations_mirrored),
    ]


def _w_last(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    return position, quaternion[..., [1, 2, 3, 0]]


def _conjugated(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    return position, conjugate(quaternion)


def _turned_about_x(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    return position, quaternion_product(quaternion, _HALF_TURN)


def _positions_mirrored(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    return position * MIRRORED, quaternion


def _orientations_mirrored(position: Numbers, quaternion: Numbers) -> tuple[Numbers, Numbers]:
    return position, quaternion * _MIRRORED_TURN


def _explains(changed: tuple[Numbers, Numbers], side: str | None, found: AxesAgreement) -> bool:
    """Whether a hand agrees far better after a change, its side included."""
    position, quaternion = changed
    now = agreement_of(position, quaternion)
    if not now.is_enough or not now.misfit * _FAR_BETTER < found.misfit:
        return False
    sides = (side, side_from_axes(position, palm_quaternion(quaternion)), side_from_bends(position))
    return len({one for one in sides if one is not None}) <= 1


def _turns() -> Iterator[Numbers]:
    """Quaternions of the rotations of a cube onto itself, shape [4]."""
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.eye(3)[:, list(order)] * signs
            if np.linalg.det(matrix) > 0.0:
                yield quaternion_of(matrix)


def _lies_across(position: Numbers, quaternion: Numbers) -> float:
    """How well the palm's X axis lies across the knuckles, 0 to 1."""
    across = unit(position[:, Joint.LITTLE_PROXIMAL] - position[:, Joint.INDEX_PROXIMAL])
    values = np.sum(rotate(palm_quaternion(quaternion), np.array([1.0, 0.0, 0.0])) * across, axis=-1)
    return abs(_median(values[np.isfinite(values)]))


def _axes_cause(turn: Numbers) -> str:
    """The sentence on joints whose orientations q must become q * turn."""
    axis = rotate(turn, np.array([0.0, 0.0, -1.0]))  # where palpate's -Z is in the file's axes
    k = int(np.argmax(np.abs(axis)))
    name = f"{'+' if axis[k] > 0.0 else '-'}{'XYZ'[k]}"
    values = ", ".join(f"{value:.3g}" for value in (turn + 0.0).tolist())
    return (
        f"the joints' {name} axis runs to the tips, and -Z must: multiply each orientation by ({values}) on the right"
    )


def _palm_cosines(position: Numbers, quaternion: Numbers) -> Numbers:
    return _cosines(palm_quaternion(quaternion), position[:, Joint.MIDDLE_PROXIMAL] - position[:, Joint.WRIST])


def _cosines(quaternion: Numbers, along: Numbers) -> Numbers:
    """Between -Z of orientations and directions, those that are known, shape [known]."""
    values = np.sum(rotate(quaternion, np.array([0.0, 0.0, -1.0])) * unit(along), axis=-1)
    return values[np.isfinite(values)]


def _median(values: Numbers) -> float:
    return float(np.median(values)) if values.size else float("nan")
