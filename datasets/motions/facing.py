"""The facing angle of a palm: between its skin's normal and the direction from the palm to the array's centre."""

import numpy as np
from numpy.typing import NDArray

from ..rigid import rotate

SHARE_ANGLES = (30, 60)
"""Angles [degree] within which the shares of poses are counted (`facing_share_30`, `facing_share_60`)."""


def facing_angles(pose: NDArray[np.floating]) -> NDArray[np.float64]:
    """Facing angle of poses [rad], shape [pose]: 0 where the skin faces the array's centre, pi where it is turned away.

    pose: x y z [m] and quaternion xyzw, shape [pose, 7], hand frame -> array frame. A palm in the array's centre has
    no direction to it; its angle counts as a right one.
    """
    rows = np.asarray(pose, np.float64)
    skin = rotate(rows[:, 3:], np.broadcast_to([0.0, -1.0, 0.0], (len(rows), 3)))
    along = -(skin * rows[:, :3]).sum(axis=1)
    across: NDArray[np.float64] = np.linalg.norm(np.cross(skin, rows[:, :3]), axis=1)
    return np.where((along == 0.0) & (across == 0.0), np.pi / 2.0, np.arctan2(across, along))
