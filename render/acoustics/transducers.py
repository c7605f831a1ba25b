"""The transducers of one array or several, as sources of sound."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...device.array import ArrayModel
from ...device.registry import array_model, kind_of
from ...kernels.driving.wave import piston_polynomial
from ..errors import StrategyError
from ..focal_spot import PISTON_RADIUS, SOUND_SPEED
from ..validation import require_number

PRESSURE_AT_1M = 3.4  # [Pa m]; 0.17 Pa m a volt at 20 V, as AcousTools has it; levitate 6, OpenMPD 8: right to 50 %


@dataclass(frozen=True)
class Resonance:
    """How a transducer follows its drive: a one-pole low-pass of the envelope about its own frequency.

    >>> from palpate.render import Resonance
    >>> resonance = Resonance(pole=1000.0)
    >>> round(abs(resonance.per_period(40_000.0)) ** 40, 6)  # of a step, what is left after 1 ms
    0.001867
    """

    pole: float = 1000.0
    """Half the bandwidth [Hz]; half the frequency over Q. 1 kHz is Q = 20, as of transducers for air."""
    detuning: float = 0.0
    """Its own frequency less the carrier [Hz]."""

    def __post_init__(self) -> None:
        """Raise StrategyError for a value out of its range."""
        require_number("pole", self.pole, 10.0, 40_000.0, unit="Hz")
        require_number("detuning", self.detuning, -5_000.0, 5_000.0, unit="Hz")

    def per_period(self, carrier: float) -> complex:
        """Factor on what is left of a step after a period of the carrier [Hz]; time factor exp(+j w t)."""
        return cmath.exp(2 * math.pi * (-self.pole + 1j * self.detuning) / carrier)


class TransducerSet:
    """Transducers of arrays side by side, in their order.

    arrays: models in the common frame, or names. sound_speed [m/s]. piston_radius [m], 0 for monopoles.
    Raises StrategyError for no array, none with transducers, or arrays of different carriers.
    """

    def __init__(
        self,
        arrays: ArrayModel | str | Sequence[ArrayModel | str],
        *,
        sound_speed: float = SOUND_SPEED,
        piston_radius: float = PISTON_RADIUS,
    ) -> None:
        given = (arrays,) if isinstance(arrays, ArrayModel | str) else tuple(arrays)
        self.arrays = tuple(array_model(array) if isinstance(array, str) else array for array in given)
        carriers = sorted({array.carrier for array in self.arrays})
        if len(carriers) != 1:
            raise StrategyError(f"arrays must be at least one and of one carrier, not {carriers} Hz")
        if not sum(array.transducer_count for array in self.arrays):
            raise StrategyError(f"array {self.arrays[0].name} has no transducers")
        require_number("sound_speed", sound_speed, 300.0, 400.0, unit="m/s (speed of sound in air)")
        require_number("piston_radius", piston_radius, 0.0, 5.5e-3, unit="m")
        self.carrier = carriers[0]
        """[Hz]"""
        self.sound_speed = sound_speed
        """[m/s]"""
        self.piston_radius = piston_radius
        """[m]"""
        self.position = np.concatenate([array.position for array in self.arrays]).astype(np.float64)
        """[m], common frame, shape [transducer, 3]."""
        self.normal = np.concatenate([array.normal for array in self.arrays]).astype(np.float64)
        """Unit vectors, shape [transducer, 3]."""

    @property
    def supposed(self) -> str | None:
        """What predictions suppose of these arrays since it is not published: a sentence without its end, or None."""
        return "; ".join(dict.fromkeys(filter(None, (kind_of(array).supposed for array in self.arrays)))) or None

    @property
    def works(self) -> np.ndarray:
        """Which transducers emit at all, bool, shape [transducer]: the others have gain 0 in a board file.

        Other gains make transducers of one board alike, so what they emit is what was asked for.
        """
        return np.concatenate([array.gain for array in self.arrays]) > 0

    def nearest(self, point: np.ndarray) -> np.ndarray:
        """Distance of points [m], shape [point, 3], to the nearest transducer; shape [point]."""
        parts = [point[first : first + 1024] for first in range(0, len(point), 1024)]
        return np.concatenate([self.distances(part).min(axis=1) for part in parts])

    @property
    def wavelength(self) -> float:
        """[m]"""
        return self.sound_speed / self.carrier

    @cached_property
    def _directivity(self) -> np.ndarray:
        return np.array(piston_polynomial(2 * np.pi * self.piston_radius / self.wavelength))

    def distances(self, point: np.ndarray) -> np.ndarray:
        """From each transducer to points [m], shape [point, 3]; shape [point, transducer]."""
        return np.linalg.norm(point[:, None] - self.position, axis=2)

    def waves(self, point: np.ndarray) -> np.ndarray:
        """Complex pressure of each transducer of drive 1 at points [m], relative to that at 1 m on its axis.

        point: shape [point, 3]. complex128, shape [point, transducer]. exp(-j k r) / r times the piston's directivity
        2 J1(x) / x, x = k a sin(angle), by a polynomial in sin^2 within 3e-5 (kernels/driving/wave.py).
        """
        offset = point[:, None] - self.position
        distance = np.linalg.norm(offset, axis=2)
        cosine = np.einsum("ptk,tk->pt", offset, self.normal) / distance
        square = 1 - cosine**2
        a, b, c, d = self._directivity
        level = 1 + square * (a + square * (b + square * (c + square * d)))
        return self.works * level / distance * np.exp(-2j * np.pi / self.wavelength * distance)
