"""Stimuli of the acceptance: focal points described by numbers, made into wire bytes as they are played."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace

import numpy as np

from ...device.array import ArrayModel, FocalZone
from ..focal_spot import SOUND_SPEED
from ..playback.drive import Driver
from ..playback.frames import wire_bytes
from ..sampling.metrics import FocalPoints

FELT = 200.0  # [Hz] of modulation, where Pacinian corpuscles are most sensitive
BLOCK_SECONDS = 0.05  # of frames in a block: how exactly a stop in the middle is placed
EVERYWHERE = FocalZone(lateral=10.0, z_min=-10.0, z_max=10.0)  # a self-test plays what it is asked for
CORNER_HEIGHT = 0.08  # [m] of a quarter's focal point above its middle


@dataclass(frozen=True)
class FeltStimulus:
    """A focal point that stays or goes round, its pressure amplitude |sin(pi f t)|: the square of that is one tone.

    An array whose update rate is below 4 f gets a quarter of that rate instead of f.
    """

    seconds: float
    """How long [s]."""
    centre: tuple[float, float, float] = (0.0, 0.0, 0.2)
    """The focal point, or what it goes around [m], array frame."""
    radius: float = 0.0
    """Of the circle that it goes along once a second, from +x to +y [m]; 0: it stays."""
    modulation: float | None = FELT
    """f [Hz]; None: every second frame is silent."""
    divider: int | None = None
    """Of the frame clock; None: the array's own."""
    corner: tuple[int, int] | None = None
    """Signs of x and y: only that quarter of the transducers emits, and the focal point is 80 mm above its middle."""

    def update_rate(self, model: ArrayModel) -> float:
        """Frames a second [Hz]; raises `UpdateRateError` for a divider that the array lacks."""
        return model.update_rate(model.divider_default if self.divider is None else self.divider)

    def frame_count(self, model: ArrayModel) -> int:
        """Frames in all, at least 1."""
        return max(round(self.seconds * self.update_rate(model)), 1)

    def emitting(self, model: ArrayModel) -> np.ndarray:
        """True for each transducer that emits, shape [transducer]."""
        if self.corner is None:
            return np.ones(model.transducer_count, bool)
        return (np.sign(model.position[:, :2]) == self.corner).all(axis=1)

    def position(self, model: ArrayModel, time: np.ndarray) -> np.ndarray:
        """The focal point at times [s] of shape [frame]: [m], float32, shape [frame, 3]."""
        centre = np.asarray(self.centre, np.float64)
        if self.corner is not None:
            centre = model.position[self.emitting(model)].mean(axis=0)
            centre[2] += CORNER_HEIGHT
        angle = 2 * np.pi * time
        around = self.radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(len(time))], axis=1)
        return (centre + around).astype(np.float32)

    def level(self, model: ArrayModel, frame: np.ndarray) -> np.ndarray:
        """Pressure amplitude 0..1 of frames by their number, float32, shape [frame]."""
        rate = self.update_rate(model)
        if self.modulation is None:
            return (frame % 2 == 0).astype(np.float32)
        return np.abs(np.sin(np.pi * min(self.modulation, rate / 4) / rate * frame)).astype(np.float32)

    def blocks(self, model: ArrayModel) -> Iterator[array[int]]:
        """Wire bytes, block by block."""
        rate, count = self.update_rate(model), self.frame_count(model)
        size = max(round(BLOCK_SECONDS * rate), 1)
        driver = Driver(replace(model, gain=model.gain * self.emitting(model), focal_zone=EVERYWHERE))
        for first in range(0, count, size):
            frame = np.arange(first, min(first + size, count))
            focus = FocalPoints(self.position(model, frame / rate), self.level(model, frame))
            (frames,) = driver.pack(focus).frames
            yield wire_bytes(frames.numpy())

    def parameters(self, model: ArrayModel) -> dict[str, object]:
        """Everything about it, with the update rate, for a report."""
        return {
            **asdict(self),
            "update_rate": self.update_rate(model),
            "frames": self.frame_count(model),
            "sound_speed": SOUND_SPEED,
            "transducers": int(self.emitting(model).sum()),
        }
