"""Frames of an array that takes focal points: float32 x, y, z [m] in its own frame, and intensity 0..1, of each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .array import POINT_BYTES
from .wire_layout import Frames, Layout, Numbers, linear_levels

_VALUES = POINT_BYTES // 4
_INTENSITY = 3  # place among the values of a point


@dataclass(frozen=True)
class FocusLayout:
    """Frames of focal points, from which the array's own driver finds phases: `ArrayKind.layout` of such an array.

    >>> import numpy as np
    >>> from palpate.device import FocusLayout
    >>> frames = np.float32([[0, 0, 0.2, 0.5], [0, 0, 0.2, 0]]).view(np.uint8)  # half the pressure, and silence
    >>> layout = FocusLayout()
    >>> layout, layout.emitting(frames).tolist()
    (FocusLayout(), [True, False])
    """

    is_switch = False
    """Whether a transducer is on or off: no, intensities are numbers."""

    def off_frame(self, frame_bytes: int) -> Frames:
        """The frame of silence, shape [frame_bytes]: intensity 0."""
        return np.zeros(frame_bytes, np.uint8)

    def emitting(self, frames: Frames) -> NDArray[np.bool_]:
        """Which frames, shape [frame, frame_bytes], make any sound, shape [frame]."""
        return np.asarray((_intensities(frames) > 0).any(axis=1))

    def width(self, frames: Frames) -> Numbers:
        """How hard frames may drive the array, 0..1, shape [frame]: width of pulses in parts of half a period.

        The driver does not say how it drives transducers. Supposed is an amplitude of all transducers that is the sum
        of the intensities, 1 at most: it is right for one focal point at the full use of the array, and too high
        otherwise, so limits stop early rather than late.
        """
        amplitude = np.minimum(_intensities(frames).sum(axis=1), np.float32(1))
        return np.asarray(np.float32(2 / math.pi) * np.arcsin(amplitude), np.float32)

    def faded(self, frame: bytes, transducer_count: int, step_count: int) -> list[bytes]:
        """The frame at falling intensities, the last of them off; positions stay."""
        values = np.frombuffer(frame, "<f4").reshape(-1, _VALUES)
        steps: list[bytes] = []
        for number in range(1, step_count):
            faded = values.copy()
            faded[:, _INTENSITY] *= np.float32((step_count - number) / step_count)
            steps.append(faded.tobytes())
        return [*steps, bytes(len(frame))]

    def assumed(self, transducer_count: int) -> Layout:
        """Steps of delays and levels that are supposed for predictions, as the driver's are not published: 256, 255."""
        return Layout(
            turn=256,
            delay_at=slice(0, transducer_count),
            levels=linear_levels(255),
            level_at=slice(transducer_count, 2 * transducer_count),
        )


def _intensities(frames: Frames) -> Numbers:
    """Intensity of each focal point, shape [frame, point]."""
    return np.ascontiguousarray(frames).view("<f4")[:, _INTENSITY::_VALUES]
