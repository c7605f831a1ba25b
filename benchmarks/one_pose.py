"""From one pose to the focal points until the next, live; and from a contour file: on one core of a CPU, warm.

    python benchmarks/one_pose.py                                # both tables
    python benchmarks/one_pose.py --hands palm --objects tube --poses 54000
    python benchmarks/one_pose.py --hands                        # only those of a file

Prints tables as docs/measured/performance.md has them, and before each row its figures as a line of JSON. Poses are
those of an exploration at 90 Hz, one after the other, as a tracker gives them. Times are of the poses that have
contours, in microseconds: median, 99th percentile and longest, by the clock on the wall and by the CPU time of the
thread. The process runs under SCHED_FIFO where it may (as root, or with the limit `rtprio`), else a line says that it
does not; Python's garbage is not collected meanwhile. The cases also run small as tests.
"""

import argparse
import contextlib
import functools
import gc
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from turns import seconds_by_turns

from palpate.datasets import load_recording, write_sample
from palpate.render import (
    ContourBatch,
    ContourFile,
    Hand,
    MeshObject,
    Palm,
    PlaneHand,
    SamplingStrategy,
    exploration,
    flat_hand,
    record,
)
from palpate.render.bench.cases import bench_object
from palpate.render.intersection.named_inputs import hand_of
from palpate.render.intersection.prepared_contours import PreparedContours
from palpate.render.live.instant import POSE_INTERVAL, Instant
from palpate.render.playback.focal_points import POINTS_A_READ, ContourSource
from palpate.render.sampling.sampler import Sampler
from palpate.render.strategies.intersection_strategy import PRESETS

PRIORITY = 10  # of SCHED_FIFO
FILE_SECONDS = 30.0
WHAT = {
    "palm": "palm",
    "planes": "15 planes, rigid",
    "articulated": "15 planes, articulated",
    "skin": "skin mesh",
}


@dataclass(frozen=True)
class Case:
    hand: str
    thing: str
    strategy: str = "cc"
    update_rate: float = 10_000.0  # [Hz]

    @property
    def label(self) -> str:
        """The case as one word."""
        return f"{self.hand}-{self.thing}-{self.strategy}-{self.update_rate / 1000:g}"


CASES = [
    *(Case("palm", thing) for thing in ("cube", "tube", "dog", "sphere", "blob-100k")),
    Case("palm", "tube", update_rate=40_000.0),
    *(Case(hand, "tube", strategy) for hand in ("planes", "articulated") for strategy in ("oc", "cc")),
    Case("skin", "tube"),
]


@functools.cache
def object_of(name: str) -> MeshObject:
    return bench_object(name)


@functools.cache
def recorded_hand() -> PlaneHand:
    """A hand of 15 planes whose fingers move: a sample recording of Leap's."""
    with tempfile.TemporaryDirectory() as folder:
        recording = load_recording(write_sample("leap", Path(folder) / "hand.json")).held()
    return PlaneHand.from_joints(recording.joints_in_hand(), recording.radii(), is_left=recording.is_left)


@functools.cache
def hand_called(name: str) -> Hand:
    """The hand of a case; of an articulated one with its first pose."""
    if name == "articulated":
        hand = recorded_hand()
        assert hand.patch_pose is not None
        return replace(hand, patch_pose=hand.patch_pose[:1])
    return {"palm": Palm, "planes": flat_hand}[name]() if name != "skin" else hand_of("skin")


def patch_poses(name: str, count: int) -> Sequence[np.ndarray | None]:
    """Poses of a hand's patches at each of so many poses; the recording from its beginning, again and again."""
    if name != "articulated":
        return [None] * count
    patch_pose = recorded_hand().patch_pose
    assert patch_pose is not None
    return patch_pose[np.arange(count) % len(patch_pose)]


@contextlib.contextmanager
def undisturbed() -> Iterator[str]:
    """Nothing but the caller runs: no collection of garbage and, where it is allowed, no other process on its core."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        scheduling = "SCHED_FIFO"
    except PermissionError:
        scheduling = "ordinary"
    gc.collect()
    gc.disable()
    try:
        yield scheduling
    finally:
        gc.enable()
        os.sched_setscheduler(0, *before)


class Stopwatch:
    """Wall and CPU times of calls [us]."""

    def __init__(self) -> None:
        self.wall: list[float] = []
        self.cpu: list[float] = []

    def time(self, call: Callable[..., Any], *arguments: object, **named: object) -> Any:
        cpu, wall = time.thread_time_ns(), time.perf_counter_ns()
        result = call(*arguments, **named)
        self.wall.append((time.perf_counter_ns() - wall) / 1e3)
        self.cpu.append((time.thread_time_ns() - cpu) / 1e3)
        return result


def spread(values: Sequence[float], hit: np.ndarray) -> dict[str, float]:
    """Median, 99th percentile and longest of the poses that have contours; values: of all, once or more."""
    chosen = np.reshape(values, (-1, len(hit)))[:, hit]
    return {"p50": float(np.median(chosen)), "p99": float(np.percentile(chosen, 99)), "max": float(chosen.max())}


def measure(case: Case, pose_count: int, repeats: int) -> dict:
    """Figures of one case."""
    thing, hand, strategy = object_of(case.thing), hand_called(case.hand), PRESETS[case.strategy]()
    motion = exploration(
        thing.bounds, duration=pose_count * POSE_INTERVAL, rate=1 / POSE_INTERVAL, seed=1, model="around"
    )
    rows = list(zip(motion.pose, motion.time.tolist(), patch_poses(case.hand, len(motion)), strict=True))
    contours, part, whole = PreparedContours(thing, hand, strategy), Stopwatch(), Stopwatch()
    sampling = SamplingStrategy(update_rate=case.update_rate)
    for pose, _, patches in rows[: len(rows) // 4]:  # what is made once, and memory that grows, is not counted
        contours.at_checked(pose, contours.hand_at(patches))

    def contours_of(pose: np.ndarray, patches: np.ndarray | None) -> ContourBatch:
        return contours.at_checked(pose, contours.hand_at(patches))

    with undisturbed() as scheduling:
        hit = np.array([part.time(contours_of, pose, patches).point_count > 0 for pose, _, patches in rows])
        if not hit.any():
            raise SystemExit(f"none of {pose_count} poses of {case.thing} has contours: take more")
        for _ in range(repeats):
            instant = Instant(thing, hand, strategy, sampling)
            for pose, now, patches in rows:
                whole.time(instant.draw, pose, now, patch_pose=patches)
    return {
        "hand": case.hand,
        "object": case.thing,
        "triangles": len(thing.faces),
        "strategy": case.strategy,
        "update_rate": case.update_rate,
        "poses": len(motion),
        "repeats": repeats,
        "hit": float(hit.mean()),
        "scheduling": scheduling,
        "wall_us": spread(whole.wall, hit),
        "cpu_us": spread(whole.cpu, hit),
        "contours_us": spread(part.wall, hit),
    }


def measure_file(seconds: float, rounds: int, update_rate: float = 10_000.0) -> dict:
    """CPU time from a contour file of the tube's CC to its focal points and counts, as `play` makes them [s].

    `contours`: opening the file and reading the same blocks of contours, and nothing else.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tube.h5"
        motion = exploration(object_of("tube").bounds, duration=seconds, rate=90.0, seed=1, model="around")
        record(path, object_of("tube"), Palm(), motion, PRESETS["cc"](), devices=["cpu"])
        frames: list[int] = []

        def read() -> None:
            with ContourFile(path) as file:
                for first, stop in file.blocks(point_limit=POINTS_A_READ):
                    file.contours(first, stop)
                    file.motion(first, stop)

        def sample() -> None:
            with ContourFile(path) as file:
                source = ContourSource(file, Sampler(SamplingStrategy(update_rate=update_rate)))
                frames.append(sum(len(block.intensity) for block in source))

        with undisturbed() as scheduling:
            contours, whole = seconds_by_turns([read, sample], "cpu", rounds)
    return {
        "seconds": seconds,
        "update_rate": update_rate,
        "focal_points": frames[-1],
        "scheduling": scheduling,
        "contours": contours,
        "whole": whole,
        "beside_contours": whole - contours,
    }


def row_of(figures: dict) -> str:
    """A row of the table of poses."""
    what = f"{WHAT[figures['hand']]} | {figures['object']} | {figures['strategy'].upper()}"
    times = (figures[name] for name in ("wall_us", "cpu_us", "contours_us"))
    columns = " | ".join(f"{own['p50'] / 1e3:.3f} · {own['p99'] / 1e3:.3f}" for own in times)
    return f"| {what} | {figures['update_rate'] / 1000:g} kHz | {columns} |"


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hands", nargs="*", choices=list(WHAT), default=list(WHAT))
    parser.add_argument("--objects", nargs="+", default=sorted({case.thing for case in CASES}))
    parser.add_argument("--poses", type=int, default=5400)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    rows = []
    for case in CASES:
        if case.hand in options.hands and case.thing in options.objects:
            figures = measure(case, options.poses, options.repeats)
            print(json.dumps(figures), flush=True)
            rows.append(row_of(figures))
    figures = measure_file(FILE_SECONDS, options.repeats)
    print(json.dumps(figures), flush=True)
    if figures["scheduling"] != "SCHED_FIFO":
        print("ordinary scheduling: SCHED_FIFO is not allowed", file=sys.stderr)
    print("\n| hand | object | contours | rate | wall, p50 · p99 [ms] | CPU | contours alone, wall |")
    print("\n".join(["|---|---|---|---|---|---|---|", *rows]))
    print(f"\n| {figures['seconds']:g} s at {figures['update_rate'] / 1000:g} kHz from a file, CPU [s] | |\n|---|---|")
    print(f"| reading the contours | {figures['contours']:.3f} |\n| the rest | {figures['beside_contours']:.3f} |")


if __name__ == "__main__":
    main()
