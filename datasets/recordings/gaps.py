"""Gaps in a recording of joints: held for a while, or bridged when resampled, never for longer than a limit."""

from typing import NamedTuple

import numpy as np

from ..hand_model.joints import JOINT_COUNT, Joint
from ..rigid import Flags, Numbers, is_finite, pose_inverse, pose_product, slerp

_SAME_TIME = 1e-9  # [s]


class HeldJoints(NamedTuple):
    """Result of `hold_joints`."""

    pose: Numbers
    valid: Flags
    held: int
    """Joints held, over all frames."""
    dropped: int
    """Frames that lacked a joint for longer and are absent now."""
    kept: Flags
    """Which of the valid joints are held, now or before."""


def hold_joints(
    time: Numbers | None, pose: Numbers, valid: Flags, before: Flags | None, gap_most: float, *, whole: bool
) -> HeldJoints:
    """Let joints that are missing for at most `gap_most` [s] keep their place in the hand.

    After that they are missing; `whole`: so is the frame, all of it. A joint that no frame has is not missed. Frames
    without a palm stay as they are. before: valid joints that were held already, so not seen; None: none.
    """
    pose, kept = pose.copy(), valid.copy()
    known = valid if before is None else valid & ~before
    present = valid[:, Joint.PALM]
    clock = np.full(len(pose), np.nan) if time is None else time
    for joint in np.flatnonzero(valid.any(axis=0) & ~valid[present].all(axis=0)):
        seen = present & known[:, joint]
        last = np.maximum.accumulate(np.where(seen, np.arange(len(pose)), -1))
        age = clock - clock[np.maximum(last, 0)]
        frame = np.flatnonzero(present & ~valid[:, joint] & (last >= 0) & (age <= gap_most + _SAME_TIME))
        local = pose_product(pose_inverse(pose[last[frame], Joint.PALM]), pose[last[frame], joint])
        pose[frame, joint] = pose_product(pose[frame, Joint.PALM], local)
        kept[frame, joint] = True
    torn = present & ~kept[:, valid.any(axis=0)].all(axis=1) & whole
    held = int(np.count_nonzero(kept[~torn] & ~valid[~torn]))
    kept[torn] = False
    pose[~kept] = np.nan
    return HeldJoints(pose, kept, held, int(np.count_nonzero(torn)), kept & ~known)


def resample_joints(time: Numbers, pose: Numbers, valid: Flags, at: Numbers, gap_most: float) -> tuple[Numbers, Flags]:
    """Joints at other times [s]: positions linear, rotations by slerp, each between the two frames that have the joint.

    Where these are more than `gap_most` [s] apart, and before the first and after the last, the joint is missing.
    """
    out = np.full((len(at), JOINT_COUNT, 7), np.nan)
    for joint in range(JOINT_COUNT):
        seen = np.flatnonzero(valid[:, joint])
        if seen.size == 0:
            continue
        clock = time[seen]
        after = np.searchsorted(clock, at - _SAME_TIME, side="left")
        inside = (after < len(clock)) & ((after > 0) | (at >= clock[0] - _SAME_TIME))
        after = np.minimum(after, len(clock) - 1)
        own = clock[after] <= at + _SAME_TIME  # a frame's own time is that frame, gap or not
        before = np.where(own, after, np.maximum(after - 1, 0))
        span = clock[after] - clock[before]
        inside &= span <= gap_most + _SAME_TIME
        share = np.where(own, 0.0, (at - clock[before]) / np.where(span > 0.0, span, 1.0))[:, None]
        a, b = pose[seen[before], joint], pose[seen[after], joint]
        exact = (share == 0.0)[..., 0]
        row = np.concatenate([a[:, :3] + share * (b[:, :3] - a[:, :3]), slerp(a[:, 3:], b[:, 3:], share)], axis=1)
        row[exact] = a[exact]
        out[inside, joint] = row[inside]
    return out, is_finite(out)
