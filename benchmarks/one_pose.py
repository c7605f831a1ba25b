"""From one pose to the focal points until the next, live: how long it takes, on one core of a CPU, warm.

    python benchmarks/one_pose.py                       # every object at 10 and 40 kHz, 5,400 poses each
    python benchmarks/one_pose.py --objects tube --poses 54000

One line of JSON a case; median, 99th percentile and longest, in microseconds, of the poses that have contours (the
others take a fifth): wall; CPU time of the thread; and the least wall time of each pose in `--repeats` runs, which is
what it needs where nothing else runs. `over_bar`: the share of all poses that took longer than 1 ms. Poses are those of
an exploration at 90 Hz, one after the other, as a tracker gives them. The cases also run small as tests.
"""

import argparse
import functools
import json
import time
from dataclasses import dataclass

import numpy as np
import warp as wp

from palpate.datasets import exploration
from palpate.render import MeshObject, Palm, SamplingStrategy
from palpate.render.bench.cases import bench_object
from palpate.render.intersection.mesh_section import intersect
from palpate.render.intersection.prepared_contours import PreparedContours
from palpate.render.playback.live import POSE_INTERVAL, Instant
from palpate.render.strategies.intersection_strategy import PRESETS

BAR = 1000.0  # [us] p99
OBJECTS = ("cube", "tube", "dog", "sphere", "blob-100k")
RATES = (10_000.0, 40_000.0)  # [Hz]
ORDINARY = 100  # poses that are also rendered one by one as batches are


@dataclass(frozen=True)
class Case:
    thing: str
    update_rate: float
    strategy: str = "cc"


CASES = [Case(thing, rate) for thing in OBJECTS for rate in RATES]


@dataclass
class Stopwatch:
    """Wall and CPU times of calls [us]."""

    wall: list[float]
    cpu: list[float]

    def time(self, call, *arguments):
        cpu, wall = time.thread_time_ns(), time.perf_counter_ns()
        result = call(*arguments)
        self.wall.append((time.perf_counter_ns() - wall) / 1e3)
        self.cpu.append((time.thread_time_ns() - cpu) / 1e3)
        return result


def spread(values: np.ndarray) -> dict[str, float]:
    """Median, 99th percentile and longest."""
    return {"p50": float(np.median(values)), "p99": float(np.percentile(values, 99)), "max": float(values.max())}


@functools.cache
def object_of(name: str) -> MeshObject:
    return bench_object(name)


def measure(case: Case, pose_count: int, repeats: int) -> dict:
    """Figures of one case."""
    thing, hand, strategy = object_of(case.thing), Palm(), PRESETS[case.strategy]()
    motion = exploration(
        thing.bounds, duration=pose_count * POSE_INTERVAL, rate=1 / POSE_INTERVAL, seed=1, model="around"
    )
    contours = PreparedContours(thing, hand, strategy)
    whole, part, ordinary = (Stopwatch([], []) for _ in range(3))
    hit = np.array([part.time(contours.at_checked, pose).point_count > 0 for pose in motion.pose])
    if not hit.any():
        raise SystemExit(f"none of {pose_count} poses of {case.thing} has contours: take more")
    for _ in range(repeats):
        instant = Instant(thing, hand, strategy, SamplingStrategy(update_rate=case.update_rate))
        for pose, now in zip(motion.pose, motion.time.tolist(), strict=True):
            whole.time(instant.draw, pose, now)
    for pose in motion.pose[hit][:ORDINARY]:
        ordinary.time(one_by_one, thing, hand, pose, strategy)
    wall, cpu = (np.array(times).reshape(repeats, -1) for times in (whole.wall, whole.cpu))
    return {
        "object": case.thing,
        "triangles": len(thing.faces),
        "strategy": case.strategy,
        "update_rate": case.update_rate,
        "samples_a_pose": round(case.update_rate * POSE_INTERVAL, 1),
        "poses": len(motion),
        "repeats": repeats,
        "hit": float(hit.mean()),
        "wall_us": spread(wall[:, hit]),
        "cpu_us": spread(cpu[:, hit]),
        "needed_us": spread(wall.min(axis=0)[hit]),
        "wall_us_all": spread(wall),
        "contours_us": spread(np.array(part.wall)[hit]),
        "contours_as_a_batch_us": float(np.median(ordinary.wall)),
        "over_bar": float((wall > BAR).mean()),
    }


def one_by_one(thing: MeshObject, hand: Palm, pose: np.ndarray, strategy) -> None:
    """Contours of one pose as `render` computes those of many."""
    poses = wp.array(pose[None], dtype=wp.transform, device="cpu")
    intersect(thing, hand, poses, strategy)[0].numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--objects", nargs="+", default=OBJECTS)
    parser.add_argument("--rates", nargs="+", type=float, default=RATES)
    parser.add_argument("--strategy", choices=list(PRESETS), default="cc")
    parser.add_argument("--poses", type=int, default=5400)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for thing in options.objects:
        for rate in options.rates:
            print(json.dumps(measure(Case(thing, rate, options.strategy), options.poses, options.repeats)), flush=True)


if __name__ == "__main__":
    main()
