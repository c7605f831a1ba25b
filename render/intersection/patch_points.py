"""Points that are relative to their patch, and where they lie in the array's frame."""

import numpy as np

from ...datasets.motions.hand_motion import HandMotion
from ..contour_batch import ContourBatch
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from .named_inputs import motion_of


def array_points(batch: ContourBatch, hand: Hand, motion: HandMotion | np.ndarray) -> np.ndarray:
    """Points of contours that were rendered with `points="patch"` in the array's frame [m], float64, shape [point, 3].

    batch: on the host, of all poses of the motion; hand, motion: those it was rendered with. float32 holds a point of a
    patch to 4e-9 m, so the result is as exact as the poses are, however far from the array.
    Raises StrategyError for contours that are not in their patches' planes, PoseError for another number of poses.

    >>> from palpate.render import Palm, array_points, render, static_pose
    >>> palm, motion = Palm(), static_pose([0, 0, 0.2])
    >>> batch = render("cube", palm, motion, points="patch")
    >>> batch.points[0], array_points(batch, palm, motion)[0].round(4)
    (array([-0.0425, -0.0425,  0.    ], dtype=float32), array([-0.0425, -0.0425,  0.2   ]))
    """
    pose = motion_of(motion).pose
    if batch.pose_count != len(pose):
        raise PoseError(f"the contours are of {batch.pose_count} poses, the motion has {len(pose)}")
    if batch.points[:, 2].any():
        raise StrategyError('these contours are in the array\'s frame: render them with points="patch"')
    frames = hand.frames(pose)
    row = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    line = np.repeat(np.arange(batch.polyline_count), np.diff(batch.polyline_start))
    own = row[line], batch.polyline_patch[line]
    x = batch.points.astype(np.float64)
    return frames.origin[own] + x[:, :1] * frames.u[own] + x[:, 1:2] * frames.v[own]
