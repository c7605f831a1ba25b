"""Audible signals, their spectra, bands and levels, as the founding paper's Fig. 4 has them."""

from dataclasses import dataclass

import numpy as np

from ..errors import StrategyError

RATE = 44_100.0  # [Hz] of the paper's spectra: bins of 44100 / 1024 Hz (Fig. 4), though it says 96 kHz
WINDOW = 1024  # samples, Hann
BANDS = {"40_300": (40.0, 300.0), "300_10k": (300.0, 10_000.0)}
"""[Hz], those of the founding paper's 4.3.2."""
SETTLING = 0.02  # [s] from silence to a steady beam: a thump that belongs to no rendering
AUDIBLE = (20.0, 15_000.0)  # [Hz]


@dataclass(frozen=True, eq=False)
class NoiseSignal:
    """The audible signal at the microphone, in units of its own.

    >>> import numpy as np
    >>> from palpate.render import NoiseSignal
    >>> beat = NoiseSignal(1 + np.sin(2 * np.pi * 200 * np.arange(40_000) / 40_000), rate=40_000.0)
    >>> beat
    NoiseSignal(1 s at 40000 Hz)
    >>> round(beat.spectrum().band(100, 300), 1)  # [dB]
    -3.0
    """

    samples: np.ndarray
    """float64, shape [sample]."""
    rate: float
    """Samples a second [Hz]: the carrier."""

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.samples) / self.rate

    def spectrum(self) -> "NoiseSpectrum":
        """Its spectrum, bands and levels; raises StrategyError for less than two windows after the first 20 ms."""
        return NoiseSpectrum.of(self)

    def __repr__(self) -> str:
        """One line."""
        return f"NoiseSignal({self.duration:g} s at {self.rate:g} Hz)"


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Power in each bin of a signal's spectrum, by Welch's method: Hann windows of 1024 samples at 44.1 kHz, half over.

    >>> from palpate.render import NoiseSpectrum
    >>> import numpy as np
    >>> tone = np.sin(2 * np.pi * 1000 * np.arange(44_100) / 44_100)
    >>> spectrum = NoiseSpectrum.of_samples(tone, 44_100.0)
    >>> round(spectrum.band(900, 1100), 2)  # [dB] of an amplitude of 1: power 1/2
    -3.01
    """

    frequency: np.ndarray
    """Middle of each bin [Hz]."""
    power: np.ndarray
    """Of each bin, in the square of the signal's unit."""
    peak: float
    """Largest magnitude of the signal from 20 Hz on."""

    def __repr__(self) -> str:
        """One line."""
        levels = ", ".join(f"{name} {value:.1f}" for name, value in self.levels().items())
        return f"NoiseSpectrum({len(self.frequency)} bins of {self.frequency[1]:.1f} Hz, {levels} dB)"

    @classmethod
    def of(cls, signal: NoiseSignal) -> "NoiseSpectrum":
        """Of a signal after SETTLING, in which the beam builds up; raises StrategyError for less than two windows."""
        return cls.of_samples(signal.samples[round(SETTLING * signal.rate) :], signal.rate)

    @classmethod
    def of_samples(cls, samples: np.ndarray, rate: float) -> "NoiseSpectrum":
        """Of samples at a rate [Hz], resampled to 44.1 kHz."""
        from scipy.signal import butter, sosfiltfilt, welch

        audible = resampled(samples, rate)
        if len(audible) < 2 * WINDOW:
            raise StrategyError(f"{len(samples) / rate:g} s are too short: {2 * WINDOW / RATE:.3g} s are needed")
        frequency, density = welch(audible, RATE, "hann", WINDOW, WINDOW // 2, detrend="constant")
        heard = sosfiltfilt(butter(2, AUDIBLE[0], "highpass", fs=RATE, output="sos"), audible)
        return cls(frequency, density * (frequency[1] - frequency[0]), float(np.abs(heard).max()))

    def band(self, low: float, high: float) -> float:
        """Level of the bins in low..high [Hz], in dB of the signal's unit; -inf if nothing is there."""
        with np.errstate(divide="ignore"):
            return float(10 * np.log10(self.power[(self.frequency >= low) & (self.frequency < high)].sum()))

    @property
    def rms(self) -> float:
        """Level of all that is audible (20 Hz to 15 kHz) [dB]."""
        return self.band(*AUDIBLE)

    @property
    def a_weighted(self) -> float:
        """The same, weighted as IEC 61672-1's A [dB]."""
        inside = (self.frequency >= AUDIBLE[0]) & (self.frequency < AUDIBLE[1])
        with np.errstate(divide="ignore"):
            return float(10 * np.log10((self.power * a_weight(self.frequency))[inside].sum()))

    @property
    def level(self) -> np.ndarray:
        """Of each bin [dB]."""
        with np.errstate(divide="ignore"):
            return 10 * np.log10(self.power)

    def levels(self) -> dict[str, float]:
        """Of the paper's bands, A-weighted, RMS and peak [dB], all of the signal's own unit."""
        bands = {f"db_{name}": self.band(low, high) for name, (low, high) in BANDS.items()}
        with np.errstate(divide="ignore"):
            peak = float(20 * np.log10(self.peak))
        return {**bands, "dba": self.a_weighted, "rms": self.rms, "peak": peak}

    def with_floor(self, decibel: float) -> "NoiseSpectrum":
        """With a background of this level [dB] in each bin: a room has one, and a difference to nothing is infinite."""
        return NoiseSpectrum(self.frequency, self.power + 10 ** (decibel / 10), self.peak)


def resampled(samples: np.ndarray, rate: float) -> np.ndarray:
    """Samples at 44.1 kHz, without their mean; float64."""
    from fractions import Fraction

    from scipy.signal import resample_poly

    ratio = Fraction(RATE / rate).limit_denominator(1000)
    centred = np.asarray(samples, np.float64) - np.mean(samples)
    return resample_poly(centred, ratio.numerator, ratio.denominator)


def a_weight(frequency: np.ndarray) -> np.ndarray:
    """Power weights of IEC 61672-1's A at frequencies [Hz]; 1 at 1 kHz."""

    def gain(f: np.ndarray) -> np.ndarray:
        square = np.asarray(f, np.float64) ** 2
        ends = (square + 20.598997**2) * (square + 12194.217**2)
        middle = np.sqrt((square + 107.65265**2) * (square + 737.86223**2))
        return (12194.217**2 * square**2 / (ends * middle)) ** 2

    return gain(frequency) / gain(np.array(1000.0))


def level_differences(spectrum: NoiseSpectrum, reference: NoiseSpectrum) -> dict[str, float]:
    """Levels of one spectrum less those of another [dB]: of the paper's bands, A-weighted, RMS and peak.

    >>> import numpy as np
    >>> from palpate.render import NoiseSpectrum, level_differences
    >>> tone = np.sin(2 * np.pi * 1000 * np.arange(44_100) / 44_100)
    >>> soft, loud = (NoiseSpectrum.of_samples(gain * tone, 44_100.0) for gain in (1, 2))
    >>> round(level_differences(loud, soft)["dba"], 2)
    6.02
    """
    own, other = spectrum.levels(), reference.levels()  # of silence -inf: a difference is -inf, inf or nan
    return {name: own[name] - other[name] for name in own}
