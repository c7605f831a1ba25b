"""What the tests of the umockdev tier share: playing on the emulated bus, and what a board must have played."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from umockdev_player import DEFAULTS, content
from umockdev_session import Outcome, Plug, run

from palpate.device import array_model

PALPATE = str(Path(sys.executable).with_name("palpate"))
PLAYER = str(Path(__file__).with_name("umockdev_player.py"))
MODEL = array_model("emulator")
FRAME = 512
TRANSPORTS = ("sync", "queued")


def play(folder: Path, *plugs: Plug, session: dict[str, Any] | None = None, **options: Any) -> Outcome:
    """Run the playing program on a bus."""
    return run([sys.executable, PLAYER, json.dumps(options)], folder, plugs=plugs or (Plug(),), **(session or {}))


def sent(**options: Any) -> np.ndarray:
    """What the program sends, shape [frame, 512]."""
    chosen = {**DEFAULTS, **options}
    return content(chosen["frames"], chosen["seed"], MODEL)


def emitting(frames: np.ndarray) -> np.ndarray:
    """Which frames of board `emulator` emit: its levels are the odd bytes."""
    return frames[:, 1::2].any(axis=1)


def assert_beginning_then_off(played: np.ndarray, wire: np.ndarray) -> int:
    """What was sent from its beginning, in order, then perhaps a torn frame, then off; returns frames that emitted.

    Whole frames may have been cleared before the torn one, whose part that did not come is silent.
    """
    count = int(np.count_nonzero(emitting(played)))
    assert emitting(played[:count]).all()
    assert len(played) > count, "no off frame"
    assert not emitting(played[count:]).any()
    if count == 0:
        return 0
    *whole, last = played[:count]
    assert np.array_equal(whole, wire[: count - 1]) or not whole
    if not np.array_equal(last, wire[count - 1]):
        came = int(np.flatnonzero(last)[-1]) + 1
        assert (wire[count - 1 :, :came] == last[:came]).all(axis=1).any()
    return count
