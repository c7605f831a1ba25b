"""From a hand's place to the first focal point, as a board's model plays it, while another process keeps a core busy.

    python benchmarks/live_latency.py                                     # three arrays, three hands, a minute each
    python benchmarks/live_latency.py --duration 600 --arrays emulator-10 --hands palm
    python benchmarks/live_latency.py --no-realtime --leads 0.005 0.01 0.02 0.04
    python benchmarks/live_latency.py --cores 0 1                         # on two cores of a larger machine
    python benchmarks/live_latency.py --duration 20 --hands palm --view 3 # three pairs: without and with a viewer

A process of its own sends a hand by UDP at 90 Hz, with the time of CLOCK_MONOTONIC at which it is sent, which the
source takes as it is. The object is the tube, the strategy CC. Prints a line of JSON for each run, and a table as
docs/measured/live.md has it: latency in milliseconds, of all poses and of the first and the last tenth of the run;
frames dropped, and seconds that hold one. With `--view` each run is made so many times without and with a thread that
reads moments 30 times a second, in turn.
"""

import argparse
import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from palpate.datasets.recordings.sample import sample_recording
from palpate.datasets.rigid import pose_inverse, pose_product
from palpate.device import Limits
from palpate.render import SamplingStrategy, exploration
from palpate.render.live.handle import Live
from palpate.render.live.sources.udp import UdpSource

RATE = 90.0  # [Hz] of poses
ARRAYS = {"emulator-10": ("emulator", 10e3), "emulator-40": ("emulator", 40e3), "pat16-10": ("pat16", 10e3)}
HANDS = {"palm": "palm", "planes": "planes", "skin": "skin"}
BUSY = "while True: pass"
VIEW_RATE = 30.0  # [Hz] at which a viewer reads moments


def send_hands(port: int, hand: str, duration: float) -> None:
    """Send a hand that explores, at 90 Hz; of planes its joints, which close and open."""
    motion = exploration("tube", duration=60.0, rate=RATE)
    recording = sample_recording(frame_count=90, rate=RATE)
    joints = pose_product(pose_inverse(recording.skin_pose()[:, None]), recording.joint_pose)
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    began = time.monotonic()
    for number in range(round(duration * RATE)):
        time.sleep(max(began + number / RATE - time.monotonic(), 0))
        pose = motion.pose[number % len(motion)].astype(np.float64)
        if hand == "planes":
            placed = pose_product(pose, joints[number % len(joints)])
            seen = {"joints": placed.tolist(), "radius": recording.joint_radius.tolist()}
        else:
            seen = {"palm": pose.tolist()}
        frame = {"time": time.monotonic(), "side": "right", "id": 1, **seen}
        sender.sendto(json.dumps(frame).encode(), ("127.0.0.1", port))


def free_port() -> int:
    """A port that nobody has now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        trial.bind(("127.0.0.1", 0))
        return trial.getsockname()[1]


@contextlib.contextmanager
def processes(*commands: Sequence[str]) -> Iterator[None]:
    """While active, these run."""
    running = [subprocess.Popen(command) for command in commands]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


class Viewer(threading.Thread):
    """Reads moments of a run 30 times a second until `stop`, with the hand's look, as a page needs it."""

    def __init__(self, live: Live) -> None:
        super().__init__(daemon=True)
        self._live, self._stopping = live, threading.Event()
        self.numbers: set[int] = set()
        """Of the moments that were read."""
        self.times: list[float] = []
        """What each reading took [s]."""

    def run(self) -> None:
        """Read until `stop`."""
        due = time.monotonic()
        while not self._stopping.wait(max(due - time.monotonic(), 0.0)):
            due += 1 / VIEW_RATE
            began = time.perf_counter()
            if (moment := self._live.moment()) is not None and moment.hand is not None:
                self.numbers.add(moment.number)
            self.times.append(time.perf_counter() - began)

    def stop(self) -> dict[str, Any]:
        """End the thread; how many moments it has read, and what reading one takes."""
        self._stopping.set()
        self.join()
        return {
            "moments": len(self.numbers),
            "moments_per_second": round(len(self.numbers) * VIEW_RATE / len(self.times), 1),
            "read_p50_us": round(float(np.median(self.times)) * 1e6),
            "read_p99_us": round(float(np.quantile(self.times, 0.99)) * 1e6),
        }


def measure(
    array: str, hand: str, *, duration: float, lead: float, realtime: bool, busy_core: int | None, is_viewed: bool
) -> dict[str, Any]:
    """One run; is_viewed: with a viewer that reads moments."""
    (name, rate), port = ARRAYS[array], free_port()
    sender = [sys.executable, __file__, "--send", str(port), hand, str(duration + 30)]
    busy = [sys.executable, "-c", BUSY]
    if busy_core is not None:
        busy = ["taskset", "-c", str(busy_core), *busy]
    live = Live(
        "tube",
        hand=HANDS[hand],
        sampling=SamplingStrategy(update_rate=rate),
        source=UdpSource(port=port, clock="monotonic"),
        array=name,
        emulate=True,
        lead=lead,
        limits=Limits(on_time_max=None, duty_max=None),
        realtime=realtime,
    )
    with processes(sender, busy), live:
        while not live.statistics().poses:
            live.wait(0.1)
        viewer = Viewer(live) if is_viewed else None
        if viewer is not None:
            viewer.start()
        live.wait(duration)
        viewed = {} if viewer is None else viewer.stop()
    own, latency = live.statistics(), live.latencies() * 1e3
    tenth = max(len(latency) // 10, 1)
    return {
        "array": array,
        "hand": hand,
        "lead_ms": lead * 1e3,
        "realtime": own.realtime,
        "seconds": round(own.seconds, 1),
        "poses": own.poses,
        "p50_ms": round(own.latency.p50 * 1e3, 2),
        "p99_ms": round(own.latency.p99 * 1e3, 2),
        "longest_ms": round(own.latency.longest * 1e3, 2),
        "first_p50_ms": round(float(np.median(latency[:tenth])), 2),
        "last_p50_ms": round(float(np.median(latency[-tenth:])), 2),
        "age_p99_ms": round(own.age.p99 * 1e3, 2),
        "frames": own.frames,
        "dropped": own.dropped,
        "dropped_seconds": own.dropped_seconds,
        "superseded": own.superseded,
        "pose_ms": round(own.pose_seconds * 1e3, 2),
        "off_confirmed": live.outcome["off_confirmed"],
        **viewed,
    }


HEAD = (
    "| array | hand | lead | p50 | p99 | longest | first, last tenth | dropped frames | seconds with one |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def row_of(run: dict[str, Any]) -> str:
    """A row of the table."""
    hand = f"{run['hand']}, viewed" if "moments" in run else run["hand"]
    return (
        f"| {run['array']} kHz | {hand} | {run['lead_ms']:g} | {run['p50_ms']} | {run['p99_ms']} | "
        f"{run['longest_ms']} | {run['first_p50_ms']}, {run['last_p50_ms']} | {run['dropped']} of {run['frames']} | "
        f"{run['dropped_seconds']} of {run['seconds']:.0f} |"
    )


def main() -> None:
    """Measure what the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arrays", nargs="+", default=list(ARRAYS), choices=ARRAYS)
    parser.add_argument("--hands", nargs="+", default=list(HANDS), choices=HANDS)
    parser.add_argument("--duration", type=float, default=60.0, help="of each run [s]")
    parser.add_argument("--leads", type=float, nargs="+", default=[6e-3], help="[s]")
    parser.add_argument("--no-realtime", action="store_true")
    parser.add_argument("--cores", type=int, nargs=2, help="run on these two, the second of which is kept busy")
    parser.add_argument("--view", type=int, metavar="PAIRS", help="each run so often without and with a viewer")
    parser.add_argument("--send", nargs=3, metavar=("PORT", "HAND", "SECONDS"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.send:
        send_hands(int(options.send[0]), options.send[1], float(options.send[2]))
        return
    if options.cores:
        os.sched_setaffinity(0, options.cores)
    runs = []
    for array in options.arrays:
        for hand in options.hands:
            for lead in options.leads:
                for is_viewed in [False, True] * options.view if options.view else [False]:
                    run = measure(
                        array,
                        hand,
                        duration=options.duration,
                        lead=lead,
                        realtime=not options.no_realtime,
                        busy_core=options.cores[1] if options.cores else None,
                        is_viewed=is_viewed,
                    )
                    runs.append(run)
                    print(json.dumps(run), flush=True)
    print("\n".join([HEAD, *map(row_of, runs)]))


if __name__ == "__main__":
    main()
