"""Audible signals as WAV files, to listen to."""

import io
import wave
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ...datasets.storage.durable import write_file
from ..errors import StrategyError
from ..output_file import require_output
from .spectrum import RATE, SETTLING, NoiseSignal, resampled

PEAK = 0.9  # of full scale, for the loudest of all signals


def write_wave_files(signals: Mapping[Path, NoiseSignal], *, overwrite: bool = False) -> None:
    """Write signals as mono WAV, 16 bits at 44.1 kHz, all with one gain: so that one is as much louder as it is.

    Raises StrategyError for a name that does not end in .wav, a file that is there unless `overwrite`, a folder that
    cannot be written, and signals without any sound.

    >>> import numpy as np
    >>> from pathlib import Path
    >>> from palpate.render import NoiseSignal, write_wave_files
    >>> beat = NoiseSignal(1 + np.sin(2 * np.pi * 200 * np.arange(40_000) / 40_000), rate=40_000.0)
    >>> write_wave_files({Path("beat.wav"): beat}, overwrite=True)
    >>> Path("beat.wav").stat().st_size  # 44 bytes, then 44,100 samples of two
    88244
    """
    for path in signals:
        require_wave_file(path, overwrite=overwrite)
    heard = {path: _settled(signal) for path, signal in signals.items()}
    loudest = max((float(np.abs(samples).max(initial=0.0)) for samples in heard.values()), default=0.0)
    if not loudest > 0:
        raise StrategyError("there is nothing to hear: no focal point moves")
    for path, samples in heard.items():
        _write(path, np.rint(samples * (PEAK * 32767 / loudest)).astype("<i2"))


def require_wave_file(path: Path, *, overwrite: bool, sources: Iterable[Path] = ()) -> None:
    """Refuse another suffix, and what `require_output` refuses; sources: files that the sound is made from."""
    if path.suffix.lower() != ".wav":
        raise StrategyError(f"{path}: must end in .wav")
    require_output(path, overwrite=overwrite, sources=sources)


def _settled(signal: NoiseSignal) -> np.ndarray:
    samples = resampled(signal.samples, signal.rate)
    rise = min(len(samples), round(SETTLING * RATE))
    samples[:rise] *= np.linspace(0, 1, rise) ** 2
    return samples


def _write(path: Path, samples: np.ndarray) -> None:
    content = io.BytesIO()
    with wave.open(content, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(round(RATE))
        file.writeframes(samples.tobytes())
    try:
        write_file(path, content.getbuffer())
    except OSError as error:
        raise StrategyError(f"{path}: cannot be written ({error.strerror or error})") from error
