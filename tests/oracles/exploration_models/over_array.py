"""The exploration over an array, stroke by stroke: the model of kernels/motions/over_array.py, to the last bit.

A trial is a row of `trials_of`, with the numbers of a person. Random numbers are those of NumPy's Philox.
"""

import itertools
import math

import numpy as np

from palpate.render.motions.explorations.control_points import arc_tangent, cross, dot, length_of, product, sine_cosine

PLACE, PITCH, ROLL, YAW, SPEED, PAUSE, VISIT = range(7)


def uniform(trial, *counter):
    """Four numbers in 0..1 of a counter of up to four words; NumPy adds 1 to the counter first."""
    whole = sum(word << 64 * k for k, word in enumerate(counter))
    key = trial["explorer"] + (trial["seed"] << 64)
    words = np.random.Philox(key=key, counter=(whole - 1) % 2**256).random_raw(4)
    return ((words >> np.uint64(11)) * 2.0**-53).tolist()


def bell(trial, *counter):
    """A sum of four uniform numbers, of mean 0 and standard deviation 1 but for what lies beyond 2."""
    a, b, c, d = uniform(trial, *counter)
    return min(max((a + b + c + d - 2.0) * math.sqrt(3.0), -2.0), 2.0)


def stroke_count(trial, visit):
    """Strokes of a visit, the one to the next visit's entrance included."""
    return 4 + int(4.0 * uniform(trial, visit, 0, VISIT)[0])


def waypoint(trial, visit, number):
    """Position [m] and yaw, pitch and roll [rad] of a waypoint; number 0 is where the visit enters."""
    low, high = trial["workspace"][0] + 0.0013, trial["workspace"][1] - 0.0013
    share = uniform(trial, visit, number, PLACE)[:3]
    if number == 0:
        _, chance, other, _ = uniform(trial, visit, 0, VISIT)
        side = trial["side"] if chance < 0.5 else (trial["side"] + 1 + int(3.0 * other)) % 4
        axis, value = ((2, 1.0), (1, 0.0), (0, 0.0), (0, 1.0))[side]  # above, front, left, right
        share[axis] = value
    habits = (("yaw", 6.0, YAW), ("pitch", 6.0, PITCH), ("roll", 4.5, ROLL))
    angles = [trial[name] + math.radians(sd) * bell(trial, visit, number, draw) for name, sd, draw in habits]
    return low + np.array(share) * (high - low), np.array(angles)


def strokes_of(trial):
    """Strokes for ever: their waypoints, when they begin, and how long they move [ms]."""
    begin, start = 0, waypoint(trial, 0, 0)
    for visit in itertools.count():
        count = stroke_count(trial, visit)
        for stroke in range(count):
            is_last = stroke == count - 1
            goal = waypoint(trial, visit + is_last, 0 if is_last else stroke + 1)
            speed = trial["speed"] * (1.0 + 0.25 * bell(trial, visit, stroke, SPEED))
            length, turn = length_of(goal[0] - start[0]).item(), np.abs(goal[1] - start[1]).sum()
            seconds = max(length / min(max(speed, 0.03), 0.4), turn / 1.6, 0.3)
            chance, share, _, _ = uniform(trial, visit, stroke, PAUSE)
            pause = 0.2 + (0.7 - 0.2) * share if chance < trial["pause_share"] else 0.0
            moving = math.ceil(1e3 * seconds)
            yield start, goal, begin, moving
            begin += moving + round(1e3 * pause)
            start = goal


def poses_of(trial):
    """Poses first..stop of a trial, float64, shape [pose, 7]."""
    time = np.arange(trial["first"], trial["stop"]) / trial["rate"]
    ahead, following = itertools.tee(strokes_of(trial))
    next(following)
    parts = [np.empty((0, 7))]
    for own, after in zip(ahead, following, strict=False):
        now = time[(own[2] / 1e3 <= time) & (time < after[2] / 1e3)]
        parts.append(poses_on(trial, *own, now))
        if not len(time) or time[-1] < after[2] / 1e3:
            return np.concatenate(parts)
    return None


def poses_on(trial, start, goal, begin, moving, time):
    """Poses at times [s] on one stroke, by the minimum-jerk profile, with the sway of a hand that means to be still."""
    s = np.clip((time - begin / 1e3) / (moving / 1e3), 0.0, 1.0)[:, None]
    s = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    sway = np.zeros((len(time), 3))
    for wave in range(6):
        draw = uniform(trial, wave, 0, 0, 1)
        sway[:, wave % 3] += 0.0006 * sine_of_turns((0.4 + (1.0 - 0.4) * draw[0]) * time + draw[1])
    position = start[0] + s * (goal[0] - start[0]) + sway
    yaw, pitch, roll = (start[1] + s * (goal[1] - start[1])).T
    # z by yaw, x by a right angle and the pitch, z by roll
    lean, both, apart = (sine_cosine(half) for half in (np.pi / 4 + pitch / 2, (yaw + roll) / 2, (yaw - roll) / 2))
    q = np.stack([lean[0] * apart[1], lean[0] * apart[0], lean[1] * both[0], lean[1] * both[1]], axis=1)
    return np.concatenate([position, faced(position, q, trial["facing"])], axis=1)


def faced(position, q, limit):
    """Quaternions turned towards the array: from 0.8 of the limit on, facing angles grow as a hyperbolic tangent."""
    normal = np.broadcast_to([0.0, -1.0, 0.0], position.shape)
    turned = cross(q[:, :3], normal)
    skin = normal + 2.0 * (q[:, 3:] * turned + cross(q[:, :3], turned))
    axis = cross(position, skin)
    across = length_of(axis)
    angle = arc_tangent(across, -dot(skin, position))
    beyond, room = np.maximum(angle - 0.8 * limit, 0.0), (1.0 - 0.8) * limit
    sine, cosine = sine_cosine(0.5 * (beyond - room * hyperbolic_tangent(beyond / room)))
    turn = np.concatenate([sine * (axis / np.maximum(across, 1e-12)), cosine], axis=1)
    return np.where(angle > 0.8 * limit, product(turn, q), q)


def sine_of_turns(turns):
    """Sine of 2 pi times a number of turns: of the nearest quarter turn, and of the rest."""
    quarter = np.rint(4.0 * turns)
    sine, cosine = sine_cosine((4.0 * turns - quarter) * (np.pi / 2.0))
    return np.choose((quarter % 4).astype(int), [sine, cosine, -sine, -cosine])


def hyperbolic_tangent(x):
    """tanh(x) of x in 0..20, by e to the power of -2x / 128 and its squares."""
    e = np.full_like(x, 1.0 / math.factorial(12))
    for k in range(11, -1, -1):
        e = e * (-2.0 * x / 128.0) + 1.0 / math.factorial(k)
    for _ in range(7):
        e = e * e
    return (1.0 - e) / (1.0 + e)
