"""Fading: what is left of the intensity of a pose for which no next one comes.

Ages are whole numbers of ticks. So whether a sample is held, fades or is silent follows from its number and the pose's
time alone, and not from the block of samples that it is drawn in, whose beginning a difference of seconds would round.
"""

import numpy as np

TICKS = float(1 << 20)  # of a sample: one is as short as the rounding of times that `sample_bounds` allows for
FADE_LEAST = 1e-9  # [s]


def ticks_of(seconds: float | np.ndarray, update_rate: float) -> np.ndarray:
    """A time [s] in ticks, a whole number as float64; infinite for one that is.

    >>> float(ticks_of(0.011, 10_000.0)) / TICKS  # samples; the product of the two is 109.99999999999999
    110.0
    """
    return np.rint(np.asarray(seconds, np.float64) * update_rate * TICKS)


def age_at(sample: int, time: float, update_rate: float) -> float:
    """Age of a pose at a sample [s]: a whole number of ticks, which `Sampler.draw` finds again.

    sample: counted from time 0. time: of the pose [s]. update_rate: [Hz].
    """
    return float(sample * TICKS - ticks_of(time, update_rate)) / (TICKS * update_rate)


def fade_ticks(fade: float, update_rate: float) -> float:
    """Duration of a fade in ticks, at least one. fade: [s]."""
    return max(float(ticks_of(max(fade, FADE_LEAST), update_rate)), 1.0)
