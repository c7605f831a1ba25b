"""Shaping of live poses before they are rendered: smoothing against a tracker's noise, prediction against its delay.

Poses come at irregular times, one by one. Each is shaped from itself and the poses before it, never from later ones.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from ....datasets.rigid import NORM_TOLERANCE
from ...errors import PoseError
from ...validation import require_number, value_text

HORIZON_MOST = 0.1  # [s]
DAMPING_MOST = 1000.0  # [1/s]
CUTOFF_RANGE = (1.0, 100.0)  # [Hz]
ORDER_MOST = 4

FARTHEST = 0.05
"""A shaped position lies at most this far from the measured one [m]."""

TURN_FARTHEST = math.radians(30.0)
"""A shaped orientation differs from the measured one by at most this angle [rad]."""

GAP_MOST = 0.1
"""After a gap longer than this [s], poses are shaped as if the next were the first."""

SPEED_MOST, TURN_SPEED_MOST = 2.0, 20.0
"""Faster steps [m/s, rad/s] count as jumps of the tracker; docs/measured/live.md says how many recorded steps are."""

STEP_LEAST = 0.005
"""Steps that take less time [s] are judged as if they took this: jitter of times makes a usual step look fast."""

WINDOW = 0.025
"""A velocity is that of the poses of this time [s] before the newest one, and at least of the last two."""

SPACING = 0.004
"""Poses that follow faster than this [s] are left out of later velocities, which bounds their number and cost."""

FILTER_RATE = 2000.0
"""Rate [Hz] at which the filter runs, whatever the tracker's."""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True)
class Prediction:
    """Where the hand will be after a horizon, if it goes on with a velocity that decays exponentially.

    x(t + h) = x(t) + v (1 - exp(-d h)) / d for the horizon h and the damping d, and rotations alike with the angular
    velocity. The velocity is the slope of the line through the newest pose that fits the poses of the last 25 ms best.

    >>> from palpate.render import Prediction
    >>> Prediction(horizon=0.01, damping=0.0)
    Prediction(horizon=0.01, damping=0.0)
    """

    horizon: float = 0.02
    """How far ahead [s], 0..0.1; the time from a pose to its focal points is right."""
    damping: float = 20.0
    """How fast the velocity decays [1/s], 0..1000; 0: never. docs/measured/live.md compares dampings."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("prediction.horizon", self.horizon, 0.0, HORIZON_MOST, unit="s")
        require_number("prediction.damping", self.damping, 0.0, DAMPING_MOST, unit="1/s")

    def reach(self, ahead: float) -> float:
        """For how long [s] the hand would move at its present velocity to get as far as it does in `ahead` [s]."""
        return -math.expm1(-self.damping * ahead) / self.damping if self.damping > 1e-9 else ahead


@dataclass(frozen=True)
class Smoothing:
    """A Butterworth low-pass on positions and quaternions, which takes noise away and delays.

    The filter is SciPy's. It assumes no rate of the poses: it runs at 2 kHz on the straight line from one pose to the
    next, so poses may come at any times. The line has the nearest number of samples to the time between the poses, so
    the cutoff is right within 4 % at up to 140 poses a second. Cutoffs above half the rate of the poses do little.
    After a gap of more than 0.1 s, and after a jump, the filter starts at rest at the next pose (`PoseShaping`).

    >>> from palpate.render import Smoothing
    >>> smoothing = Smoothing(cutoff=15.0, order=2)
    >>> round(smoothing.delay, 4)
    0.015
    """

    cutoff: float = 15.0
    """Frequency [Hz], 1..100, at which half the power passes."""
    order: int = 2
    """1..4; higher orders separate noise from movement more sharply, delay more, and overshoot."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_number("smoothing.cutoff", self.cutoff, *CUTOFF_RANGE, unit="Hz")
        require_number("smoothing.order", self.order, 1, ORDER_MOST, whole=True)

    @cached_property
    def sections(self) -> NDArray[np.float64]:
        """The filter's second-order sections, as `scipy.signal.sosfilt` takes them, shape [section, 6]."""
        return np.asarray(butter(self.order, self.cutoff, fs=FILTER_RATE, output="sos"), np.float64)

    @cached_property
    def delay(self) -> float:
        """Of slow movements [s]: the group delay at frequency 0."""
        above, below = self.sections[:, :3], self.sections[:, 3:]
        order = np.arange(3.0)  # the delay of a polynomial in 1 / z is the mean of its powers, its coefficients weights
        samples = above @ order / above.sum(axis=1) - below @ order / below.sum(axis=1)
        return float(samples.sum()) / FILTER_RATE

    def transitions(self) -> list[NDArray[np.float64]]:
        """What the filter does on the line between two poses, as a matrix for each number of samples, 1..200.

        It multiplies the filter's state, the last pose and the newest one (2 section + 2 rows), and gives the output at
        the newest pose and the state then (1 + 2 section rows). The filter is linear, so this is what `sosfilt` does on
        that line, in a fifth of the time.
        """
        size = 2 * len(self.sections)
        state = np.zeros((len(self.sections), size + 2, 2))
        state[np.arange(size) // 2, np.arange(size), np.arange(size) % 2] = 1.0
        found: list[NDArray[np.float64]] = []
        for count in range(1, round(GAP_MOST * FILTER_RATE) + 1):
            line = np.zeros((size + 2, count))
            line[-1] = np.arange(1.0, count + 1.0) / count
            line[-2] = 1.0 - line[-1]
            output, after = sosfilt(self.sections, line, zi=state)
            found.append(np.concatenate([output[None, :, -1], after.transpose(0, 2, 1).reshape(size, -1)]))
        return found


class PoseShaping:
    """Poses of one hand, smoothed and then predicted, as they come.

    prediction, smoothing: None leaves that out. With both, the prediction reaches further by the delay of the
    smoothing, so that a shaped pose stands for `horizon` after its time with and without smoothing.

    A shaped pose is at most 5 cm and 30 degrees away from the measured one. The first pose is left as it is. Shaping
    begins anew, with a first pose, after a gap of more than 0.1 s, at a time that is not after the last one, at a jump
    (a step faster than 2 m/s or 20 rad/s; steps that take under 5 ms count as 5 ms), and after `reset`. Patch poses of
    an articulated hand are given in its frame: they stay as they are.

    >>> from palpate.render import PoseShaping, Prediction
    >>> shaping = PoseShaping(Prediction(horizon=0.02, damping=0.0))
    >>> poses = [[0.001 * k, 0, 0.2, 0, 0, 0, 1] for k in range(3)]
    >>> [round(float(shaping.shaped(0.01 * k, pose)[0]), 6) for k, pose in enumerate(poses)]  # at 0.1 m/s
    [0.0, 0.003, 0.004]
    """

    def __init__(self, prediction: Prediction | None = None, smoothing: Smoothing | None = None) -> None:
        self.prediction, self.smoothing = prediction, smoothing
        delay = 0.0 if smoothing is None else smoothing.delay
        self._reach = 0.0 if prediction is None else prediction.reach(prediction.horizon + delay)
        self._steps: list[NDArray[np.float64]] = [] if smoothing is None else smoothing.transitions()
        self.reset()

    def __repr__(self) -> str:
        return f"PoseShaping({self.prediction}, {self.smoothing})"

    def reset(self) -> None:
        """Forget all poses: the next is left as it is."""
        self._time = -math.inf
        self._measured: list[float] = []
        self._memory: NDArray[np.float64] | None = None  # the filter's state, the last pose and the newest one
        self._before: list[tuple[float, Vector, Quaternion]] = []  # shaped poses with times, the oldest first

    def shaped(self, time: float, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """The next pose, shaped.

        time: when the hand was there [s], on any clock. pose: x y z [m] and quaternion xyzw, hand frame -> array frame,
        shape [7]. Raises PoseError for other shapes, for values that are not finite, and for a quaternion whose norm is
        not 1 within 1e-3; then nothing has changed.
        """
        row = _checked(time, pose)
        if self.smoothing is None and self._reach == 0.0:
            return np.array(row)
        last, step = self._measured, time - self._time
        if last and row[3] * last[3] + row[4] * last[4] + row[5] * last[5] + row[6] * last[6] < 0.0:
            row[3:] = [-value for value in row[3:]]  # the same rotation; its components are continuous
        self._time, self._measured = time, row
        if not last or not 0.0 < step <= GAP_MOST or _is_jump(last, row, max(step, STEP_LEAST)):
            self._before, self._memory = [], None
        shaped = row if self.smoothing is None else self._smoothed(row, step)
        x, q = (shaped[0], shaped[1], shaped[2]), (shaped[3], shaped[4], shaped[5], shaped[6])
        if self._reach > 0.0:
            x, q = self._predicted(time, x, q)
        return np.array(_bounded(row, x, q))

    def _smoothed(self, row: list[float], step: float) -> list[float]:
        """The filter's output at the newest pose."""
        memory = self._memory
        if memory is None:  # as if the hand had rested there
            rest = sosfilt_zi(self.smoothing.sections).ravel()  # pyright: ignore[reportOptionalMemberAccess]
            self._memory = np.append(rest, [1.0, 1.0])[:, None] * np.array(row)
            return row
        memory[-1] = row
        found = self._steps[max(1, round(step * FILTER_RATE)) - 1] @ memory
        memory[:-2], memory[-2] = found[1:], row
        values: list[float] = found[0].tolist()
        norm = math.sqrt(sum(value * value for value in values[3:]))
        # A hand that spins for longer than the filter remembers may leave no rotation.
        return [*values[:3], *(value / norm for value in values[3:])] if norm > 1e-6 else [*values[:3], *row[3:]]

    def _predicted(self, time: float, x: Vector, q: Quaternion) -> tuple[Vector, Quaternion]:
        """A pose moved on, which later velocities are measured from."""
        before = self._before
        while len(before) > 1 and time - before[0][0] > WINDOW:
            del before[0]
        # The slope of the best line through the newest pose weighs each earlier pose by its age.
        squares = vx = vy = vz = rx = ry = rz = 0.0
        for moment, y, p in before:
            age = time - moment
            squares += age * age
            vx += age * (x[0] - y[0])
            vy += age * (x[1] - y[1])
            vz += age * (x[2] - y[2])
            turn = _turn(p, q)
            rx += age * turn[0]
            ry += age * turn[1]
            rz += age * turn[2]
        if not before or time - before[-1][0] >= SPACING:
            before.append((time, x, q))
        if squares == 0.0:
            return x, q
        scale = self._reach / squares
        return (x[0] + scale * vx, x[1] + scale * vy, x[2] + scale * vz), _turned(q, scale * rx, scale * ry, scale * rz)


def _checked(time: float, pose: NDArray[np.float64]) -> list[float]:
    """A pose as seven finite numbers, its quaternion of norm 1."""
    try:
        row = np.asarray(pose, np.float64)
    except (TypeError, ValueError):
        raise PoseError(f"pose must be seven numbers (x y z, qx qy qz qw), not {value_text(pose)}") from None
    if row.shape != (7,):
        raise PoseError(f"pose must have shape [7] (x y z, qx qy qz qw), not {list(row.shape)}")
    values: list[float] = row.tolist()
    x, y, z, a, b, c, w = values
    if not math.isfinite(time + x + y + z + a + b + c + w):
        raise PoseError(f"time and pose must be finite, not {time!r} s and {values}")
    norm = math.sqrt(a * a + b * b + c * c + w * w)
    if abs(norm - 1.0) > NORM_TOLERANCE:
        raise PoseError(f"pose has quaternion norm {norm:.6g}; it must be 1 within {NORM_TOLERANCE}")
    return values if abs(norm - 1.0) < 1e-12 else [x, y, z, a / norm, b / norm, c / norm, w / norm]


def _is_jump(last: list[float], row: list[float], step: float) -> bool:
    """Whether no hand gets from one measured pose to the next in `step` [s]; quaternions of the same sign."""
    far = SPEED_MOST * step
    cosine = last[3] * row[3] + last[4] * row[4] + last[5] * row[5] + last[6] * row[6]  # of half the angle
    x, y, z = row[0] - last[0], row[1] - last[1], row[2] - last[2]
    return x * x + y * y + z * z > far * far or cosine < math.cos(0.5 * TURN_SPEED_MOST * step)


def _turn(start: Quaternion, end: Quaternion) -> Vector:
    """Rotation vector [rad], in the array's frame, of the smaller rotation from `start` to `end`."""
    a, b, c, w = start
    d, e, f, v = end
    x, y, z = w * d - v * a - e * c + f * b, w * e - v * b - f * a + d * c, w * f - v * c - d * b + e * a
    cosine = w * v + a * d + b * e + c * f
    if cosine < 0.0:
        x, y, z, cosine = -x, -y, -z, -cosine
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, cosine) / sine if sine > 1e-12 else 2.0
    return x * scale, y * scale, z * scale


def _turned(start: Quaternion, x: float, y: float, z: float) -> Quaternion:
    """`start` followed by a rotation vector [rad] in the array's frame."""
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    x, y, z, s = x * scale, y * scale, z * scale, math.cos(0.5 * angle)
    a, b, c, w = start
    return (
        s * a + w * x + y * c - z * b,
        s * b + w * y + z * a - x * c,
        s * c + w * z + x * b - y * a,
        s * w - x * a - y * b - z * c,
    )


def _bounded(measured: list[float], x: Vector, q: Quaternion) -> list[float]:
    """A pose no further from the measured one than FARTHEST and TURN_FARTHEST, on the shortest path to it."""
    u, v, w = x[0] - measured[0], x[1] - measured[1], x[2] - measured[2]
    far = math.sqrt(u * u + v * v + w * w)
    if far > FARTHEST:
        scale = FARTHEST / far
        x = (measured[0] + scale * u, measured[1] + scale * v, measured[2] + scale * w)
    if abs(q[0] * measured[3] + q[1] * measured[4] + q[2] * measured[5] + q[3] * measured[6]) < _COSINE_LEAST:
        start = (measured[3], measured[4], measured[5], measured[6])
        turn = _turn(start, q)
        scale = TURN_FARTHEST / math.hypot(*turn)
        q = _turned(start, scale * turn[0], scale * turn[1], scale * turn[2])
    return [*x, *q]


_COSINE_LEAST = math.cos(0.5 * TURN_FARTHEST)


def shaping_of(prediction: float, smoothing: float) -> PoseShaping | None:
    """Shaping by a horizon [s] and a cutoff [Hz], 0 leaves either out; None without both."""
    if prediction == 0 and smoothing == 0:
        return None
    return PoseShaping(Prediction(prediction) if prediction else None, Smoothing(smoothing) if smoothing else None)
