"""How wide a focal point is: no detail of an object below it can be felt, so stages and grids are scaled by it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..datasets.rigid import rotate
from ..device.array import ArrayModel
from ..device.registry import array_model
from .errors import StrategyError
from .validation import require_number

PISTON_RADIUS = 4.5e-3  # [m] of a 40 kHz transducer of 10 mm, as in published simulators
SOUND_SPEED = 343.0  # [m/s] at 20 degrees C; 331.3 + 0.606 T
ARRAY_DEFAULT = "emulator"  # 16 x 16 transducers at 10.5 mm
HEIGHT_DEFAULT = 0.2  # [m]
NEAREST = 0.01  # [m]; of a focal point to a transducer
FARTHEST = 10.0  # [m]; of a focal point to the nearest: there the focus is wider than a person
STEPS_A_WAVE = 8  # of a scan along a line: pressure changes over half a wavelength at least
STEPS_FINER = 16  # of a step, around the peak and the borders
REACH_FIRST, REACH_LAST = 4, 256  # wavelengths that a scan reaches to each side
HALF_POWER = 0.5  # of p^2

Power = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class FocalSize:
    """Widths of a focal point [m] on lines through it along the array's axes.

    A line's peak is the top that is reached from the focal point uphill; along z it lies nearer to the array.
    """

    x: float
    """FWHM of p^2: how long the squared pressure stays above half of the peak's."""
    y: float
    """The same along y."""
    z: float
    """The same along z, away from the array."""

    @property
    def width(self) -> float:
        """Across the focus, geometric mean of x and y [m]: what thresholds are scaled by."""
        return float(np.sqrt(self.x * self.y))


def focal_width(
    point: float | np.ndarray = HEIGHT_DEFAULT,
    *,
    array: ArrayModel | None = None,
    speed_of_sound: float = SOUND_SPEED,
    piston_radius: float = PISTON_RADIUS,
) -> FocalSize:
    """Size of a focal point: circular pistons at full amplitude, their waves in phase at the point, in free air.

    point: [m], common frame, shape [3]; or a height over the middle of the array's face. array: by default 16 x 16
    transducers at 10.5 mm. speed_of_sound: [m/s]. piston_radius: [m], 0 for monopoles.
    Reckoned once for a point and array. Neither the skin's echo nor absorption is in it; sizes are those of a weak
    wave. Raises StrategyError for a point that is not finite, lies within 10 mm of a transducer, farther than 10 m
    from all of them, or behind the array.

    >>> from palpate.render import focal_width
    >>> [round(1000 * focal_width(height).width, 1) for height in (0.1, 0.2, 0.3)]  # [mm]: wider farther away
    [6.3, 10.1, 14.3]
    """
    array = array or array_model(ARRAY_DEFAULT)
    try:
        place = np.asarray(point, np.float64)
    except (TypeError, ValueError, OverflowError):
        place = np.full(0, np.nan)  # refused below
    if place.ndim == 0:
        place = array.pose[:3] + rotate(array.pose[3:], np.array([0.0, 0.0, float(place)]))
    if place.shape != (3,) or not np.isfinite(place).all():
        raise StrategyError(f"focal width: point must be a height or three finite numbers [m], not {point!r}")
    require_number("focal width: speed of sound", speed_of_sound, 100.0, 2000.0, unit="m/s")
    require_number("focal width: piston radius", piston_radius, 0.0, 0.1, unit="m")
    return _focal_size(array, tuple(place.tolist()), speed_of_sound, piston_radius)


@lru_cache(maxsize=256)
def _focal_size(array: ArrayModel, place: tuple[float, ...], speed_of_sound: float, piston_radius: float) -> FocalSize:
    """See `focal_width`."""
    point = np.array(place)
    wave_length = speed_of_sound / array.carrier
    power = focused_power(array, point, wave_length, piston_radius)
    step = wave_length / STEPS_A_WAVE
    axes = rotate(array.pose[3:], np.eye(3))
    return FocalSize(*(peak_width(lambda t, axis=axis: power(point + t[:, None] * axis), step) for axis in axes))


def focused_power(array: ArrayModel, point: np.ndarray, wave_length: float, piston_radius: float) -> Power:
    """Squared pressure, by any unit, at points [m], shape [point, 3], of an array focused at one of them.

    At a transducer's face the pressure is no number that means anything: 0 behind, and nearer than 5 mm.
    """
    position, normal = array.position.astype(np.float64), array.normal.astype(np.float64)
    with np.errstate(over="ignore"):  # infinitely far away is too far
        distance = np.linalg.norm(point - position, axis=1)
    if distance.min() < NEAREST:
        raise StrategyError(
            f"focal width: point {np.round(point, 4).tolist()} m is {distance.min():.3g} m from a transducer, must be "
            f"{NEAREST:g} m at least"
        )
    if distance.min() > FARTHEST:
        raise StrategyError(
            f"focal width: point {np.round(point, 4).tolist()} m is {distance.min():.3g} m from the nearest "
            f"transducer, must be {FARTHEST:g} m at most"
        )
    if (np.einsum("tk,tk->t", point - position, normal) <= 0).all():
        raise StrategyError(
            f"focal width: point {np.round(point, 4).tolist()} m lies behind the array, which cannot focus there"
        )
    from scipy.special import j1  # a fifth of a second that what needs no width does without

    wave_number = 2 * np.pi / wave_length
    drive = array.gain * np.exp(-1j * wave_number * distance)

    def power(x: np.ndarray) -> np.ndarray:
        way = x[:, None] - position
        far = np.maximum(np.linalg.norm(way, axis=2), 1e-9)
        cosine = np.einsum("ptk,tk->pt", way, normal) / far
        s = wave_number * piston_radius * np.sqrt(np.clip(1 - cosine**2, 0, None))
        directivity = np.where(s > 1e-6, 2 * j1(s) / np.maximum(s, 1e-6), 1.0)
        pressure = (drive * directivity / far * np.exp(1j * wave_number * far)).sum(axis=1)
        return np.where((far.min(axis=1) >= NEAREST / 2) & (cosine > 0).any(axis=1), np.abs(pressure) ** 2, 0.0)

    return power


def peak_width(power: Callable[[np.ndarray], np.ndarray], step: float) -> float:
    """How long a function of place stays above half of its peak, which lies uphill from 0 [m].

    step: of the scan [m], then refined. A width ends where the scan does, REACH_LAST wavelengths away.
    """
    reach = REACH_FIRST
    fine = step * np.linspace(0, 1, STEPS_FINER + 1)
    while True:
        half = reach * STEPS_A_WAVE
        place = step * np.arange(-half, half + 1)
        value = power(place)
        peak = half
        while 0 < peak < 2 * half and max(value[peak - 1], value[peak + 1]) > value[peak]:
            peak += 1 if value[peak + 1] >= value[peak - 1] else -1
        below = np.flatnonzero(value < HALF_POWER * value[peak])
        if reach >= REACH_LAST or (below.size and below[0] < peak < below[-1]):
            break
        reach *= 2
    bound = HALF_POWER * max(value[peak], power(place[peak] + np.concatenate([-fine, fine])).max())

    def end(sign: int) -> float:
        at = peak
        while 0 < at < 2 * half and value[at] >= bound:
            at += sign
        if value[at] >= bound:
            return float(place[at])
        inwards = place[at] - sign * fine
        over = power(inwards) - bound
        k = max(int(np.argmax(over >= 0)), 1)
        return float(inwards[k - 1] + (inwards[k] - inwards[k - 1]) * over[k - 1] / (over[k - 1] - over[k]))

    return end(1) - end(-1)
