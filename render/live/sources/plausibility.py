"""Whether a frame can be of a hand over an array; if not, the value, the bound and the likely cause are reported."""

import math

import numpy as np

from ....datasets.errors import RecordingError
from ....datasets.hand_model.frames import BREADTH_SHARE, knuckle_width, side_from_axes
from ....datasets.hand_model.joints import JOINT_COUNT, JOINT_NAMES, Joint
from ....datasets.recordings.conventions import PALM_LEAST, palm_agreement, palm_quaternion, require_agreement
from ....datasets.recordings.recording import BREADTH_LEAST, BREADTH_MOST
from ....datasets.rigid import Numbers
from .hand_frame import SourceFault

NORM_TOLERANCE = 1e-2
"""Largest difference of a quaternion's norm from 1: trackers send few digits. Poses are normalised."""
NORM_ROUNDING = 1e-7
"""float32's rounding of a norm, which is left alone, as `HandMotion` does: so a motion is replayed bit for bit."""
FARTHEST = 3.0
"""Farther from the array's centre than this [m] is no hand over an array, and most likely millimetres."""
RADIUS_MOST = BREADTH_MOST / 2
_KNUCKLES = (Joint.WRIST, Joint.INDEX_PROXIMAL, Joint.MIDDLE_PROXIMAL, Joint.LITTLE_PROXIMAL)


class Implausible(ValueError):
    """A frame that is refused: `fault` is why."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.fault = SourceFault(kind, text)


def unit_pose(pose: Numbers, name: str = "pose") -> Numbers:
    """A pose as float64 with a quaternion of norm 1, shape [7]; raises Implausible."""
    row = _floats(pose, name, (7,))
    if not np.isfinite(row).all():
        k = int(np.flatnonzero(~np.isfinite(row))[0])
        raise Implausible(
            f"{name} not finite", f"{name}[{k}]: must be finite, not {row[k]}; a hand not seen has no {name}"
        )
    norm = float(np.linalg.norm(row[3:]))
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise Implausible(
            f"{name} norm", f"{name}: the quaternion's norm must be 1 within {NORM_TOLERANCE:g}, not {norm:.6g}"
        )
    if abs(norm - 1.0) > NORM_ROUNDING:
        row[3:] /= norm
    return row


def unit_joints(joints: Numbers, radius: Numbers | None) -> tuple[Numbers, Numbers]:
    """Joints [26, 7] with quaternions of norm 1 and radii [26], NaN where not known; raises Implausible."""
    rows = _floats(joints, "joints", (JOINT_COUNT, 7))
    if np.isinf(rows).any():
        k = int(np.argwhere(np.isinf(rows))[0, 0])
        raise Implausible("joints infinite", f"joints: {JOINT_NAMES[k]} must be finite, or NaN where it is not known")
    norm = np.sqrt(np.einsum("jk,jk->j", rows[:, 3:], rows[:, 3:]))
    wrong = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if wrong.size:
        k = int(wrong[0])
        raise Implausible(
            "joints norm",
            f"joints: the norm of {JOINT_NAMES[k]}'s quaternion must be 1 within {NORM_TOLERANCE:g}, not {norm[k]:.6g}",
        )
    rows[:, 3:] /= norm[:, None]
    size = np.full(JOINT_COUNT, np.nan) if radius is None else _floats(radius, "radius", (JOINT_COUNT,))
    strange = np.flatnonzero((size <= 0.0) | (size > RADIUS_MOST))  # NaN compares false
    if strange.size:
        k = int(strange[0])
        raise Implausible(
            "radius", f"radius: {JOINT_NAMES[k]} must lie in 0..{RADIUS_MOST:g} m, not {size[k]:.6g}{_unit(size[k])}"
        )
    return rows, size


def require_hand(joints: Numbers, stated: str | None) -> None:
    """Raise Implausible unless joints [26, 7] are of a hand's size, of the stated side, and turned as OpenXR's."""
    if not _is_hand(joints, stated):
        _refuse_hand(joints, stated)


def _is_hand(joints: Numbers, stated: str | None) -> bool:
    """Whether joints are surely a hand's: in plain numbers, which takes 15 us where `_refuse_hand` takes 300."""
    wrist, index, middle, little = (joints[k, :3].tolist() for k in _KNUCKLES)
    x, y, z, w = joints[Joint.PALM, 3:].tolist()
    across = [b - a for a, b in zip(index, little, strict=True)]
    along = [b - a for a, b in zip(wrist, middle, strict=True)]
    palm_x = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
    palm_z = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    breadth = BREADTH_SHARE * math.hypot(*across)
    to_little = sum(a * b for a, b in zip(across, palm_x, strict=True))
    to_tips = -sum(a * b for a, b in zip(along, palm_z, strict=True))
    is_right = stated in (None, "right" if to_little > 0.0 else "left")
    is_turned = to_tips >= PALM_LEAST * math.hypot(*along)  # a NaN compares false
    return is_right and is_turned and BREADTH_LEAST <= breadth <= BREADTH_MOST


def _refuse_hand(joints: Numbers, stated: str | None) -> None:
    """Raise Implausible with what is wrong; what is not known is not wrong."""
    position, quaternion = joints[None, :, :3], joints[None, :, 3:]
    breadth = BREADTH_SHARE * knuckle_width(position)
    if breadth < BREADTH_LEAST or breadth > BREADTH_MOST:  # not known is NaN, which compares false
        raise Implausible(
            "size",
            f"joints: the hand measures {breadth:.4g} m across the palm, and must measure {BREADTH_LEAST:g} to "
            f"{BREADTH_MOST:g} m{_unit(breadth)}",
        )
    palm = palm_quaternion(quaternion)
    found = side_from_axes(position, palm)
    if None not in (stated, found) and stated != found:
        raise Implausible(
            "side",
            f"side: said to be a {stated} hand, but its joints are those of a {found} one: the sides are exchanged, or "
            "positions are mirrored as in Unity's left-handed frame (alignment=unity)",
        )
    if palm_agreement(position, quaternion) < PALM_LEAST:  # unknown is NaN
        try:
            require_agreement(position, quaternion, stated)
        except RecordingError as error:
            raise Implausible("axes", f"joints: {error}") from None


def require_near(position: Numbers) -> None:
    """Raise Implausible for a palm [m], array's frame, that is farther away than FARTHEST."""
    distance = float(np.linalg.norm(position))
    if distance > FARTHEST:
        raise Implausible(
            "distance",
            f"pose: the hand is {distance:.4g} m from the array's centre, and must be within {FARTHEST:g} m"
            ": are positions in millimetres, or is the alignment another tracker's?",
        )


def _floats(values: Numbers, name: str, shape: tuple[int, ...]) -> Numbers:
    try:
        found = np.array(values, np.float64)
    except (TypeError, ValueError):
        raise Implausible(
            f"{name} numbers", f"{name}: must be numbers of shape {list(shape)}, not {values!r:.60}"
        ) from None
    if found.shape != shape:
        raise Implausible(f"{name} shape", f"{name}: must have shape {list(shape)}, not {list(found.shape)}")
    return found


def _unit(value: float) -> str:
    """The end of a sentence on a length [m] that may be in millimetres."""
    return ": is it in millimetres?" if value > 1.0 else ""
