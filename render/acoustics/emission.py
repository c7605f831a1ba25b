"""Frames of a playback, as the boards play them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...device.array import ArrayModel
from ..errors import StrategyError
from ..playback.drive import Driver, require_alike
from ..playback.focal_points import FocusSource

BYTES_MOST = 4 << 30  # of frames in memory: 7 minutes of 256 transducers at 40 kHz


@dataclass(frozen=True, eq=False)
class PlayedFrames:
    """Frames of a whole playback as boards play them, in memory: a byte for each transducer and frame.

    >>> import numpy as np
    >>> from palpate.render import PlayedFrames
    >>> PlayedFrames(np.zeros((4000, 256), np.uint8), np.ones(4000, np.float32), update_rate=40_000.0)
    PlayedFrames(4000 frames of 256 transducers at 40000 Hz, 0.1 s)
    """

    delay: np.ndarray
    """[turn / 256], uint8, shape [frame, transducer]."""
    level: np.ndarray
    """Amplitude 0..1, float32, shape [frame]."""
    update_rate: float
    """[Hz]"""

    def __repr__(self) -> str:
        """One line."""
        frame_count, transducer_count = self.delay.shape
        return (
            f"PlayedFrames({frame_count} frames of {transducer_count} transducers at {self.update_rate:g} Hz, "
            f"{self.duration:g} s)"
        )

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.level) / self.update_rate


def played_frames(source: FocusSource, driver: Driver) -> PlayedFrames:
    """Frames of all focal points, rounded as each board rounds them."""
    require_alike(driver.arrays)  # before memory is asked for
    frame_count = source.frame_count
    delay = np.empty((frame_count, driver.transducer_count), np.uint8)
    level = np.zeros(frame_count, np.float32)
    first = 0
    for focus in source:
        rounded = driver.rounded(focus)
        stop = first + len(focus.intensity)
        delay[first:stop], level[first:stop] = rounded.delay.numpy(), rounded.amplitude.numpy()
        first = stop
    return PlayedFrames(delay[:first], level[:first], source.update_rate)


def require_room(frame_count: int, update_rate: float, models: Sequence[ArrayModel]) -> None:
    """Raise StrategyError for more frames than fit into BYTES_MOST."""
    frame_bytes = sum(model.transducer_count for model in models)
    needed = frame_count * frame_bytes
    if needed > BYTES_MOST:
        seconds = BYTES_MOST / frame_bytes / update_rate
        raise StrategyError(
            f"{frame_count} frames need {needed / 1e9:.3g} GB of memory, {BYTES_MOST / 1e9:.3g} GB at "
            f"most: give duration={seconds:.0f} or less"
        )
