"""A PAT board's bus and frames, for tests of how its grid of bytes is kept."""

from __future__ import annotations

import numpy as np

from palpate.device import (
    VirtualClock,
    array_model,
    encode_frames,
)
from palpate.device.boards.pat16.model import PatBoard
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.registry import emulated_backend

MODEL = array_model("pat16")
FRAME = 512


def content(count: int, seed: int = 0) -> np.ndarray:
    """Frames that emit from every transducer, and set no divider."""
    return encode_frames(np.random.default_rng(seed).random((count, 256)), np.ones(count), array=MODEL)


def bus_of() -> EmulatedBus[PatBoard]:
    return emulated_backend("pat16", clock=VirtualClock(), record=100_000)


def played_since(board: PatBoard, count: int) -> np.ndarray:
    """Frames that emit, of those played after the first `count`."""
    frames = board.played[count:]
    return frames[frames[:, 256:].any(axis=1)]
