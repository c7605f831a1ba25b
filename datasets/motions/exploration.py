"""The exploration around an object: where a palm goes that feels, from every side, what it knows the bounds of."""

import numpy as np
from numpy.typing import NDArray

from .exploration_draws import INTERVAL
from .exploration_strokes import ControlPoints, Progress, control_points, unheard
from .rotation_vectors import conjugate, exponential, logarithm, product

Array = NDArray[np.float64]

VERSION = 1
"""Of the model: another version makes other poses of the same numbers."""
_BLOCK = 1 << 16  # poses evaluated at once: bounds the memory of long motions


def exploration_path(bounds: Array, time: Array, seed: int, progress: Progress = unheard) -> Array:
    """Poses at the given times [s] of the exploration that `bounds` ([2, 3] [m]) and `seed` define; shape [pose, 7].

    progress: called now and then with how many control points are drawn, and how many there will be.

    The model. A person feels an object in visits. Each visit comes from one direction; every eight visits in a row
    take the eight octants in random order, at random inside the octant. Fingers point away from the user (+y), or up
    where the hand comes from the front or the back. A visit is a series of strokes: around the object to a stand-off;
    on to the surface of the box; two to four sweeps to random depths, from just outside to beyond the middle (nothing
    resists), half of them followed by lingering of 0.2 to 0.7 s; a little back. The skin faces the way the hand came
    from the object, tilted and turned anew for each stroke. A stroke has a log-normal mean speed and the minimum-jerk
    profile of human reaching (Flash and Hogan 1985); tremor is added.

    The path is the uniform cubic B-spline of the strokes' control points, cumulative for quaternions (Kim, Kim and
    Shin 1995): twice continuously differentiable, inside the convex workspace, and no faster than the control points
    step. Strokes are drawn one after another from one generator, so a later time never changes an earlier pose.
    """
    control = control_points(bounds[None], [seed], [control_count(time[-1])], progress)
    poses = np.empty((len(time), 7))
    for first in range(0, len(time), _BLOCK):
        poses[first : first + _BLOCK] = spline_poses(control, time[first : first + _BLOCK])
    return poses


def control_count(end: float) -> int:
    """Control points that a pose at a time [s] takes, with all before it."""
    return int(end / INTERVAL) + 4


def control_turns(quaternion: Array) -> Array:
    """Rotation vectors from each control point to the next [rad], shape [control - 1, 3]."""
    return logarithm(product(conjugate(quaternion[:-1]), quaternion[1:]))


def spline_poses(control: ControlPoints, time: Array) -> Array:
    """Poses at increasing times [s] of the first exploration, shape [pose, 7]."""
    first = np.floor(time / INTERVAL).astype(np.int64)
    u = (time / INTERVAL - first)[:, None]
    weight = (  # cumulative cubic B-spline basis
        (5.0 + 3.0 * u - 3.0 * u**2 + u**3) / 6.0,
        (1.0 + 3.0 * u + 3.0 * u**2 - 2.0 * u**3) / 6.0,
        u**3 / 6.0,
    )
    position = control.position[first].copy()
    quaternion = control.quaternion[first].copy()
    near = slice(first[0], first[-1] + 4)  # many poses share the steps between these
    move = np.diff(control.position[near], axis=0)
    turn = control_turns(control.quaternion[near])
    first -= first[0]
    for step in range(3):
        position += weight[step] * move[first + step]
        quaternion = product(quaternion, exponential(weight[step] * turn[first + step]))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.hstack([position, quaternion])
