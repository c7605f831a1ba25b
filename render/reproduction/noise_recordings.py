"""Audible noise of OC beside CC: bands, A-weighted level, RMS and peak of recordings of the same explorations.

A recording is a spectrum, measured or predicted; who made it is not known here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..acoustics.spectrum import NoiseSpectrum, level_differences
from ..errors import StrategyError
from .paper_numbers import BIN, paper_spectra
from .significance import mean_zero, normality

SHAPE_BAND = (300.0, 4000.0)
"""In which the shape of the spectrum of OC is compared with the paper's [Hz]."""

HIGH_BAND = (1000.0, 10_000.0)
"""In which the paper's CC lies on the noise of its room [Hz]."""
ROOM_FROM = 3000.0
"""From here on the paper's CC hardly falls any more: its mean level is taken as the room's [Hz]."""


@dataclass(frozen=True)
class NoiseComparison:
    """OC minus CC of pairs of recordings, and both mean spectra."""

    frequency: np.ndarray
    closed: np.ndarray
    """Mean spectrum of CC [dB], shape [bin]; powers are averaged."""
    open: np.ndarray
    """Of OC."""
    difference: dict[str, np.ndarray]
    """[dB], shape [pair], by the names of `level_differences`."""
    shape_error: float
    """RMS difference of OC's mean spectrum from the paper's over SHAPE_BAND [dB], both moved to the same mean level."""

    def values(self) -> dict[str, float]:
        """Means over pairs, for JSON."""
        return {name: float(of_pairs.mean()) for name, of_pairs in self.difference.items()}

    @property
    def shift(self) -> float:
        """What puts OC's mean spectrum on the paper's over SHAPE_BAND [dB]; the same for CC."""
        at, _, paper = paper_spectra()
        inside = (at >= SHAPE_BAND[0]) & (at <= SHAPE_BAND[1])
        return float((paper - np.interp(at, self.frequency, self.open))[inside].mean())

    def above(self, background: bool) -> float:
        """OC less CC in HIGH_BAND [dB], of the mean spectra; background: both on that of the paper's room."""
        at, paper, _ = paper_spectra()
        room = 10.0 ** ((_mean_power_level(paper[at >= ROOM_FROM]) - self.shift) / 10.0) if background else 0.0
        inside = (self.frequency >= HIGH_BAND[0]) & (self.frequency < HIGH_BAND[1])
        open_sum, closed_sum = ((10.0 ** (level[inside] / 10.0) + room).sum() for level in (self.open, self.closed))
        return float(10.0 * np.log10(open_sum / closed_sum))

    def tests(self) -> dict[str, dict[str, float | None]]:
        """p of Shapiro's and of the one-sample t-test by quantity."""
        return {
            name: {"shapiro_p": normality(of_pairs), "t_test_p": mean_zero(of_pairs)}
            for name, of_pairs in self.difference.items()
        }


def compare_noise(opened: Sequence[NoiseSpectrum], closed: Sequence[NoiseSpectrum]) -> NoiseComparison:
    """Compare recordings of OC and CC pair by pair: recording k of both is of the same exploration.

    Raises StrategyError where they are no pairs, or their bins differ.
    """
    if not opened or len(opened) != len(closed):
        raise StrategyError(f"noise needs as many recordings of OC as of CC, not {len(opened)} and {len(closed)}")
    frequency = opened[0].frequency
    for recording in (*opened, *closed):
        if not np.array_equal(recording.frequency, frequency):
            raise StrategyError(f"all recordings must have the same bins: {len(frequency)} to {frequency[-1]:g} Hz")
    pairs = [level_differences(oc, cc) for oc, cc in zip(opened, closed, strict=True)]
    mean_open, mean_closed = (_mean_level([one.power for one in part]) for part in (opened, closed))
    at, _, paper = paper_spectra()
    inside = (at >= SHAPE_BAND[0]) & (at <= SHAPE_BAND[1])
    off = np.interp(at[inside], frequency, mean_open) - paper[inside]
    return NoiseComparison(
        frequency,
        mean_closed,
        mean_open,
        {name: np.array([pair[name] for pair in pairs]) for name in pairs[0]},
        float(off.std()),
    )


def _mean_level(powers: list[np.ndarray]) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(np.mean(powers, axis=0))


def paper_above() -> float:
    """OC less CC of the paper in HIGH_BAND [dB], its points joined by lines over the bins."""
    at, closed, opened = paper_spectra()
    bins = BIN * np.arange(np.ceil(HIGH_BAND[0] / BIN), HIGH_BAND[1] // BIN)
    return _mean_power_level(np.interp(bins, at, opened)) - _mean_power_level(np.interp(bins, at, closed))


def _mean_power_level(level: np.ndarray) -> float:
    return float(10.0 * np.log10(np.mean(10.0 ** (level / 10.0))))
