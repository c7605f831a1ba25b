"""A picture of audible noise: spectra side by side, and levels over time."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..acoustics.spectrum import RATE, NoiseSignal, NoiseSpectrum, resampled
from ..errors import StrategyError
from ..terminal.foreign_text import visible
from .picture_style import LINES, save_picture

SHOWN = (40.0, 12_000.0)  # [Hz]
STEP = 0.1  # [s] of a level over time
DEEPEST = 90.0  # [dB] below the loudest bin
QUIETEST = 70.0  # [dB] below the loudest tenth of a second


def draw_noise(signals: Mapping[str, NoiseSignal], picture: Path, *, dpi: int = 120) -> None:
    """Draw spectra and levels over time of signals by label; 0 dB is the loudest bin of all. Raises OSError."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    spectra = {label: NoiseSpectrum.of(signal) for label, signal in signals.items()}
    if not any(np.isfinite(spectrum.rms) for spectrum in spectra.values()):
        raise StrategyError("there is nothing to draw: no file makes any sound")
    loudest = max(float(spectrum.level[1:].max()) for spectrum in spectra.values())
    over_time = {label: level_over_time(signal) for label, signal in signals.items()}
    highest = np.nanmax([level for _, level in over_time.values()])
    for k, (label, spectrum) in enumerate(spectra.items()):
        colour = LINES[k % len(LINES)]
        inside = (spectrum.frequency >= SHOWN[0]) & (spectrum.frequency <= SHOWN[1])
        shown = spectrum.level[inside] - loudest
        left.semilogx(spectrum.frequency[inside], shown, color=colour, label=visible(label), lw=1.3)
        time, level = over_time[label]
        right.plot(time, level - highest, color=colour, lw=1.1)
    left.set(xlabel="frequency [Hz]", ylabel="level of a bin of 43 Hz [dB]", xlim=SHOWN, ylim=(-DEEPEST, 3))
    left.legend(frameon=False)
    left.set_xticks([50, 100, 200, 500, 1000, 2000, 5000, 10_000], ["50", "100", "200", "500", "1k", "2k", "5k", "10k"])
    left.minorticks_off()
    right.set(xlabel="time [s]", ylabel=f"level in {STEP:g} s [dB]", ylim=(-QUIETEST, 3))
    for axes in (left, right):
        axes.grid(alpha=0.3)
    save_picture(figure, picture, dpi=dpi)


def level_over_time(signal: NoiseSignal) -> tuple[np.ndarray, np.ndarray]:
    """Middle [s] and level [dB] of each tenth of a second; NaN where nothing sounds."""
    samples = resampled(signal.samples, signal.rate)
    length = round(STEP * RATE)
    count = max(1, len(samples) // length)
    parts = samples[: count * length].reshape(count, -1)
    power = (parts - parts.mean(axis=1, keepdims=True)) ** 2
    mean = power.mean(axis=1)
    with np.errstate(divide="ignore"):
        level = 10 * np.log10(np.where(mean > 1e-9 * mean.max(), mean, np.nan))
    return (np.arange(count) + 0.5) * STEP, level
