"""Pink noise that masks an array's own sound: one loop that the participant's page plays without a click."""

import numpy as np

from ...errors import StrategyError

LOWEST = 20.0  # [Hz]: below it nothing is heard, and a headset is only moved


def pink_noise(seconds: float, rate: float, seed: int, level: float) -> np.ndarray:
    """Noise whose power falls by 10 dB a decade from 20 Hz on, float32, shape [sample]; its peak is `level`, 0..1.

    It is made as a sum of whole periods of its own duration, so that its end continues with its beginning: a loop has
    no click. Raises StrategyError for a duration without a period of 20 Hz, and for a rate or level out of bounds.
    """
    if not 0.1 <= seconds <= 60.0:
        raise StrategyError(f"seconds of noise must be from 0.1 to 60, not {seconds:g}")
    if not 8_000.0 <= rate <= 192_000.0:
        raise StrategyError(f"the rate of noise must be from 8000 to 192000 Hz, not {rate:g}")
    if not 0.0 <= level <= 1.0:
        raise StrategyError(f"the level of noise must be from 0 to 1, not {level:g}")
    count = round(seconds * rate)
    frequency = np.fft.rfftfreq(count, 1 / rate)
    amplitude = np.where(frequency >= LOWEST, np.maximum(frequency, LOWEST) ** -0.5, 0.0)
    phase = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, len(frequency))
    wave = np.fft.irfft(amplitude * np.exp(1j * phase), count)
    scaled = (wave * (level / np.abs(wave).max())).astype(np.float32)
    return np.clip(scaled, -np.float32(level), np.float32(level))
