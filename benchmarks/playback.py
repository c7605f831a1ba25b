"""Playback for minutes: does it ever starve, what does it cost, how soon does it start and stop.

    python benchmarks/playback.py --seconds 600 --json playback.json

Each case plays in a process of its own. In process: the emulated bus behind pyusb's backend interface, written to by
the writer's thread. umockdev: the real libusb on an emulated bus in another process, queued transfers (needs what
tests/device/tiers/umockdev_session.py names). The busy CPU is a Python process that spins; there may be fewer cores
than processes, so the load average is told too. The cases also run small as tests
(tests/house/test_benchmarks_playback.py).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/device/tiers"))  # the emulated bus is theirs
from umockdev_session import Plug, run, write_pat_file

from palpate.render import MeshObject, Palm, closed_contour, exploration
from palpate.render.intersection.file_recording import record

WORKER = [sys.executable, str(Path(__file__).with_name("playback_worker.py"))]
POSE_RATE = 90.0  # [Hz]


@dataclass(frozen=True)
class Case:
    """One way of playing."""

    label: str
    bus: str  # "process" or "umockdev"
    transport: str
    update_rate: float  # [Hz]
    busy: bool = False
    board: str = "emulator"


CASES = (
    Case("40 kHz, in process", "process", "sync", 40e3),
    Case("40 kHz, umockdev", "umockdev", "queued", 40e3),
    Case("10 kHz, in process, busy", "process", "sync", 10e3, busy=True),
    Case("10 kHz, umockdev, busy", "umockdev", "queued", 10e3, busy=True),
    Case("10 kHz, pat16's FIFO, umockdev", "umockdev", "queued", 10e3, board="pat16"),
    Case("10 kHz, pat16's FIFO, umockdev, busy", "umockdev", "queued", 10e3, busy=True, board="pat16"),
)


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of each case")
    parser.add_argument("--stops", type=int, default=20, help="how often the latency of a stop is measured")
    parser.add_argument("--case", action="append", choices=[case.label for case in CASES], help="only this one")
    parser.add_argument("--poses", type=int, nargs="*", default=[2700, 100_000], help="of files, for the first frame")
    parser.add_argument("--prepared", type=float, default=10.0, help="seconds of motion of prepared frames")
    parser.add_argument("--json", type=Path, help="where the figures go, too")
    chosen = parser.parse_args()
    figures = {
        case.label: measure(case, seconds=chosen.seconds, stops=chosen.stops)
        for case in CASES
        if not chosen.case or case.label in chosen.case
    }
    for label, row in figures.items():
        print(f"{label}: {line(row)}", flush=True)
    for poses in chosen.poses:
        row = figures[f"file of {poses} poses"] = first_frame_of_file(poses)
        print(
            f"file of {poses} poses ({row['bytes'] / 1e6:.1f} MB): first byte {row['first'] * 1e3:.0f} ms after the "
            f"call of play_file, {row['later'] * 1e3:.0f} ms at most when called again",
            flush=True,
        )
    for name in ("emulator", "pat16"):
        row = figures[f"prepared frames, {name}"] = prepared_costs(name, seconds=chosen.prepared)
        print(
            f"{name}, CPU us a frame: made of contours {row['made']:.2f}, copied {row['copied']:.2f}; played to the "
            f"emulated board {row['contours_played']:.2f} and {row['frames_played']:.2f} ({row['frames']} frames)",
            flush=True,
        )
    if chosen.json:
        chosen.json.write_text(json.dumps(figures, indent=1))


def line(row: dict[str, Any]) -> str:
    """The figures of a case in words."""
    late = ", ".join(f"{key} {row['lateness'][key] * 1e3:.2f}" for key in row["lateness"])
    depth = row["queue_depth"] or {"min": 0, "mean": 0}
    stop = np.array(row["stop_latency"]) * 1e3
    return (
        f"{row['rate'] / 1e6:.2f} MB/s for {row['elapsed']:.1f} s by {row['transport']}; "
        f"underruns {row['underruns']} by the player, {row['board_underruns']} by the board; "
        f"queue [kB] min {depth['min'] / 1e3:.0f}, mean {depth['mean'] / 1e3:.0f}; lateness [ms] {late}; "
        f"CPU {row['cpu']:.0%} of a core; first byte after {row['first_byte'] * 1e3:.1f} ms; "
        f"stop [ms] median {np.median(stop):.1f}, max {stop.max():.1f} of {len(stop)}; load {row['load']:.1f}"
    )


def measure(case: Case, *, seconds: float, stops: int) -> dict[str, Any]:
    """Figures of a case, from processes that play it: one for the long run, one for the stops."""
    with spinning(case.busy), tempfile.TemporaryDirectory() as folder:
        played, board_underruns = in_process_of_its_own(case, Path(folder), seconds=seconds)
        stopped, _ = in_process_of_its_own(case, Path(folder), stops=stops)
    return {**vars(case), **played, "board_underruns": board_underruns, **stopped, "load": os.getloadavg()[0]}


def in_process_of_its_own(
    case: Case, folder: Path, *, seconds: float = 0.0, stops: int = 0
) -> tuple[dict[str, Any], int | None]:
    """What playback_worker.py tells, and the underruns by the board's own count."""
    work = {"board": case.board, "transport": case.transport, "update_rate": case.update_rate}
    if case.board == "pat16":
        work["calibration"] = str(folder / "board.pat")
        write_pat_file(folder / "board.pat", serial="BENCH")
    options = {**work, "emulated": case.bus == "process", "seconds": seconds, "stops": stops}
    if case.bus == "process":
        told = worker(options)
        return told, told.get("board_underruns")
    plug = Plug(case.board, "BENCH", record=0)
    outcome = run([*WORKER, json.dumps(options)], folder, plugs=(plug,), timeout=seconds + 5 * stops + 120)
    if outcome.returncode:
        raise RuntimeError(f"{case.label}: the player failed: {outcome.err}")
    return outcome.told, outcome.devices[0]["underruns"]


def first_frame_of_file(poses: int) -> dict[str, Any]:
    """How soon playing a CC file of the tube sends its first byte, in a loaded process [s]."""
    with tempfile.TemporaryDirectory() as folder:
        path = tube_file(Path(folder), poses / POSE_RATE)
        return {**worker({"file": str(path)}), "bytes": path.stat().st_size}


def prepared_costs(name: str, *, seconds: float, rounds: int = 5) -> dict[str, Any]:
    """CPU time a frame of playing a CC file of the tube, and its prepared frames, by turns in one process [us]."""
    with tempfile.TemporaryDirectory() as folder:
        path = tube_file(Path(folder), seconds)
        return worker({"contours": str(path), "array": name, "rounds": rounds})


def tube_file(folder: Path, seconds: float) -> Path:
    """A CC file of the tube, explored for so long."""
    path, tube = folder / "tube.h5", MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=seconds, rate=POSE_RATE, seed=1, model="around")
    record(path, tube, Palm(), motion, closed_contour(), devices=["cpu"])
    return path


def worker(options: dict[str, Any]) -> dict[str, Any]:
    """What playback_worker.py tells, run as it is."""
    done = subprocess.run([*WORKER, json.dumps(options)], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"playback_worker.py failed with {options}: {done.stderr}")
    return json.loads(done.stdout.splitlines()[-1])


@contextmanager
def spinning(wanted: bool) -> Iterator[None]:
    """A process beside that never rests."""
    if not wanted:
        yield
        return
    busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        busy.kill()
        busy.wait()


if __name__ == "__main__":
    main()
