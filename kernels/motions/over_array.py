"""Explorations over an array, of many motions at once: the model of datasets/motions/over_array.py, to the bit.

A motion is a series of strokes between waypoints. One thread a motion counts its strokes, then writes them; one thread
a pose finds its stroke by bisection. The tests compare every bit with the model in NumPy.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK, scan_counts
from ..patch import EXACT, to_float32
from .counter_random import bell, uniform, vec2ul
from .portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns

wp.set_module_options(EXACT)

# What a counter's third word means, and the standard deviations of angles [rad], as in the model.
PLACE, PITCH, ROLL, YAW, SPEED, PAUSE, VISIT = (wp.constant(k) for k in range(7))
PITCH_SD, ROLL_SD, YAW_SD = (wp.constant(wp.float64(np.radians(degrees))) for degrees in (6.0, 4.5, 6.0))
WAYPOINTS_LEAST, WAYPOINTS_RANGE = wp.constant(3), wp.constant(wp.float64(4.0))
PREFERENCE, SPEED_SPREAD, TURN_SPEED = (wp.constant(wp.float64(value)) for value in (0.5, 0.25, 1.6))
STROKE_SLOWEST, STROKE_FASTEST = wp.constant(wp.float64(0.03)), wp.constant(wp.float64(0.4))  # [m/s]
STROKE_SHORTEST = wp.constant(wp.float64(0.3))  # [s]
PAUSE_LEAST, PAUSE_RANGE = wp.constant(wp.float64(0.2)), wp.constant(wp.float64(0.7 - 0.2))  # [s]
SWAY, SWAY_SPACE = wp.constant(wp.float64(0.0006)), 0.0013  # [m]
SWAY_RATE_LEAST, SWAY_RATE_RANGE = wp.constant(wp.float64(0.4)), wp.constant(wp.float64(1.0 - 0.4))  # [Hz]
KNEE, ROOM = wp.constant(wp.float64(0.8)), wp.constant(wp.float64(1.0 - 0.8))  # shares of the facing limit
ZERO, HALF, ONE, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 0.5, 1.0, 2.0))
FOUR, SIX, TEN, FIFTEEN = (wp.constant(wp.float64(value)) for value in (4.0, 6.0, 10.0, 15.0))
PI = wp.constant(wp.float64(np.pi))
MILLISECONDS = wp.constant(wp.float64(1e3))
NEARLY_ZERO = wp.constant(wp.float64(1e-12))


@wp.struct
class ExplorerMotion:
    """One person's trial."""

    key: vec2ul  # explorer and seed
    angles: wp.vec3d  # the person's mean yaw, pitch and roll [rad]
    speed: wp.float64  # of a mean stroke [m/s]
    pause_share: wp.float64
    side: wp.int32  # preferred side: 0 above, 1 front, 2 left, 3 right
    low: wp.vec3d  # lowest place of waypoints [m]
    high: wp.vec3d  # highest [m]
    facing: wp.float64  # largest facing angle [rad]
    rate: wp.float64  # of poses [Hz]; pose k is at time k / rate
    first: wp.int64  # of the poses that are made
    stop: wp.int64  # after the last of them


@wp.struct
class HandStrokes:
    """HandStrokes of all motions; a motion has one waypoint more than strokes, its last row."""

    start: wp.array[wp.int64]  # first row of each motion, shape [motion + 1]
    position: wp.array[wp.vec3d]  # of the waypoint at which the stroke begins [m], shape [row]
    angles: wp.array[wp.vec3d]  # yaw, pitch, roll there [rad]
    begin: wp.array[wp.int64]  # when it begins [ms]
    moving: wp.array[wp.int64]  # how long it moves [ms]
    sway: wp.array2d[wp.vec2d]  # frequency [Hz] and phase [turn] of six sines, shape [motion, 6]


@wp.func
def stroke_count(trial: ExplorerMotion, visit: wp.int64):
    """HandStrokes of a visit, the one to the next visit's entrance included."""
    u = uniform(trial.key, visit, 0, VISIT, 0)
    return WAYPOINTS_LEAST + 1 + int(u[0] * WAYPOINTS_RANGE)


@wp.func
def entrance(trial: ExplorerMotion, visit: wp.int64, share: wp.vec3d):
    """A place, as shares of the workspace, moved to the side at which a visit enters."""
    u = uniform(trial.key, visit, 0, VISIT, 0)
    side = int(trial.side)
    if u[1] >= PREFERENCE:
        side = (side + 1 + int(u[2] * wp.float64(3.0))) % 4
    if side == 0:
        return wp.vec3d(share[0], share[1], ONE)
    if side == 1:
        return wp.vec3d(share[0], ZERO, share[2])
    if side == 2:
        return wp.vec3d(ZERO, share[1], share[2])
    return wp.vec3d(ONE, share[1], share[2])


@wp.func
def place_of(trial: ExplorerMotion, visit: wp.int64, number: int):
    """Position of a waypoint [m]; number 0 is where the visit enters."""
    u = uniform(trial.key, visit, number, PLACE, 0)
    share = wp.vec3d(u[0], u[1], u[2])
    if number == 0:
        share = entrance(trial, visit, share)
    return trial.low + wp.cw_mul(share, trial.high - trial.low)


@wp.func
def angles_of(trial: ExplorerMotion, visit: wp.int64, number: int):
    """Yaw, pitch and roll at a waypoint [rad]."""
    return wp.vec3d(
        trial.angles[0] + YAW_SD * bell(trial.key, visit, number, YAW),
        trial.angles[1] + PITCH_SD * bell(trial.key, visit, number, PITCH),
        trial.angles[2] + ROLL_SD * bell(trial.key, visit, number, ROLL),
    )


@wp.func
def duration_of(trial: ExplorerMotion, visit: wp.int64, stroke: int, step: wp.vec3d, turn: wp.vec3d):
    """How long a stroke moves and how long it then rests [ms]; step: its way [m]; turn: how its angles change [rad]."""
    speed = trial.speed * (ONE + SPEED_SPREAD * bell(trial.key, visit, stroke, SPEED))
    length = wp.sqrt((step[0] * step[0] + step[1] * step[1]) + step[2] * step[2])
    angle = (wp.abs(turn[0]) + wp.abs(turn[1])) + wp.abs(turn[2])
    seconds = wp.max(length / wp.clamp(speed, STROKE_SLOWEST, STROKE_FASTEST), angle / TURN_SPEED)
    u = uniform(trial.key, visit, stroke, PAUSE, 0)
    pause = ZERO
    if u[0] < trial.pause_share:
        pause = PAUSE_LEAST + PAUSE_RANGE * u[1]
    moving = wp.ceil(MILLISECONDS * wp.max(seconds, STROKE_SHORTEST))
    return wp.int64(moving), wp.int64(wp.rint(MILLISECONDS * pause))


@wp.kernel
def _walk_strokes(
    trials: wp.array[ExplorerMotion],
    writes: bool,
    count: wp.array[wp.int64],  # rows of each motion
    strokes: HandStrokes,
):
    """Count the rows of a motion's strokes up to its last pose, or write them."""
    motion = wp.tid()
    trial = trials[motion]
    end = MILLISECONDS * (wp.float64(trial.stop) / trial.rate) + ONE  # [ms]; a rounding later does no harm
    row = wp.int64(0)
    if writes:
        row = strokes.start[motion]
        for wave in range(6):
            u = uniform(trial.key, wp.int64(wave), 0, 0, 1)
            strokes.sway[motion, wave] = wp.vec2d(SWAY_RATE_LEAST + SWAY_RATE_RANGE * u[0], u[1])
    clock = wp.int64(0)
    visit = wp.int64(0)
    stroke = int(0)
    stop = stroke_count(trial, visit)
    position = place_of(trial, visit, 0)
    angles = angles_of(trial, visit, 0)
    while wp.float64(clock) <= end:
        following = visit
        number = stroke + 1
        if number == stop:
            following = visit + wp.int64(1)
            number = 0
        goal = place_of(trial, following, number)
        turned = angles_of(trial, following, number)
        moving, pause = duration_of(trial, visit, stroke, goal - position, turned - angles)
        if writes:
            strokes.position[row] = position
            strokes.angles[row] = angles
            strokes.begin[row] = clock
            strokes.moving[row] = moving
        row += wp.int64(1)
        clock += moving + pause
        visit = following
        stroke = number
        if number == 0:
            stop = stroke_count(trial, visit)
        position = goal
        angles = turned
    if writes:  # the last waypoint: no stroke begins there
        strokes.position[row] = position
        strokes.angles[row] = angles
        strokes.begin[row] = clock
        strokes.moving[row] = wp.int64(1)
    else:
        count[motion] = row + wp.int64(1)


@wp.func
def crossed(u: wp.vec3d, v: wp.vec3d):
    """Cross product, by the operations of np.cross."""
    return wp.vec3d(u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@wp.func
def faced(position: wp.vec3d, q: wp.vec4d, limit: wp.float64):
    """A quaternion xyzw turned towards the array where the facing angle nears the limit, which none then reaches."""
    axis = wp.vec3d(q[0], q[1], q[2])
    normal = wp.vec3d(ZERO, -ONE, ZERO)  # of the palm, before it turns
    turned = crossed(axis, normal)
    skin = normal + TWO * (q[3] * turned + crossed(axis, turned))
    out = crossed(position, skin)
    across = wp.sqrt((out[0] * out[0] + out[1] * out[1]) + out[2] * out[2])
    along = -((skin[0] * position[0] + skin[1] * position[1]) + skin[2] * position[2])
    angle = arc_tangent(across, along)
    if angle <= KNEE * limit:
        return q
    beyond = angle - KNEE * limit
    room = ROOM * limit
    pair = sine_cosine(HALF * (beyond - room * hyperbolic_tangent(beyond / room)))
    larger = wp.max(across, NEARLY_ZERO)
    u = wp.vec3d(pair[0] * (out[0] / larger), pair[0] * (out[1] / larger), pair[0] * (out[2] / larger))
    both = crossed(u, axis)
    s = pair[1]
    t = q[3]
    vector = (s * axis + t * u) + both
    scalar = s * t - ((u[0] * axis[0] + u[1] * axis[1]) + u[2] * axis[2])
    return wp.vec4d(vector[0], vector[1], vector[2], scalar)


@wp.func
def stroke_at(strokes: HandStrokes, motion: int, time: wp.float64):
    """The last stroke of a motion that has begun at a time [s]."""
    low = strokes.start[motion]
    high = strokes.start[motion + 1] - wp.int64(1)
    while high - low > wp.int64(1):
        middle = (low + high) // wp.int64(2)
        if wp.float64(strokes.begin[middle]) / MILLISECONDS <= time:
            low = middle
        else:
            high = middle
    return low


@wp.kernel
def _place_explorers(
    trials: wp.array[ExplorerMotion],
    strokes: HandStrokes,
    pose_start: wp.array[wp.int64],  # of each motion, shape [motion + 1]
    pose: wp.array[wp.transform],
):
    """Place a palm on its stroke, with the minimum-jerk profile."""
    i = wp.int64(wp.tid())
    motion = int(wp.lower_bound(pose_start, i + wp.int64(1))) - 1
    trial = trials[motion]
    t = wp.float64(trial.first + (i - pose_start[motion])) / trial.rate
    row = stroke_at(strokes, motion, t)
    took = wp.float64(strokes.moving[row]) / MILLISECONDS
    s = wp.clamp((t - wp.float64(strokes.begin[row]) / MILLISECONDS) / took, ZERO, ONE)
    s = s * s * s * (TEN - FIFTEEN * s + SIX * s * s)
    start = strokes.position[row]
    from_angles = strokes.angles[row]
    sway = wp.vec3d()  # how far a hand that means to be still is from where it means to be [m]
    for wave in range(6):
        sine = strokes.sway[motion, wave]
        sway[wave % 3] = sway[wave % 3] + SWAY * sine_of_turns(sine[0] * t + sine[1])
    position = (start + s * (strokes.position[row + wp.int64(1)] - start)) + sway
    angles = from_angles + s * (strokes.angles[row + wp.int64(1)] - from_angles)
    lean = sine_cosine(PI / FOUR + angles[1] / TWO)
    summed = sine_cosine((angles[0] + angles[2]) / TWO)
    apart = sine_cosine((angles[0] - angles[2]) / TWO)
    q = wp.vec4d(lean[0] * apart[1], lean[0] * apart[0], lean[1] * summed[0], lean[1] * summed[1])
    q = faced(position, q, trial.facing)
    turn = wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3]))
    pose[i] = wp.transform(to_float32(position), turn)


FIELDS = ("speed", "pause_share", "side", "facing", "rate", "first", "stop")


def trials_of(rows: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """Trials as `place_explorers` takes them, a structured array, shape [motion].

    Of each: explorer and seed; habits of the person: yaw, pitch, roll [rad], speed [m/s], pause_share, and side, 0 to 3
    for above, front, left and right; workspace: lowest and highest place of the palm's centre [m], shape [2, 3];
    facing: largest facing angle [rad]; rate of poses [Hz]; first and stop: numbers of the poses to be made.
    """
    out = np.zeros(len(rows), ExplorerMotion.numpy_dtype())
    for k, row in enumerate(rows):
        out["key"][k] = row["explorer"], row["seed"]
        out["angles"][k] = row["yaw"], row["pitch"], row["roll"]
        low, high = np.asarray(row["workspace"], np.float64)
        out["low"][k], out["high"][k] = low + SWAY_SPACE, high - SWAY_SPACE
        for name in FIELDS:
            out[name][k] = row[name]
    return out


def place_explorers(trials: np.ndarray, *, device: str) -> wp.array:
    """Poses of trials (`trials_of`), one motion after the other, wp.transform, shape [pose].

    Raises ValueError for a rate that is not above 0, and for numbers of poses that are not 0 <= first <= stop.
    """
    first, stop, rate = trials["first"], trials["stop"], trials["rate"]
    if not ((first >= 0) & (stop >= first) & (rate > 0.0)).all():  # a NaN compares false
        raise ValueError(
            "trials: the rate must be above 0, and poses first..stop must be in this order and not negative"
        )
    start = np.concatenate([np.zeros(1, np.int64), np.cumsum(stop - first)])
    given = wp.array(trials, dtype=ExplorerMotion, device=device)
    strokes = strokes_of(given)
    pose = wp.empty(int(start[-1]), dtype=wp.transform, device=device)
    inputs = [given, strokes, wp.array(start, dtype=wp.int64, device=device)]
    wp.launch(_place_explorers, pose.shape[0], inputs=inputs, outputs=[pose], device=device, block_dim=BLOCK)
    return pose


def strokes_of(trials: wp.array) -> Any:
    """The strokes of each motion up to its last pose."""
    strokes, count, device = HandStrokes(), trials.shape[0], trials.device
    rows = wp.zeros(count + 1, dtype=wp.int64, device=device)
    strokes.sway = wp.empty((count, 6), dtype=wp.vec2d, device=device)
    wp.launch(_walk_strokes, count, inputs=[trials, False, rows, strokes], device=device, block_dim=BLOCK)
    (strokes.start,), (total,) = scan_counts(rows)
    for name, dtype in (("position", wp.vec3d), ("angles", wp.vec3d), ("begin", wp.int64), ("moving", wp.int64)):
        setattr(strokes, name, wp.empty(total, dtype=dtype, device=device))
    wp.launch(_walk_strokes, count, inputs=[trials, True, rows, strokes], device=device, block_dim=BLOCK)
    return strokes
