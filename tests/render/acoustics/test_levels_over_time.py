"""Levels over time follow a tone of known power."""

import numpy as np
import pytest

from palpate.render import NoiseSignal, NoiseSpectrum
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


@pytest.mark.parametrize(("frequency", "weight"), [(100, -19.1), (1000, 0.0), (10_000, -2.5)])
def test_levels_are_weighted_as_the_standard_says(frequency, weight):
    """IEC 61672-1:2013, table 3, in dB; of a tone of amplitude 1, whose level is -3.01 dB."""
    tone = np.sin(2 * np.pi * frequency * np.arange(44_100) / 44_100)
    spectrum = NoiseSpectrum.of_samples(tone, 44_100.0)
    assert spectrum.a_weighted == pytest.approx(weight - 3.01, abs=1.0 if frequency == 100 else 0.2)  # 43 Hz a bin
    assert spectrum.rms == pytest.approx(-3.01, abs=0.1)
