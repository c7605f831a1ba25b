"""Levels of tones whose power is known."""

import numpy as np
import pytest

from palpate.render import NoiseSpectrum


@pytest.mark.parametrize(("frequency", "weight"), [(100, -19.1), (1000, 0.0), (10_000, -2.5)])
def test_levels_are_weighted_as_the_standard_says(frequency, weight):
    """IEC 61672-1:2013, table 3, in dB; of a tone of amplitude 1, whose level is -3.01 dB."""
    tone = np.sin(2 * np.pi * frequency * np.arange(44_100) / 44_100)
    spectrum = NoiseSpectrum.of_samples(tone, 44_100.0)
    assert spectrum.a_weighted == pytest.approx(weight - 3.01, abs=1.0 if frequency == 100 else 0.2)  # 43 Hz a bin
    assert spectrum.rms == pytest.approx(-3.01, abs=0.1)
