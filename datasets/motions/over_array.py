"""The exploration over an array: how a person's palm wanders in the space in front of an array, whatever is there.

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

Every number is drawn by a counter (`counter_random`): key explorer and seed, counter visit, stroke, draw. Durations are
whole milliseconds. So a stroke can be made without those before it, and when it begins is a sum of integers.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..rigid import quaternion_product, rotate
from .counter_random import bell, uniform
from .exploration_strokes import Progress
from .explorer_habits import PITCH_SD, PREFERENCE, ROLL_SD, SIDES, YAW_SD, ExplorerHabits
from .portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

VERSION = 1
"""Of the model: another version makes other poses of the same numbers."""
WORKSPACE = ((-0.125, -0.125, 0.135), (0.125, 0.125, 0.325))
"""Where a palm's centre goes unless told otherwise, lowest and highest x y z [m]: the founding paper's 130 mm cube
200 mm above the array, and 60 mm around and above it, the reach of a palm of 85 mm (half its diagonal). A palm that
faces the array touches nothing from below the cube.
"""
FACING = np.radians(60.0)
"""Largest facing angle unless told otherwise [rad]."""
KNEE = 0.8  # from this share of the limit on, facing angles are reduced
SPEED_SPREAD = 0.25  # of strokes, standard deviation as a share of the person's speed
STROKE_SPEED = (0.03, 0.4)  # mean speed of a stroke [m/s]; its peak is 1.875 times that
TURN_SPEED = 1.6  # mean angular speed of a stroke at most [rad/s]
STROKE_SHORTEST = 0.3  # [s]
PAUSES = (0.2, 0.7)  # [s]
WAYPOINTS = (3, 6)  # of a visit, the entrance left out
SWAY, SWAY_RATES = 0.0006, (0.4, 1.0)  # amplitude of one sine [m]; frequencies [Hz]
SWAY_SPACE = 0.0013  # that waypoints keep from the workspace's sides [m]: two sines, and float32's rounding

# What a counter's third word means; the fourth numbers the draws of a trial, 1 for those of no visit.
_PLACE, _PITCH, _ROLL, _YAW, _SPEED, _PAUSE, _VISIT = range(7)
_BLOCK = 1 << 11  # poses evaluated at once: bounds the memory of long motions
_VISITS = 64  # drawn at once, if the time takes so many
_VISIT_SECONDS = 8.0  # that a visit takes, about


@dataclass(frozen=True)
class ExplorerTrial:
    """One trial of one person."""

    explorer: int
    seed: int
    habits: ExplorerHabits
    workspace: Array
    """Lowest and highest x y z of the palm's centre [m], shape [2, 3]."""
    facing: float
    """Largest facing angle [rad]."""

    @property
    def key(self) -> tuple[int, int]:
        """Key of its random numbers."""
        return self.explorer, self.seed


class Waypoints(NamedTuple):
    """Where strokes begin and end."""

    position: Array
    """[m], shape [waypoint, 3]."""
    angles: Array
    """Yaw, pitch and roll [rad], shape [waypoint, 3], before the facing limit."""


class ExplorerStrokes(NamedTuple):
    """Strokes, one a row."""

    start: Waypoints
    goal: Waypoints
    moving: Integers
    """How long each moves [ms]."""
    pause: Integers
    """How long each then rests [ms]."""


def over_array_path(trial: ExplorerTrial, time: Array, progress: Progress) -> Array:
    """Poses of a trial at increasing times from 0 on [s], shape [pose, 7]; progress: poses done, and all."""
    strokes, begins = _strokes_until(trial, float(time[-1]))
    poses = np.empty((len(time), 7))
    for first in range(0, len(time), _BLOCK):
        block = time[first : first + _BLOCK]
        number = np.searchsorted(begins, block, side="right") - 1
        used = slice(number[0], number[-1] + 1)
        start, goal = (Waypoints(*(x[used] for x in end)) for end in (strokes.start, strokes.goal))
        cut = ExplorerStrokes(start, goal, strokes.moving[used], strokes.pause[used])
        poses[first : first + _BLOCK] = _poses(trial, cut, begins[used], number - number[0], block)
        progress(min(first + _BLOCK, len(time)), len(time))
    return poses


def stroke_counts(trial: ExplorerTrial, visit: Integers) -> Integers:
    """How many strokes visits have, the one to the next visit's entrance included, shape [visit]."""
    least, most = WAYPOINTS
    return least + 1 + (uniform(trial.key, visit, 0, _VISIT)[..., 0] * (most - least + 1)).astype(np.int64)


def make_strokes(trial: ExplorerTrial, visit: Integers, stroke: Integers) -> ExplorerStrokes:
    """The strokes of the given numbers, each by itself; stroke k of a visit, from 0, starts at its waypoint k."""
    is_last = stroke == stroke_counts(trial, visit) - 1
    start = make_waypoints(trial, visit, stroke)
    goal = make_waypoints(trial, visit + is_last, np.where(is_last, 0, stroke + 1))
    speed = trial.habits.speed * (1.0 + SPEED_SPREAD * bell(trial.key, visit, stroke, _SPEED))
    step = goal.position - start.position
    length = np.sqrt((step * step).sum(axis=1))
    turn = np.abs(goal.angles - start.angles).sum(axis=1)  # no less than the angle of the whole rotation
    seconds = np.maximum(length / np.clip(speed, *STROKE_SPEED), turn / TURN_SPEED)
    draw = uniform(trial.key, visit, stroke, _PAUSE)
    pause = np.where(draw[:, 0] < trial.habits.pause_share, PAUSES[0] + (PAUSES[1] - PAUSES[0]) * draw[:, 1], 0.0)
    moving = np.ceil(1e3 * np.maximum(seconds, STROKE_SHORTEST)).astype(np.int64)
    return ExplorerStrokes(start, goal, moving, np.rint(1e3 * pause).astype(np.int64))


def make_waypoints(trial: ExplorerTrial, visit: Integers, number: Integers) -> Waypoints:
    """Waypoints of visits; number 0 is where a visit enters."""
    low, high = trial.workspace[0] + SWAY_SPACE, trial.workspace[1] - SWAY_SPACE
    share = uniform(trial.key, visit, number, _PLACE)[:, :3]
    share = np.where((number == 0)[:, None], _entrance(trial, visit, share), share)
    habits, key = trial.habits, trial.key
    angles = [
        habits.yaw + YAW_SD * bell(key, visit, number, _YAW),
        habits.pitch + PITCH_SD * bell(key, visit, number, _PITCH),
        habits.roll + ROLL_SD * bell(key, visit, number, _ROLL),
    ]
    return Waypoints(low + share * (high - low), np.stack(angles, axis=1))


def _entrance(trial: ExplorerTrial, visit: Integers, share: Array) -> Array:
    """Places moved to the side at which a visit enters, as shares of the workspace, shape [visit, 3]."""
    draw = uniform(trial.key, visit, 0, _VISIT)
    preferred = SIDES.index(trial.habits.side)
    other = (preferred + 1 + (draw[:, 2] * (len(SIDES) - 1)).astype(np.int64)) % len(SIDES)
    side = np.where(draw[:, 1] < PREFERENCE, preferred, other)
    out = share.copy()
    for name, axis, value in (("above", 2, 1.0), ("front", 1, 0.0), ("left", 0, 0.0), ("right", 0, 1.0)):
        out[side == SIDES.index(name), axis] = value
    return out


def _strokes_until(trial: ExplorerTrial, end: float) -> tuple[ExplorerStrokes, Array]:
    """All strokes that begin by a time [s], and when they begin [s], shape [stroke]."""
    parts: list[ExplorerStrokes] = []
    lasting: list[Integers] = []
    total = 0
    at_once = min(_VISITS, 2 + int(end / _VISIT_SECONDS))
    for first in range(0, 1 << 62, at_once):
        visit = np.arange(first, first + at_once, dtype=np.int64)
        count = stroke_counts(trial, visit)
        within = np.arange(count.sum(), dtype=np.int64) - np.repeat(np.cumsum(count) - count, count)
        parts.append(make_strokes(trial, np.repeat(visit, count), within))
        lasting.append(parts[-1].moving + parts[-1].pause)
        total += int(lasting[-1].sum())
        if total > 1e3 * end + 1.0:
            break
    begins = np.cumsum(np.concatenate([np.zeros(1, np.int64), *lasting]))[:-1] / 1e3
    starts, goals, moving, pause = zip(*parts, strict=True)
    ends = [Waypoints(*map(np.concatenate, zip(*rows, strict=True))) for rows in (starts, goals)]
    return ExplorerStrokes(ends[0], ends[1], np.concatenate(moving), np.concatenate(pause)), begins


def _poses(trial: ExplorerTrial, strokes: ExplorerStrokes, begins: Array, number: Integers, time: Array) -> Array:
    """Poses at times, each on the stroke of its number, shape [pose, 7]."""
    s = np.clip((time - begins[number]) / (strokes.moving[number] / 1e3), 0.0, 1.0)[:, None]
    s = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)  # minimum jerk
    (start, turned), (goal, turning) = strokes.start, strokes.goal
    position = start[number] + s * (goal - start)[number] + _sway(trial, time)
    yaw, pitch, roll = (turned[number] + s * (turning - turned)[number]).T
    half, sum_half, difference_half = np.pi / 4.0 + pitch / 2.0, (yaw + roll) / 2.0, (yaw - roll) / 2.0
    (sine, cosine), summed, difference = map(sine_cosine, (half, sum_half, difference_half))
    # z by yaw, x by a right angle and the pitch, z by roll
    columns = [sine * difference[1], sine * difference[0], cosine * summed[0], cosine * summed[1]]
    return np.hstack([position, _faced(position, np.stack(columns, axis=1), trial.facing)])


def _sway(trial: ExplorerTrial, time: Array) -> Array:
    """How far a hand that means to be still is from where it means to be [m], shape [pose, 3]."""
    out = np.zeros((len(time), 3))
    for wave in range(6):
        draw = uniform(trial.key, wave, 0, 0, 1)
        rate = SWAY_RATES[0] + (SWAY_RATES[1] - SWAY_RATES[0]) * draw[0]
        out[:, wave % 3] += SWAY * sine_of_turns(rate * time + draw[1])
    return out


def _faced(position: Array, quaternion: Array, limit: float) -> Array:
    """Quaternions turned towards the array where the facing angle nears the limit, which none then reaches.

    Up to the knee nothing is turned; from there on the angle grows as a hyperbolic tangent: twice differentiable.
    """
    skin = rotate(quaternion, np.broadcast_to([0.0, -1.0, 0.0], position.shape))
    axis = np.cross(position, skin)  # from the skin's normal to the direction of the array
    across = np.sqrt((axis * axis).sum(axis=1))
    angle = arc_tangent(across, -(skin * position).sum(axis=1))
    rows = np.flatnonzero(angle > KNEE * limit)
    if not len(rows):
        return quaternion
    beyond, room = angle[rows] - KNEE * limit, (1.0 - KNEE) * limit
    sine, cosine = sine_cosine(0.5 * (beyond - room * hyperbolic_tangent(beyond / room)))
    unit = axis[rows] / np.maximum(across[rows], 1e-12)[:, None]
    out = quaternion.copy()
    out[rows] = quaternion_product(np.concatenate([sine[:, None] * unit, cosine[:, None]], axis=1), quaternion[rows])
    return out
