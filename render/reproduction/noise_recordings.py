"""Audible noise of OC beside CC: bands, A-weighted level, RMS and peak of recordings of the same explorations.

A recording is a spectrum with two levels, measured or predicted; who made it is not known here.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import StrategyError
from .paper_spectra import paper_spectra
from .significance import mean_zero, normality

BANDS = {"db_300_10k": (300.0, 10_000.0), "db_40_300": (40.0, 300.0)}
"""Bands by name [Hz]: bins whose frequency lies in them, both ends included."""
SHAPE_BAND = (300.0, 4000.0)
"""In which the shape of the spectrum of OC is compared with the paper's [Hz]."""


class NoiseRecording(NamedTuple):
    """One recording, or the prediction of one."""

    frequency: np.ndarray
    """Of bins [Hz], shape [bin], evenly spaced; the paper's are 44100 / 1024 Hz apart."""
    level: np.ndarray
    """Power of each bin [dB], shape [bin]; the reference is any, but one for all recordings."""
    rms: float
    """Of the whole recording [dB]."""
    peak: float
    """Of the whole recording [dB]."""


@dataclass(frozen=True)
class NoiseComparison:
    """OC minus CC of pairs of recordings, and both mean spectra."""

    frequency: np.ndarray
    closed: np.ndarray
    """Mean spectrum of CC [dB], shape [bin]; powers are averaged."""
    open: np.ndarray
    """Of OC."""
    difference: dict[str, np.ndarray]
    """[dB], shape [pair]: of the bands of BANDS, `dba`, `rms` and `peak`."""
    shape_error: float
    """RMS difference of OC's mean spectrum from the paper's over SHAPE_BAND [dB], both moved to the same mean level."""

    def values(self) -> dict[str, float]:
        """Means over pairs, for JSON."""
        return {name: float(of_pairs.mean()) for name, of_pairs in self.difference.items()}

    def tests(self) -> dict[str, dict[str, float | None]]:
        """p of Shapiro's and of the one-sample t-test by quantity."""
        return {
            name: {"shapiro_p": normality(of_pairs), "t_test_p": mean_zero(of_pairs)}
            for name, of_pairs in self.difference.items()
        }


def compare_noise(opened: Sequence[NoiseRecording], closed: Sequence[NoiseRecording]) -> NoiseComparison:
    """Compare recordings of OC and CC pair by pair: recording k of both is of the same exploration.

    Raises StrategyError where they are no pairs, or their bins differ.
    """
    recordings = [*opened, *closed]
    if not opened or len(opened) != len(closed):
        raise StrategyError(f"noise needs as many recordings of OC as of CC, not {len(opened)} and {len(closed)}")
    frequency = np.asarray(recordings[0].frequency, np.float64)
    for recording in recordings:
        if not np.array_equal(recording.frequency, frequency) or np.shape(recording.level) != frequency.shape:
            raise StrategyError(f"all recordings must have the same bins: {len(frequency)} to {frequency[-1]:g} Hz")
    weighting = a_weighting(frequency)
    difference: dict[str, list[float]] = {name: [] for name in (*BANDS, "dba", "rms", "peak")}
    for oc, cc in zip(opened, closed, strict=True):
        for name, band in BANDS.items():
            difference[name].append(band_level(oc, band) - band_level(cc, band))
        weighted = [power_sum(one.level + weighting) for one in (oc, cc)]
        difference["dba"].append(weighted[0] - weighted[1])
        difference["rms"].append(oc.rms - cc.rms)
        difference["peak"].append(oc.peak - cc.peak)
    mean_open, mean_closed = (_mean_spectrum([one.level for one in part]) for part in (opened, closed))
    return NoiseComparison(
        frequency,
        mean_closed,
        mean_open,
        {name: np.array(of_pairs) for name, of_pairs in difference.items()},
        _shape_error(frequency, mean_open),
    )


def a_weighting(frequency: np.ndarray) -> np.ndarray:
    """A-weighting [dB] of frequencies [Hz], IEC 61672: 0 at 1 kHz; minus infinity at 0 Hz."""
    squared = np.square(frequency, dtype=np.float64)
    poles = np.sqrt((squared + 107.7**2) * (squared + 737.9**2))
    gain = 12194.0**2 * squared**2 / ((squared + 20.6**2) * poles * (squared + 12194.0**2))
    with np.errstate(divide="ignore"):
        return 20.0 * np.log10(gain) + 2.0


def band_level(recording: NoiseRecording, band: tuple[float, float]) -> float:
    """Level of the bins in a band [dB], both ends included."""
    inside = (recording.frequency >= band[0]) & (recording.frequency <= band[1])
    return power_sum(recording.level[inside])


def power_sum(level: np.ndarray) -> float:
    """Level of the sum of powers [dB]; level: [dB]."""
    with np.errstate(divide="ignore"):
        return float(10.0 * np.log10(np.power(10.0, np.asarray(level, np.float64) / 10.0).sum()))


def _mean_spectrum(levels: list[np.ndarray]) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(np.power(10.0, np.asarray(levels, np.float64) / 10.0).mean(axis=0))


def _shape_error(frequency: np.ndarray, level: np.ndarray) -> float:
    at, _, paper = paper_spectra()
    inside = (at >= SHAPE_BAND[0]) & (at <= SHAPE_BAND[1])
    off = np.interp(at[inside], frequency, level) - paper[inside]
    return float(off.std())
