"""A program that plays to an array on whatever bus libusb shows it, and prints what came of it as one line of JSON.

Run by the tests of the umockdev tier, and by benchmarks/playback.py: `python umockdev_player.py '{"frames": 1000}'`.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import usb.backend.libusb1

from palpate.device import Player, array_model, encode_frames
from palpate.device.boards.discovery import open_link
from palpate.device.playing.watchdog import Watchdog

DEFAULTS: dict[str, Any] = {
    "array": "emulator",
    "serial": None,
    "pat": None,  # the array's .pat file
    "transport": "auto",
    "rate": 40_000.0,
    "frames": 3000,
    "block": 64,
    "seed": 0,
    "plays": 1,  # play this often, each after whatever became of the one before
    "stop_after": None,  # frames that the array has taken when `Player.stop` is called
    "forever": False,  # the content again and again
    "pause_at": None,  # block before which the source sleeps
    "pause": 0.0,  # [s]
    "watchdog": False,
}


def content(frames: int, seed: int, model: Any) -> np.ndarray:
    """Wire bytes of frames that all differ and all emit, shape [frame, frame_bytes]."""
    rng = np.random.default_rng(seed)
    delay = rng.random((frames, model.transducer_count), np.float32)
    amplitude = rng.uniform(0.2, 1.0, (frames, model.transducer_count)).astype(np.float32)
    return encode_frames(delay, amplitude, array=model)


def blocks(options: dict[str, Any], wire: np.ndarray) -> Iterator[array]:
    size = options["block"]
    made = [array("B", wire[first : first + size].tobytes()) for first in range(0, len(wire), size)]
    while True:
        for number, block in enumerate(made):
            if number == options["pause_at"]:
                time.sleep(options["pause"])
            yield block
        if not options["forever"]:
            return


def play_once(player: Player, options: dict[str, Any], wire: np.ndarray) -> dict[str, Any]:
    """The report, and the error if there was one."""
    error = None

    def progress(frames: int) -> None:
        if options["stop_after"] is not None and frames >= options["stop_after"]:
            player.stop()

    player.report = None
    try:
        player.play(blocks(options, wire), update_rate=options["rate"], progress=progress)
    except (Exception, KeyboardInterrupt) as caught:
        error = caught
    report = player.report.as_dict() if player.report else {}
    report.pop("underrun_events", None)
    return {"error": type(error).__name__ if error else None, "message": str(error or ""), **report}


def main(options: dict[str, Any]) -> None:
    model = array_model(options["array"], calibration=options["pat"] and Path(options["pat"]))
    wire = content(options["frames"], options["seed"], model)
    backend = usb.backend.libusb1.get_backend()
    played: list[dict[str, Any]] = []
    with contextlib.ExitStack() as stack:
        link = stack.enter_context(
            open_link(model, serial=options["serial"], backend=backend, transport=options["transport"])
        )
        if options["watchdog"]:
            stack.enter_context(Watchdog(link))
        player = Player(link)
        played += [play_once(player, options, wire) for _ in range(options["plays"])]
    sys.stdout.write(json.dumps({"plays": played, "threads": threading.active_count()}) + "\n")


if __name__ == "__main__":
    main({**DEFAULTS, **json.loads(sys.argv[1])})
