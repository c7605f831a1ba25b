"""Objects that move: where they are at each pose of the hand, and the hand as they see it."""

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.rigid import compose, invert, rotate, slerp
from ..errors import PoseError

EDGE_MOST = 0.1  # [s]; a motion's end is held for an interval, but of keyframes no longer than this


def seen_from(moved: np.ndarray, pivot: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Poses as they are to an object that has moved, float32, shape [pose, 7].

    moved: where the object's pivot is [m], and how it is turned, shape [pose, 7]; pivot: where it is as placed [m];
    pose: hand frame -> array frame, shape [pose, 7].
    """
    seen = compose(invert(moved), pose)
    seen[:, :3] += pivot
    return seen.astype(np.float32)


def back_to(moved: np.ndarray, pivot: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points where the object was placed that have moved with it [m], float64; a row of `moved` for each [point, 3]."""
    back = invert(moved)
    return back[:, :3] + rotate(back[:, 3:], points.astype(np.float64)) + pivot


def about_outline(moved: np.ndarray, pivot: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """The same motion, told of the middle of an outline's bounds: what a file stores beside the outline.

    moved: of `pivot` [m], shape [pose, 7]; vertices: of the outline where the object was placed [m].
    """
    shift = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).mean(axis=0) - pivot
    if not shift.any():
        return moved
    out = np.array(moved, np.float64)
    out[:, :3] += rotate(out[:, 3:], shift)
    return out.astype(np.float32)


def object_poses(moved: HandMotion | np.ndarray, motion: HandMotion | np.ndarray) -> np.ndarray:
    """The object's pose at each pose of the hand, float32, shape [pose, 7]; between its own times it moves evenly.

    moved: the object's motion (position: where the middle of its placed bounds is), or a pose for each of the hand's.
    Raises PoseError where numbers differ, times are missing, or the hand is there before or after the object; its ends
    are held for an interval of its own, but no longer than 0.1 s.
    """
    time = motion.time if isinstance(motion, HandMotion) else None
    if not isinstance(moved, HandMotion):
        moved = HandMotion(None, np.asarray(moved))
    if len(moved) == 1:
        return np.repeat(moved.pose, len(motion), axis=0)
    if moved.time is None or time is None or not isinstance(motion, HandMotion):
        if len(moved) != len(motion):
            raise PoseError(
                f"the object has {len(moved)} poses, the hand {len(motion)}: give both times, or as many poses"
            )
        return moved.pose
    own = moved.time + (moved.offset - motion.offset)
    edge = 1e-6 + min(float(np.median(np.diff(own))), EDGE_MOST)
    if time[0] < own[0] - edge or time[-1] > own[-1] + edge:
        raise PoseError(
            f"the object's motion lasts from {own[0]:g} to {own[-1]:g} s of the hand's time, "
            f"the hand's from {time[0]:g} to {time[-1]:g} s"
        )
    return between(own, moved.pose.astype(np.float64), np.clip(time, own[0], own[-1]))


def between(own: np.ndarray, pose: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Poses at other times: positions linear, rotations along the shorter arc; float32, shape [time, 7]."""
    k = np.clip(np.searchsorted(own, time, side="right") - 1, 0, len(own) - 2)
    share = ((time - own[k]) / (own[k + 1] - own[k]))[:, None]
    position = pose[k, :3] + share * (pose[k + 1, :3] - pose[k, :3])
    return np.concatenate([position, slerp(pose[k, 3:], pose[k + 1, 3:], share)], axis=1).astype(np.float32)
