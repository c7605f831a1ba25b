"""Explorations over an array, of many motions at once: how a person's palm wanders in front of it, whatever is there.

A trial is a person's (`explorer`) and has a number (`seed`). It is a series of visits; a visit enters the workspace at
one of its sides or from above, and goes on through waypoints that are uniform in the workspace. A stroke leads from one
waypoint to the next on a straight line with the minimum-jerk profile of human reaching (Flash and Hogan 1985), and may
end with a pause. Position and orientation sway a little all the time.

| what | distribution | bounds from clips |
|---|---|---|
| pitch, roll of a waypoint | person's mean; deviations 6, 4.5 degrees | HandSplay, grab: 6.1, 6.0; 4.7, 4.4 |
| yaw of a waypoint | person's mean; deviation 6 degrees | the same: 8.0, 4.4 |
| mean speed of a stroke | person's; deviation a quarter; in 0.03 to 0.4 m/s | at most 0.87 m/s; the peak here is 0.75 |
| turning | mean of a stroke at most 1.6 rad/s, peak 3 | HandSplay 3.0 at most, rollAndPitch 7.2 |
| pauses | after the person's share of strokes, 0.2 to 0.7 s | slower than 0.03 m/s 1 to 56 % of the time |
| sway | two sines an axis, 0.6 mm each, 0.4 to 1 Hz | HandSplay, held still: median 23 mm/s |

The clips are four recordings of gestures, no explorations (`explorer_habits`), smoothed over 5 frames, about 45 ms.
Their pitch has means of 9 to 41 degrees, as fingers point up over a controller on a table; palms over an array are down
(figure 5A of the founding paper), so the mean over persons is 0 here.

Every number is drawn by a counter (key explorer and seed, counter visit, stroke, draw) with Philox4x64-10 of Salmon et
al., "Parallel random numbers: as easy as 1, 2, 3" (2011), so any can be made without those before it. Durations are
whole milliseconds: when a stroke begins is a sum of integers. All else is + - * / and square roots of float64, so CPUs
and GPUs make the same bits.

One thread a motion counts its strokes, then writes them; one thread a pose finds its stroke by bisection.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK, scan_counts
from ..patch import SELDOM, to_float32
from .portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns

wp.set_module_options(SELDOM)

# What a counter's third word means; the fourth is 1 for draws of no visit.
PLACE, PITCH, ROLL, YAW, SPEED, PAUSE, VISIT = (wp.constant(k) for k in range(7))
# Standard deviations of angles [rad], and other numbers of the table above.
PITCH_SD, ROLL_SD, YAW_SD = (wp.constant(wp.float64(np.radians(degrees))) for degrees in (6.0, 4.5, 6.0))
WAYPOINTS_LEAST, WAYPOINTS_RANGE = wp.constant(3), wp.constant(wp.float64(4.0))  # of a visit, the entrance left out
PREFERENCE = wp.constant(wp.float64(0.5))  # share of the visits that enter at the preferred side
SPEED_SPREAD, TURN_SPEED = wp.constant(wp.float64(0.25)), wp.constant(wp.float64(1.6))
STROKE_SLOWEST, STROKE_FASTEST = wp.constant(wp.float64(0.03)), wp.constant(wp.float64(0.4))  # [m/s]
STROKE_SHORTEST = wp.constant(wp.float64(0.3))  # [s]
PAUSE_LEAST, PAUSE_RANGE = wp.constant(wp.float64(0.2)), wp.constant(wp.float64(0.7 - 0.2))  # [s]
SWAY, SWAY_SPACE = wp.constant(wp.float64(0.0006)), 0.0013  # [m]; waypoints stay so far from the workspace's sides
SWAY_RATE_LEAST, SWAY_RATE_RANGE = wp.constant(wp.float64(0.4)), wp.constant(wp.float64(1.0 - 0.4))  # [Hz]
KNEE, ROOM = wp.constant(wp.float64(0.8)), wp.constant(wp.float64(1.0 - 0.8))  # shares of the facing limit
ZERO, HALF, ONE, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 0.5, 1.0, 2.0))
FOUR, SIX, TEN, FIFTEEN = (wp.constant(wp.float64(value)) for value in (4.0, 6.0, 10.0, 15.0))
PI = wp.constant(wp.float64(np.pi))
MILLISECONDS = wp.constant(wp.float64(1e3))
NEARLY_ZERO = wp.constant(wp.float64(1e-12))

# Of Philox.
ROUNDS = wp.constant(10)
MULTIPLIER_A, MULTIPLIER_C = wp.constant(wp.uint64(0xD2E7470EE14C6C93)), wp.constant(wp.uint64(0xCA5A826395121157))
STEP_A, STEP_C = wp.constant(wp.uint64(0x9E3779B97F4A7C15)), wp.constant(wp.uint64(0xBB67AE8584CAA73B))
WORD_HALF = wp.constant(wp.uint64(32))
LOW_HALF = wp.constant(wp.uint64(0xFFFFFFFF))
UNIT = wp.constant(wp.float64(2.0**-53))
ROOT_OF_3 = wp.constant(wp.float64(3.0**0.5))

vec2ul: Any = wp.types.vector(length=2, dtype=wp.uint64)


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
    """Strokes of all motions, one motion after the other; last of each, the waypoint at which no stroke begins."""

    start: wp.array[wp.int64]  # first stroke of each motion, shape [motion + 1]
    position: wp.array[wp.vec3d]  # of the waypoint at which the stroke begins [m], shape [stroke]
    angles: wp.array[wp.vec3d]  # yaw, pitch, roll there [rad]
    begin: wp.array[wp.int64]  # when it begins [ms]
    moving: wp.array[wp.int64]  # how long it moves [ms]
    sway: wp.array2d[wp.vec2d]  # frequency [Hz] and phase [turn] of six sines, shape [motion, 6]


@wp.func
def high_product(x: wp.uint64, y: wp.uint64):
    """The high word of a product of 128 bits."""
    x_high = x >> WORD_HALF
    x_low = x & LOW_HALF
    y_high = y >> WORD_HALF
    y_low = y & LOW_HALF
    one = y_high * x_low
    two = y_low * x_high
    middle = ((y_low * x_low) >> WORD_HALF) + (one & LOW_HALF) + (two & LOW_HALF)
    return y_high * x_high + (one >> WORD_HALF) + (two >> WORD_HALF) + (middle >> WORD_HALF)


@wp.func
def uniform_of(word: wp.uint64):
    """A multiple of 2^-53 in 0..1, 1 left out."""
    return wp.float64(word >> wp.uint64(11)) * UNIT


@wp.func
def uniform(key: vec2ul, first: wp.int64, second: int, third: int, fourth: int):
    """Four numbers of a key and a counter."""
    a = wp.uint64(first)
    b = wp.uint64(second)
    c = wp.uint64(third)
    d = wp.uint64(fourth)
    key_a = key[0]
    key_c = key[1]
    for _turn in range(ROUNDS):
        high_a = high_product(MULTIPLIER_A, a)
        high_c = high_product(MULTIPLIER_C, c)
        low_a = MULTIPLIER_A * a
        low_c = MULTIPLIER_C * c
        a = high_c ^ b ^ key_a
        b = low_c
        c = high_a ^ d ^ key_c
        d = low_a
        key_a = key_a + STEP_A
        key_c = key_c + STEP_C
    return wp.vec4d(uniform_of(a), uniform_of(b), uniform_of(c), uniform_of(d))


@wp.func
def bell(key: vec2ul, first: wp.int64, second: int, third: int):
    """A number of mean 0 and standard deviation 0.97, nearly normal, within -2..2."""
    u = uniform(key, first, second, third, 0)
    sum = ((u[0] + u[1]) + u[2]) + u[3]
    return wp.clamp((sum - wp.float64(2.0)) * ROOT_OF_3, wp.float64(-2.0), wp.float64(2.0))


@wp.func
def stroke_count(trial: ExplorerMotion, visit: wp.int64):
    """Number of strokes of a visit, the one to the next visit's entrance included."""
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
    """How long a stroke moves and then rests [ms]; step: to its end [m]; turn: change of its angles [rad]."""
    speed = trial.speed * (ONE + SPEED_SPREAD * bell(trial.key, visit, stroke, SPEED))
    angle = (wp.abs(turn[0]) + wp.abs(turn[1])) + wp.abs(turn[2])
    seconds = wp.max(wp.length(step) / wp.clamp(speed, STROKE_SLOWEST, STROKE_FASTEST), angle / TURN_SPEED)
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
    count: wp.array[wp.int64],  # strokes of each motion, its last waypoint included
    strokes: HandStrokes,
):
    """Count a motion's strokes up to its last pose, or write them."""
    motion = wp.tid()
    trial = trials[motion]
    end = MILLISECONDS * (wp.float64(trial.stop) / trial.rate) + ONE  # [ms]; a rounding later does no harm
    at = wp.int64(0)
    if writes:
        at = strokes.start[motion]
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
            strokes.position[at] = position
            strokes.angles[at] = angles
            strokes.begin[at] = clock
            strokes.moving[at] = moving
        at += wp.int64(1)
        clock += moving + pause
        visit = following
        stroke = number
        if number == 0:
            stop = stroke_count(trial, visit)
        position = goal
        angles = turned
    if writes:  # the last waypoint: no stroke begins there
        strokes.position[at] = position
        strokes.angles[at] = angles
        strokes.begin[at] = clock
        strokes.moving[at] = wp.int64(1)
    else:
        count[motion] = at + wp.int64(1)


@wp.func
def faced(position: wp.vec3d, q: wp.vec4d, limit: wp.float64):
    """A quaternion xyzw turned towards the array where the facing angle nears the limit, which none then reaches."""
    axis = wp.vec3d(q[0], q[1], q[2])
    normal = wp.vec3d(ZERO, -ONE, ZERO)  # of the palm, before it turns
    turned = wp.cross(axis, normal)
    skin = normal + TWO * (q[3] * turned + wp.cross(axis, turned))
    out = wp.cross(position, skin)
    across = wp.length(out)
    angle = arc_tangent(across, -wp.dot(skin, position))
    if angle <= KNEE * limit:
        return q
    beyond = angle - KNEE * limit
    room = ROOM * limit
    pair = sine_cosine(HALF * (beyond - room * hyperbolic_tangent(beyond / room)))
    u = pair[0] * (out / wp.max(across, NEARLY_ZERO))
    vector = (pair[1] * axis + q[3] * u) + wp.cross(u, axis)
    return wp.vec4d(vector[0], vector[1], vector[2], pair[1] * q[3] - wp.dot(u, axis))


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
    first: wp.int64,  # of the poses that are placed
    pose: wp.array[wp.transform],
):
    """Place a palm on its stroke, with the minimum-jerk profile."""
    i = first + wp.int64(wp.tid())
    motion = int(wp.lower_bound(pose_start, i + wp.int64(1))) - 1
    trial = trials[motion]
    t = wp.float64(trial.first + (i - pose_start[motion])) / trial.rate
    at = stroke_at(strokes, motion, t)
    duration = wp.float64(strokes.moving[at]) / MILLISECONDS
    s = wp.clamp((t - wp.float64(strokes.begin[at]) / MILLISECONDS) / duration, ZERO, ONE)
    s = s * s * s * (TEN - FIFTEEN * s + SIX * s * s)
    start = strokes.position[at]
    from_angles = strokes.angles[at]
    sway = wp.vec3d()  # how far a hand that means to be still is from where it means to be [m]
    for wave in range(6):
        sine = strokes.sway[motion, wave]
        sway[wave % 3] = sway[wave % 3] + SWAY * sine_of_turns(sine[0] * t + sine[1])
    position = (start + s * (strokes.position[at + wp.int64(1)] - start)) + sway
    angles = from_angles + s * (strokes.angles[at + wp.int64(1)] - from_angles)
    lean = sine_cosine(PI / FOUR + angles[1] / TWO)
    summed = sine_cosine((angles[0] + angles[2]) / TWO)
    apart = sine_cosine((angles[0] - angles[2]) / TWO)
    q = wp.vec4d(lean[0] * apart[1], lean[0] * apart[0], lean[1] * summed[0], lean[1] * summed[1])
    q = faced(position, q, trial.facing)
    turn = wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3]))
    pose[i] = wp.transform(to_float32(position), turn)


POSES_A_REPORT = 1 << 20  # a third of a second
FIELDS = ("speed", "pause_share", "side", "facing", "rate", "first", "stop")


def trials_of(given: Sequence[Mapping[str, Any]]) -> np.ndarray:
    """Trials as `place_explorers` takes them, a structured array, shape [motion].

    Of each: explorer and seed; habits of the person: yaw, pitch, roll [rad], speed [m/s], pause_share, and side, 0 to 3
    for above, front, left and right; workspace: lowest and highest place of the palm's centre [m], shape [2, 3];
    facing: largest facing angle [rad]; rate of poses [Hz]; first and stop: numbers of the poses to be made.
    """
    out = np.zeros(len(given), ExplorerMotion.numpy_dtype())
    for k, trial in enumerate(given):
        out["key"][k] = trial["explorer"], trial["seed"]
        out["angles"][k] = trial["yaw"], trial["pitch"], trial["roll"]
        low, high = np.asarray(trial["workspace"], np.float64)
        out["low"][k], out["high"][k] = low + SWAY_SPACE, high - SWAY_SPACE
        for name in FIELDS:
            out[name][k] = trial[name]
    return out


def place_explorers(trials: np.ndarray, *, device: str, report: Callable[[int, int], None] | None = None) -> wp.array:
    """Poses of trials (`trials_of`), one motion after the other, wp.transform, shape [pose].

    report: called now and then with how many poses are made on a CPU, and how many there will be.
    Raises ValueError for a rate that is not above 0, and for numbers of poses that are not 0 <= first <= stop.
    """
    first, stop, rate = trials["first"], trials["stop"], trials["rate"]
    if not ((first >= 0) & (stop >= first) & (rate > 0.0)).all():  # a NaN compares false
        raise ValueError(
            "trials: the rate must be above 0, and poses first..stop must be in this order and not negative"
        )
    start = np.concatenate([np.zeros(1, np.int64), np.cumsum(stop - first)])
    given = wp.array(trials, dtype=ExplorerMotion, device=device)
    strokes: Any = HandStrokes()
    motions = len(trials)
    lengths = wp.zeros(motions + 1, dtype=wp.int64, device=device)
    strokes.sway = wp.empty((motions, 6), dtype=wp.vec2d, device=device)
    wp.launch(_walk_strokes, motions, inputs=[given, False, lengths, strokes], device=device, block_dim=BLOCK)
    (strokes.start,), (total,) = scan_counts(lengths)
    for name, dtype in (("position", wp.vec3d), ("angles", wp.vec3d), ("begin", wp.int64), ("moving", wp.int64)):
        setattr(strokes, name, wp.empty(total, dtype=dtype, device=device))
    wp.launch(_walk_strokes, motions, inputs=[given, True, lengths, strokes], device=device, block_dim=BLOCK)
    pose = wp.empty(int(start[-1]), dtype=wp.transform, device=device)
    count, starts = pose.shape[0], wp.array(start, dtype=wp.int64, device=device)
    step = max(1, count if report is None else POSES_A_REPORT)
    for begin in range(0, count, step):
        stop, inputs = min(begin + step, count), [given, strokes, starts, begin]
        wp.launch(_place_explorers, stop - begin, inputs=inputs, outputs=[pose], device=device, block_dim=BLOCK)
        if report is not None:
            report(stop, count)
    return pose
