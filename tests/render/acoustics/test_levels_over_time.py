"""Levels over time follow a tone of known power."""

import numpy as np

from palpate.render import NoiseSignal
from palpate.render.acoustics.spectrum import levels_over_time


def test_levels_over_time_follow_the_signal():
    """A tone of 1 kHz, where A is 0 dB, that becomes ten times weaker: 20 dB less."""
    rate = 40_000.0
    time = np.arange(40_000) / rate
    tone = np.sin(2 * np.pi * 1000 * time) * np.where(time < 0.5, 1.0, 0.1)
    begin, level = levels_over_time(NoiseSignal(tone, rate), step=0.1)
    np.testing.assert_allclose(begin, np.arange(10) * 0.1)
    np.testing.assert_allclose(level[:5], -3.01, atol=0.2)
    np.testing.assert_allclose(level[5:], -23.01, atol=0.3)
