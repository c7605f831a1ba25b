"""Poses a second from poses to contours, results left on the device.

    python benchmarks/throughput.py --device cuda:0 --poses 4000000
    python benchmarks/throughput.py --save lengths.npz            # here
    python benchmarks/throughput.py --device cuda:0 --compare lengths.npz     # on a machine with a GPU

The cases also run small as tests (tests/test_benchmarks.py). Medians of `--repeats` runs; first runs are not counted.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parent))
from poses import random_poses

from palpate.render.contours import ContourBatch
from palpate.render.hands import Palm
from palpate.render.objects import MeshObject
from palpate.render.strategy import IntersectionStrategy, closed_contour, intersect, open_contour

CHUNK = 500_000  # poses at once; what a GPU is full with, and 10 GB of working arrays for the tube


@dataclass(frozen=True)
class Case:
    """One object and strategy."""

    thing: str
    label: str
    strategy: IntersectionStrategy


CASES = [
    Case(thing, label, strategy)
    for thing in ("cube", "tube", "dog", "sphere", "dog-detailed")
    for label, strategy in (("OC", open_contour()), ("CC", closed_contour()))
]


def run_once(case: Case, thing: MeshObject, pose: list[wp.array], timing: dict | None = None) -> list[ContourBatch]:
    """All chunks of one case; returns when the device is done."""
    batches = [intersect(thing, Palm(), part, case.strategy, timing=timing)[0] for part in pose]
    wp.synchronize_device(pose[0].device)
    return batches


def measure(case: Case, device: str, poses: np.ndarray, repeats: int) -> tuple[dict, np.ndarray]:
    """Figures of one case, and the lengths of all poses [m], shape [pose, kind]."""
    thing = MeshObject.load(case.thing)
    pose = [wp.array(poses[i : i + CHUNK], dtype=wp.transform, device=device) for i in range(0, len(poses), CHUNK)]
    batches = run_once(case, thing, pose)
    seconds = []
    for _ in range(repeats):
        del batches
        started = perf_counter()
        batches = run_once(case, thing, pose)
        seconds.append(perf_counter() - started)
    timing: dict[str, float] = {}
    lengths = np.concatenate([batch.lengths() for batch in batches])
    points = sum(batch.point_count for batch in batches)
    lines = sum(batch.polyline_count for batch in batches)
    del batches
    run_once(case, thing, pose, timing)
    median = float(np.median(seconds))
    figures = {
        "object": case.thing,
        "strategy": case.label,
        "device": device,
        "poses": len(poses),
        "seconds": median,
        "poses_per_second": len(poses) / median,
        "us_per_pose": 1e6 * median / len(poses),
        "hit": float(np.mean(lengths.sum(axis=1) > 0)),
        "points_per_pose": points / len(poses),
        "polylines_per_pose": lines / len(poses),
        "stages": {stage: value / sum(timing.values()) for stage, value in timing.items()},
    }
    return figures, lengths


def compare(lengths: np.ndarray, known: np.ndarray) -> dict:
    """How far two sets of lengths are apart [m]."""
    apart = np.abs(lengths.sum(axis=1, dtype=np.float64) - known.sum(axis=1, dtype=np.float64))
    return {
        "compared": len(known),
        "apart_max": float(apart.max()),
        "apart_over_1e-5": int((apart > 1e-5).sum()),
        "equal_bits": int((lengths == known).all(axis=1).sum()),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--objects", nargs="+", default=["cube", "tube"])
    parser.add_argument("--save", type=Path, help="write the lengths of all cases")
    parser.add_argument("--compare", type=Path, help="compare with lengths written by --save")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    poses = random_poses(options.poses)
    known = np.load(options.compare) if options.compare else {}
    saved = {}
    for case in CASES:
        if case.thing not in options.objects:
            continue
        figures, lengths = measure(case, options.device, poses, options.repeats)
        name = f"{case.thing}-{case.label}"
        saved[name] = lengths
        if name in known:  # as many poses as there: another count draws other poses
            _, same = measure(case, options.device, random_poses(len(known[name])), 1)
            figures["against_file"] = compare(same, known[name])
        print(json.dumps(figures), flush=True)
    if options.save:
        np.savez_compressed(options.save, **saved)


if __name__ == "__main__":
    main()
