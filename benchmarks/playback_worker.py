"""Plays for benchmarks/playback.py, as told by JSON in its argument, and prints figures as one line of JSON."""

from __future__ import annotations

import json
import sys
import threading
import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import usb.backend.libusb1

from palpate.device import ArrayModel, EmulatorBackend, Link, Player, array_model, encode_frames
from palpate.device.boards.discovery import open_link
from palpate.device.playing.limits import Limits

CONTENT_FRAMES = 4096  # played round and round
BLOCK = 128  # frames: writes of 64 KiB
FILE_SECONDS, FILE_REPEATS = 0.3, 4
STOP_AFTER = (0.2, 0.4)  # [s] of playing


def main(options: dict[str, Any]) -> None:
    if "contours" in options:
        figures = frame_costs(options["contours"], options["array"], options["rounds"])
    else:
        figures = first_frames(options["file"]) if "file" in options else measure(options)
    sys.stdout.write(json.dumps(figures) + "\n")


def frame_costs(path: str, name: str, rounds: int) -> dict[str, float]:
    """CPU time of this process [us a frame] of a contour file and of its prepared frames, by turns; medians.

    made, copied: until the blocks are there; played: to the emulated board, whose own work counts, too.
    """
    from palpate.render import Driver, PlacedArray, play_file, prepare_frames
    from palpate.render.playback.focal_points import open_focal_points
    from palpate.render.playback.frames import MadeFrames
    from palpate.render.playback.prepared_frames import PreparedFrames

    arrays, frames = (PlacedArray(array_model(name)),), str(Path(path).with_name("frames.h5"))
    count = prepare_frames(path, frames, array=arrays).frames

    def make() -> None:
        with open_focal_points(Path(path), None, None, arrays) as (source, file):
            for _ in MadeFrames(source, Driver(arrays[0].model), file=file):
                pass

    def copy() -> None:
        with PreparedFrames(frames) as prepared:
            for _ in prepared:
                pass

    def play(file: str) -> None:
        limits = Limits(on_time_max=None, duty_max=None)
        play_file(file, array=arrays, limits=limits, emulate=True, clock="virtual")

    works = {"made": make, "copied": copy, "contours_played": lambda: play(path), "frames_played": lambda: play(frames)}
    costs: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(rounds):
        for label, work in works.items():
            started = time.process_time()
            work()
            costs[label].append((time.process_time() - started) / count * 1e6)
    return {"frames": count, **{label: float(np.median(own)) for label, own in costs.items()}}


def first_frames(path: str) -> dict[str, Any]:
    """From the call of `play_file` until the emulated board has bytes [s], the first time in a process and later."""
    from palpate.render.playback.file_playback import Connection, play_file

    def once() -> float:
        bus = EmulatorBackend()
        arrived: list[float] = []

        def watch() -> None:
            while not bus.board().bytes_received:
                time.sleep(2e-4)
            arrived.append(time.perf_counter())

        watcher = threading.Thread(target=watch)
        watcher.start()
        started = time.perf_counter()
        play_file(path, connection=Connection(backend=bus), duration=FILE_SECONDS)
        watcher.join()
        return arrived[0] - started

    times = [once() for _ in range(FILE_REPEATS)]
    return {"first": times[0], "later": max(times[1:])}


def measure(options: dict[str, Any]) -> dict[str, Any]:
    path = options.get("calibration")
    model = array_model(options["board"], calibration=path and Path(path))
    backend = EmulatorBackend() if options["emulated"] else usb.backend.libusb1.get_backend()
    with open_link(model, backend=backend, transport=options["transport"]) as link:
        first_write = FirstWrite(link)
        # what is measured emits for minutes on nothing that could get warm
        player = Player(link, limits=Limits(on_time_max=None, duty_max=None))
        if options["seconds"]:
            return play(player, model, options["update_rate"], options["seconds"], first_write)
        return {"stop_latency": stops(player, model, options["update_rate"], options["stops"])}


class FirstWrite:
    """When the link first has bytes under way or taken [s], on `time.perf_counter`."""

    def __init__(self, link: Link) -> None:
        self.time: float | None = None
        write = link.write

        def watched(data: array[int], *, abandon: Callable[[], bool] = lambda: False) -> None:
            write(data, abandon=abandon)
            self.time = self.time or time.perf_counter()

        link.write = watched  # type: ignore[method-assign]  # for the time of the benchmark


def content(model: ArrayModel) -> list[array[int]]:
    """Blocks of frames that all differ and all emit."""
    rng = np.random.default_rng(1)
    delay = rng.random((CONTENT_FRAMES, model.transducer_count), np.float32)
    wire = encode_frames(delay, rng.uniform(0.2, 1.0, delay.shape).astype(np.float32), array=model)
    return [array("B", wire[first : first + BLOCK].tobytes()) for first in range(0, CONTENT_FRAMES, BLOCK)]


def play(
    player: Player, model: ArrayModel, update_rate: float, seconds: float, first_write: FirstWrite
) -> dict[str, Any]:
    """Play for that long, without a stop."""
    blocks = content(model)

    def source() -> Iterator[array[int]]:
        for number in range(max(1, round(seconds * update_rate / BLOCK))):
            yield blocks[number % len(blocks)]

    cpu, started = time.process_time(), time.perf_counter()
    report = player.play(source(), update_rate=update_rate)
    elapsed = time.perf_counter() - started
    told = asdict(report)
    kept = ("transport", "underruns", "starved", "board_underruns", "short_writes", "lateness", "queue_depth")
    return {
        **{name: told[name] for name in kept},
        "bytes": report.bytes,
        "elapsed": elapsed,
        "rate": report.bytes / elapsed,
        "first_byte": (first_write.time or time.perf_counter()) - started,
        "cpu": (time.process_time() - cpu) / elapsed,
    }


def stops(player: Player, model: ArrayModel, update_rate: float, count: int) -> list[float]:
    """From `stop()` until `play` has returned, the array off [s], again and again at unlike moments."""
    blocks, latency = content(model), []
    after = np.random.default_rng(2).uniform(*STOP_AFTER, count)

    def source() -> Iterator[array[int]]:
        while True:
            yield from blocks

    for wait in after:
        asked: list[float] = []

        def stop(asked: list[float] = asked) -> None:
            asked.append(time.perf_counter())
            player.stop()

        timer = threading.Timer(wait, stop)
        timer.start()
        player.play(source(), update_rate=update_rate)
        latency.append(time.perf_counter() - asked[0])
        timer.join()
    return latency


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
