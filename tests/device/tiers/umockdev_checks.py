"""What the tests of the umockdev tier share: playing on the emulated bus, and what a board must have played."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from umockdev_player import content
from umockdev_session import Outcome, Plug, run, write_pat_file

from palpate.device import array_model

PALPATE = str(Path(sys.executable).with_name("palpate"))
PLAYER = str(Path(__file__).with_name("umockdev_player.py"))
FRAME = 512
SERIAL = "FT4TKZL8"
TRANSPORTS = ("sync", "queued")


def play(
    folder: Path,
    *,
    array: str = "emulator",
    faults: tuple[dict[str, Any], ...] = (),
    session: dict[str, Any] | None = None,
    **options: Any,
) -> Outcome:
    """Run the playing program on a bus with one board; a pat16 gets a board file, and Linux's driver holds its chip."""
    plug = Plug(faults=faults)
    if array == "pat16":
        options["pat"] = str(folder / "board.pat")
        write_pat_file(folder / "board.pat", serial=SERIAL)
        plug = Plug("pat16", SERIAL, driver="ftdi_sio", faults=faults)
    command = [sys.executable, PLAYER, json.dumps({"array": array, **options})]
    return run(command, folder, plugs=(plug,), **(session or {}))


def sent(frames: int, folder: Path | None = None) -> np.ndarray:
    """What the program sends to an emulator, or to the pat16 of the folder's board file, shape [frame, 512]."""
    return content(
        frames, 0, array_model("emulator") if folder is None else array_model("pat16", calibration=folder / "board.pat")
    )


def emitting(frames: np.ndarray, array: str = "emulator") -> np.ndarray:
    """Which frames emit: an emulator's levels are the odd bytes, a pat16's widths the last 256."""
    return (frames[:, 256:] if array == "pat16" else frames[:, 1::2]).any(axis=1)


def assert_beginning_then_off(played: np.ndarray, wire: np.ndarray) -> int:
    """What was sent from its beginning, in order, then perhaps a torn frame, then off; returns frames that emitted.

    Whole frames may have been cleared before the torn one, whose part that did not come is silent.
    """
    count = int(np.count_nonzero(emitting(played)))
    assert emitting(played[:count]).all()
    assert len(played) > count, "no off frame"
    if count == 0:
        return 0
    *whole, last = played[:count]
    assert np.array_equal(whole, wire[: count - 1]) or not whole
    if not np.array_equal(last, wire[count - 1]):
        came = int(np.flatnonzero(last)[-1]) + 1
        assert (wire[count - 1 :, :came] == last[:came]).all(axis=1).any()
    return count
