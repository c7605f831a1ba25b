"""Objects that move: their pose at each pose of the hand, and hand poses in their frame."""

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ...datasets.rigid import compose, invert, rotate, slerp
from ..errors import PoseError

EDGE_MOST = 0.1  # [s]; longest time for which the first and last pose hold beyond the object's motion


def seen_from(object_pose: np.ndarray, object_centre: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Hand poses in the frame of an object that moves: as if it had stayed where it was placed; float32 [pose, 7].

    object_pose: position of the object's centre [m] and its rotation, shape [pose, 7]; object_centre: position of that
    point as placed [m]; pose: hand frame -> array frame, shape [pose, 7].
    """
    seen = compose(invert(object_pose), pose)
    seen[:, :3] += object_centre
    return seen.astype(np.float32)


def back_to(object_pose: np.ndarray, object_centre: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points on a moving object, moved back to where it was placed [m], float64, shape [point, 3].

    object_pose: a row for each point.
    """
    back = invert(object_pose)
    return back[:, :3] + rotate(back[:, 3:], points.astype(np.float64)) + object_centre


def about_outline(object_pose: np.ndarray, object_centre: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """The object's poses, given for the middle of its outline's bounds, as a file stores them beside the outline.

    object_pose: poses of `object_centre` [m], shape [pose, 7]; vertices: of the outline as placed [m].
    """
    shift = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64).mean(axis=0) - object_centre
    if not shift.any():
        return object_pose
    out = np.array(object_pose, np.float64)
    out[:, :3] += rotate(out[:, 3:], shift)
    return out.astype(np.float32)


def object_poses(object_pose: HandMotion | np.ndarray, motion: HandMotion | np.ndarray) -> np.ndarray:
    """The object's pose at each pose of the hand, float32, shape [pose, 7], interpolated linearly in time.

    object_pose: the object's motion (position: of the middle of its placed bounds), or one pose for each hand pose.
    Before its first and after its last pose the object keeps that pose for one of its own intervals, at most 0.1 s.
    Raises PoseError where numbers of poses differ, times are missing, or the hand's times reach farther than that.
    """
    time = motion.time if isinstance(motion, HandMotion) else None
    if not isinstance(object_pose, HandMotion):
        object_pose = HandMotion(None, np.asarray(object_pose))
    if len(object_pose) == 1:
        return np.repeat(object_pose.pose, len(motion), axis=0)
    if object_pose.time is None or time is None or not isinstance(motion, HandMotion):
        if len(object_pose) != len(motion):
            raise PoseError(
                f"the object has {len(object_pose)} poses, the hand {len(motion)}: give both times, or as many poses"
            )
        return object_pose.pose
    own = object_pose.time + (object_pose.offset - motion.offset)
    edge = 1e-6 + min(float(np.median(np.diff(own))), EDGE_MOST)
    if time[0] < own[0] - edge or time[-1] > own[-1] + edge:
        raise PoseError(
            f"the object's motion lasts from {own[0]:g} to {own[-1]:g} s of the hand's time, "
            f"the hand's from {time[0]:g} to {time[-1]:g} s"
        )
    return between(own, object_pose.pose.astype(np.float64), np.clip(time, own[0], own[-1]))


def between(own: np.ndarray, pose: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Poses at other times: positions linear, rotations along the shorter arc; float32, shape [time, 7]."""
    k = np.clip(np.searchsorted(own, time, side="right") - 1, 0, len(own) - 2)
    share = ((time - own[k]) / (own[k + 1] - own[k]))[:, None]
    position = pose[k, :3] + share * (pose[k + 1, :3] - pose[k, :3])
    return np.concatenate([position, slerp(pose[k, 3:], pose[k + 1, 3:], share)], axis=1).astype(np.float32)
