"""Radiation pressure and force of ultrasound on skin, averaged over frames.

A plane wave of amplitude |p| has the mean energy density E = <p^2> / (rho c^2) = |p|^2 / (2 rho c^2). What absorbs it
is pressed with E, what reflects it with 2 E (Borgnis 1953; Hoshi et al. 2010, IEEE ToH 3(3), 155-165, have alpha <p^2>
/ (rho c^2) with alpha 1..2). Skin reflects 99.9 % of what comes from air, as its impedance is 4000 times the air's; so
alpha is 2 and the pressure |p|^2 / (rho c^2), p being that of the free field. That is what is computed here. Waves
that come aslant press less, by the squared cosine of their angle: an array under a level palm loses a tenth, which is
left out, as is what the hand changes of the field: its shadow, its echo, and standing waves between hand and array.
"""

from collections.abc import Callable

import numpy as np

from ..focal_spot import SOUND_SPEED
from ..validation import require_number
from .pressure import PressureSum

AIR_DENSITY = 1.204  # [kg/m^3] at 20 degrees C


def radiation_pressure(
    pressure: np.ndarray, *, sound_speed: float = SOUND_SPEED, air_density: float = AIR_DENSITY
) -> np.ndarray:
    """How hard a wave of that pressure amplitude presses on skin [Pa]: |p|^2 / (rho c^2), as on a perfect reflector.

    pressure: complex amplitude of the free field [Pa], any shape. sound_speed [m/s], air_density [kg/m^3].

    >>> from palpate.render import radiation_pressure
    >>> round(float(radiation_pressure(3000.0)), 1)  # [Pa], of 3 kPa of ultrasound
    63.5
    """
    require_number("air_density", air_density, 0.1, 10.0, unit="kg/m^3")
    return np.abs(pressure) ** 2 / (air_density * sound_speed**2)


def mean_square(
    field: PressureSum,
    place: np.ndarray,
    drive: np.ndarray,
    *,
    progress: Callable[[int, int], object] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and largest |p|^2 over frames at points, both float64, shape [point].

    place: [m], shape [point, 3]. drive: complex, shape [frame, transducer]. progress: called with points done and all.
    """
    mean, most = np.zeros(len(place)), np.zeros(len(place))
    for first, part in field.blocks(place, drive):
        square = np.real(part) ** 2 + np.imag(part) ** 2
        stop = first + part.shape[1]
        mean[first:stop], most[first:stop] = square.mean(axis=0, dtype=np.float64), square.max(axis=0)
        if progress is not None:
            progress(stop, len(place))
    return mean, most
