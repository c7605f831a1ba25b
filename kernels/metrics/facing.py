"""Whether palms face the array: rows of metrics, 1 within an angle and 0 beyond it, NaN where nothing is drawn."""

import math
from collections.abc import Sequence

import warp as wp

from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float64

wp.set_module_options(EXACT)

NAN = wp.constant(wp.float32(float("nan")))


@wp.kernel
def _count_facing(
    # In:
    pose: wp.array[wp.transform],  # hand frame -> array frame
    drawn: wp.array[wp.float32],  # length of contours [m]
    cosine: wp.float64,  # of the angle
    # Out:
    facing: wp.array[wp.float32],
):
    """Compare the angle between the skin's normal and the direction to the array's centre by its cosine."""
    row = wp.tid()
    if not (drawn[row] > 0.0):
        facing[row] = NAN
        return
    position = to_float64(wp.transform_get_translation(pose[row]))
    q = wp.transform_get_rotation(pose[row])
    x = wp.float64(q[0])
    y = wp.float64(q[1])
    z = wp.float64(q[2])
    w = wp.float64(q[3])
    two = wp.float64(2.0)
    # The hand's -y, on which its skin lies.
    skin = wp.vec3d(two * (w * z - x * y), two * (x * x + z * z) - wp.float64(1.0), -two * (y * z + w * x))
    along = -wp.dot(skin, position)
    facing[row] = wp.float32(wp.where(along >= cosine * wp.length(position), 1.0, 0.0))


@on_one_device
def count_facing(pose: wp.array, drawn: wp.array, degrees: Sequence[float], out: wp.array) -> None:
    """Write a row for each angle: 1 where a palm that draws faces the array's centre within it, 0 beyond, else NaN.

    pose: wp.transform [pose], hand frame -> array frame; the skin faces -y of the hand. drawn: length of the pose's
    contours [m], float32 [pose]. degrees: angles. out: float32, shape [angle, pose].
    """
    for row, angle in enumerate(degrees):
        inputs = [pose, drawn, wp.float64(math.cos(math.radians(angle)))]
        launch(_count_facing, len(pose), inputs, [out[row]])
