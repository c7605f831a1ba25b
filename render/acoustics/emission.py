"""What transducers emit while a file is played: frames as the board plays them, through resonant transducers."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp

from ...device.codec import round_drives
from ...kernels.acoustics.resonance import CHUNK, Frames, emit_frames, settling_periods
from ..playback.drive import Driver
from ..playback.file_playback import Opened
from ..sampling.contour_sampling import FocalPoints

PERIODS = {"cpu": 8192, "cuda": 1 << 17}  # of a block: 16 MiB of 256 transducers, 256 MiB


class PlayedFrames(NamedTuple):
    """Frames of a whole playback as boards play them, in memory: a byte for each transducer and frame."""

    delay: np.ndarray
    """[turn / 256], uint8, shape [frame, transducer]."""
    level: np.ndarray
    """Amplitude 0..1, float32, shape [frame]."""
    update_rate: float
    """[Hz]"""

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.level) / self.update_rate


def played_frames(opened: Opened, driver: Driver) -> PlayedFrames:
    """Frames of all focal points, rounded as each board rounds them."""
    frame_count = opened.source.frame_count
    delay = np.empty((frame_count, sum(array.transducer_count for array in driver.arrays)), np.uint8)
    level = np.zeros(frame_count, np.float32)
    first = 0
    for focus in opened.source:
        stop = first + len(focus.intensity)
        _round_block(driver, focus, delay[first:stop], level[first:stop])
        first = stop
    return PlayedFrames(delay[:first], level[:first], opened.update_rate)


def _round_block(driver: Driver, focus: FocalPoints, delay: np.ndarray, level: np.ndarray) -> None:
    drives = driver.drive(focus)
    column = 0
    for array, part in zip(driver.arrays, driver.split(drives), strict=True):
        end = column + array.transducer_count
        # Arrays may round amplitudes otherwise: the last one's stand for all, as a frame has one here.
        delay[:, column:end], level[:] = round_drives(part.delay, part.amplitude, array=array)
        column = end


@dataclass
class EmittedBlock:
    """Amplitudes of consecutive periods."""

    signal: wp.array
    """float32, shape [2 transducer, period]; real parts, then imaginary ones; drive 1 of a transducer at rest is 1."""
    first: int
    """Number of the first period."""


def emitted_blocks(
    frames: PlayedFrames, *, carrier: float, pole: complex, device: str = "cpu"
) -> Iterator[EmittedBlock]:
    """What transducers emit, block by block, from silence: one column for each period of the carrier [Hz]."""
    rate = frames.update_rate / carrier
    period_count = round(len(frames.level) / rate)
    size = PERIODS["cuda" if wp.get_device(device).is_cuda else "cpu"]
    back = CHUNK + settling_periods(pole)
    for first in range(0, period_count, size):
        end = min(first + size, period_count)
        low = max(0, int((first - back) * rate))
        high = min(len(frames.level), int(end * rate) + 2)
        part = Frames(
            wp.array(np.ascontiguousarray(frames.delay[low:high]), device=device, copy=False),
            wp.array(np.ascontiguousarray(frames.level[low:high]), device=device, copy=False),
            low,
        )
        signal = wp.empty((2 * frames.delay.shape[1], size), dtype=wp.float32, device=device)
        if end - first < size:
            signal.zero_()
        emit_frames(part, rate=rate, pole=pole, begin=first, end=end, origin=first, out=signal)
        yield EmittedBlock(signal, first)
