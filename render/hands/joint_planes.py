"""Planes of skin from the joints of a hand: one under the palm, one under each phalanx."""

from typing import NamedTuple

import numpy as np

from ...datasets.hand_model.joints import JOINT_COUNT, JOINT_NAMES, Joint
from ..errors import PoseError, StrategyError

KNUCKLES = {
    "index": Joint.INDEX_PROXIMAL,
    "middle": Joint.MIDDLE_PROXIMAL,
    "ring": Joint.RING_PROXIMAL,
    "little": Joint.LITTLE_PROXIMAL,
}
PHALANGES = {
    "thumb": {"proximal": Joint.THUMB_PROXIMAL, "distal": Joint.THUMB_DISTAL},
    **{
        name: {"proximal": Joint(k), "intermediate": Joint(k + 1), "distal": Joint(k + 2)}
        for name, k in KNUCKLES.items()
    },
}
"""Parts of each finger, with the joint at which each begins; it ends at the next one."""
FINGERS = tuple(PHALANGES)


class Plane(NamedTuple):
    """A rectangle under a bone, of one size, that moves."""

    name: str
    width: float  # [m]
    length: float  # [m]
    pose: np.ndarray  # in the hand's frame, float64, shape [frame, 7]; NaN where a joint is missing


def planes_of_joints(
    joints: np.ndarray, radius: np.ndarray, *, is_left: bool, palm: bool, fingers: tuple[str, ...]
) -> list[Plane]:
    """Planes of a hand: see `PlaneHand.from_joints`."""
    joints, radius = checked_joints(joints, radius)
    for finger in fingers:
        if finger not in PHALANGES:
            raise StrategyError(f"there is no finger {finger!r}; there are: {', '.join(FINGERS)}")
    if not palm and not fingers:
        raise StrategyError("a hand without palm and fingers has no patch")
    require_side(joints, is_left)
    planes = [palm_plane(joints, radius)] if palm else []
    for finger in dict.fromkeys(fingers):
        planes += [phalanx_plane(f"{finger}-{part}", joints, radius, k) for part, k in PHALANGES[finger].items()]
    return planes


def checked_joints(joints: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints [frame, 26, 7] and radii [frame, 26] in float64; a joint that is not wholly finite is wholly NaN."""
    joints, radius = np.array(joints, np.float64), np.asarray(radius, np.float64)
    if joints.ndim != 3 or joints.shape[1:] != (JOINT_COUNT, 7) or len(joints) == 0:
        raise PoseError(f"joints must have shape [frame, {JOINT_COUNT}, 7], not {list(joints.shape)}")
    if radius.shape not in ((JOINT_COUNT,), joints.shape[:2]):
        raise PoseError(f"radius must have shape [{JOINT_COUNT}] or [frame, {JOINT_COUNT}], not {list(radius.shape)}")
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    radius = np.broadcast_to(radius, joints.shape[:2])
    wrong = ~np.isnan(joints[..., 0]) & ~(radius > 0.0)  # a NaN compares false
    if wrong.any():
        frame, k = np.argwhere(wrong)[0]
        raise PoseError(f"radius of {JOINT_NAMES[k]} in frame {frame} must be above 0 m, not {radius[frame, k]}")
    return joints, radius


def require_side(joints: np.ndarray, is_left: bool) -> None:
    """Raise PoseError if the little finger's knuckle is on the other side of the index finger's than in this hand."""
    across = joints[:, KNUCKLES["little"], 0] - joints[:, KNUCKLES["index"], 0]
    if np.isnan(across).all():
        return
    if (np.nanmedian(across) < 0.0) != is_left:
        sides = ("left", "right") if is_left else ("right", "left")
        raise PoseError(f"these are joints of a {sides[1]} hand, not of a {sides[0]} one: see the knuckles' order")


def palm_plane(joints: np.ndarray, radius: np.ndarray) -> Plane:
    """The palm's plane y = 0: from the wrist to the middle finger's knuckle, across from index to little finger's.

    It lies still in the hand's frame, at the median over the motion.
    """
    used = (Joint.WRIST, KNUCKLES["index"], KNUCKLES["middle"], KNUCKLES["little"])
    there = np.isfinite(joints[:, used, 0])
    if not there.all(axis=1).any():
        names = ", ".join(JOINT_NAMES[k] for k in used)
        raise PoseError(f"palm: in no frame are {names} all there: give them, or leave the palm out with palm=False")
    frame_count = len(joints)
    joints, radius = joints[there.all(axis=1)], radius[there.all(axis=1)]
    ends = [KNUCKLES["index"], KNUCKLES["little"]]
    x, rim = joints[:, ends, 0], radius[:, ends]
    low, high = median((x - rim).min(axis=1)), median((x + rim).max(axis=1))
    front, back = median(joints[:, KNUCKLES["middle"], 2]), median(joints[:, Joint.WRIST, 2])
    pose = [(low + high) / 2, 0.0, (front + back) / 2, 0.0, 0.0, 0.0, 1.0]
    return Plane("palm", high - low, abs(back - front), np.tile(pose, (frame_count, 1)))


def phalanx_plane(name: str, joints: np.ndarray, radius: np.ndarray, k: Joint) -> Plane:
    """The plane under the bone from joint k to the next one, as far away as the skin is.

    Its normal into the finger is Y of the first joint, made orthogonal to the bone.
    """
    from scipy.spatial.transform import Rotation  # a tenth of a second that other hands do without

    a, b = joints[:, k, :3], joints[:, k + 1, :3]
    bone, across = b - a, radius[:, k] + radius[:, k + 1]
    there = np.isfinite(joints[:, [k, k + 1]]).all(axis=(1, 2)) & (np.linalg.norm(bone, axis=1) > 1e-6)
    if not there.any():
        names = f"{JOINT_NAMES[k]} and {JOINT_NAMES[k + 1]}"
        raise PoseError(f"{name}: {names} are in no frame both there and apart: leave the finger out")
    pose = np.full((len(joints), 7), np.nan)
    v = bone[there] / np.linalg.norm(bone[there], axis=1, keepdims=True)
    up = Rotation.from_quat(joints[there, k, 3:]).as_matrix()[..., 1]
    u = np.cross(v, up)
    size = np.linalg.norm(u, axis=1, keepdims=True)
    if (size < 1e-3).any():
        frame = int(np.flatnonzero(there)[np.flatnonzero(size[:, 0] < 1e-3)[0]])
        raise PoseError(f"{name}: in frame {frame} the back (+Y) of {JOINT_NAMES[k]} points along its bone")
    u /= size
    n = np.cross(u, v)
    pose[there, :3] = (a + b)[there] / 2 - across[there, None] / 2 * n
    pose[there, 3:] = Rotation.from_matrix(np.stack([u, n, -v], axis=2)).as_quat()
    return Plane(name, median(across[there]), median(np.linalg.norm(bone[there], axis=1)), pose)


def median(values: np.ndarray) -> float:
    """Median of all."""
    return float(np.median(values))
