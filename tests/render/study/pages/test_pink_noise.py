"""Masking noise against Welch's estimate of its spectrum, by SciPy."""

import numpy as np
import pytest
from scipy.signal import welch

from palpate.render.errors import StrategyError
from palpate.render.study.pages.participant_page import pink_noise

RATE = 48_000


def slope_of(wave, low, high):
    """Of the power spectrum, in decibels a decade, between two frequencies [Hz]."""
    frequency, power = welch(wave.astype(np.float64), RATE, nperseg=1 << 14)
    inside = (frequency >= low) & (frequency <= high)
    return np.polyfit(np.log10(frequency[inside]), 10 * np.log10(power[inside]), 1)[0]


def test_its_power_falls_by_ten_decibels_a_decade_over_all_that_is_heard():
    wave = pink_noise(4.0, RATE, 1, 0.5)
    assert (wave.dtype, wave.shape) == (np.float32, (4 * RATE,))
    for low, high in ((50, 20_000), (50, 1000), (1000, 20_000)):
        assert slope_of(wave, low, high) == pytest.approx(-10, abs=0.6)


def test_nothing_is_below_twenty_hertz_and_nothing_is_constant():
    power = np.abs(np.fft.rfft(pink_noise(2.0, RATE, 3, 1.0).astype(np.float64))) ** 2
    assert power[:40].sum() < 1e-9 * power.sum()  # bins of 0.5 Hz


def test_a_loop_has_no_click():
    """The step from the last sample to the first is as those between neighbours, and so is the spectrum around it."""
    wave = pink_noise(2.0, RATE, 2, 0.5).astype(np.float64)
    steps = np.abs(np.diff(wave))
    assert abs(wave[0] - wave[-1]) <= steps.max()
    seam = np.concatenate([wave[-(1 << 13) :], wave[: 1 << 13]])
    power = [welch(part, RATE, nperseg=len(part))[1][4000:].sum() for part in (seam, wave[1000 : 1000 + len(seam)])]
    assert power[0] == pytest.approx(power[1], rel=0.5)  # a click has a flat spectrum: it would be seen at the top


@pytest.mark.parametrize("level", [0.0, 0.1, 1.0])
def test_its_peak_is_its_level(level):
    assert np.abs(pink_noise(0.5, 44_100, 7, level)).max() == np.float32(level)


def test_a_seed_gives_the_same_noise_again():
    assert np.array_equal(pink_noise(0.2, RATE, 5, 0.5), pink_noise(0.2, RATE, 5, 0.5))
    assert not np.array_equal(pink_noise(0.2, RATE, 5, 0.5), pink_noise(0.2, RATE, 6, 0.5))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ((0.01, RATE, 0, 0.5), "seconds of noise must be from 0.1 to 60, not 0.01"),
        ((float("nan"), RATE, 0, 0.5), "not nan"),
        ((1.0, 100, 0, 0.5), "rate of noise must be from 8000 to 192000 Hz, not 100"),
        ((1.0, RATE, 0, 1.5), "level of noise must be from 0 to 1, not 1.5"),
    ],
)
def test_impossible_noise_is_refused_with_its_bound(values, sentence):
    with pytest.raises(StrategyError, match=sentence):
        pink_noise(*values)
