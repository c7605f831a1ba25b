"""Time of sampling many explorations at once: focal points and their counts, from contours that are made before.

    python benchmarks/batch_sampling.py --explorations 40
    python benchmarks/batch_sampling.py --device cuda:0 --explorations 10000 --at-once 500

One line of JSON a sampling: microseconds a pose (of 111 focal points at 10 kHz), on one thread of a CPU (CPU time) or a
GPU (wall time). The cases also run small as tests (tests/house/test_benchmarks.py).
"""

import argparse
import json
from functools import partial

import numpy as np
import warp as wp
from turns import seconds_by_turns

from palpate.render import ContourBatch, MeshObject, Palm, SamplingStrategy, Scene
from palpate.render.motions.explorations.explored import ExploredPoses, explored_rows
from palpate.render.sampling.metrics import MotionSamples
from palpate.render.sampling.presets import load_sampling
from palpate.render.sampling.sampler import sample_motions

DURATION, RATE = 30.0, 90.0
POSES = round(DURATION * RATE)  # of an exploration
SAMPLINGS = ("stm", "multi-focus", "pendulum")


def contours_of(first: int, stop: int, device: str, preset: str = "cc") -> tuple[ContourBatch, wp.array]:
    """Contours of explorations first..stop of the tube on a device, and their poses."""
    mesh = MeshObject.load("tube")
    given = {"duration": DURATION, "rate": RATE, "model": "over-array", "bounds": mesh.bounds}
    trials = [ExploredPoses.of(**given, seed=k, explorer=1 + k % 100) for k in range(first, stop)]
    pose = explored_rows([(poses, 0, POSES) for poses in trials], device)
    batch, _ = Scene.of(mesh, Palm(), preset).contours(pose, 0, device)
    return batch.to(device), pose


def sample(batch: ContourBatch, pose: wp.array, strategy: SamplingStrategy, device: str) -> MotionSamples:
    """All explorations of a batch at once."""
    count = len(pose) // POSES
    time = np.tile(np.arange(POSES) / RATE, count)
    start = POSES * np.arange(count + 1)
    out = sample_motions(batch, pose, time, start, np.full(count, DURATION), strategy, device=device)
    wp.synchronize_device(device)
    return out


def measure(sampling: str, device: str, explorations: int, *, at_once: int = 500, rounds: int = 3) -> dict:
    """Figures of one sampling."""
    strategy = load_sampling(sampling)
    seconds = 0.0
    for first in range(0, explorations, at_once):
        batch, pose = contours_of(first, min(first + at_once, explorations), device)
        run = partial(sample, batch, pose, strategy, device)
        seconds += seconds_by_turns([run], device, rounds if explorations <= at_once else 1)[0]
    figures = {"sampling": sampling, "device": device, "explorations": explorations}
    figures["us"] = 1e6 * seconds / (explorations * POSES)
    return figures


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--explorations", type=int, default=40)
    parser.add_argument("--at-once", type=int, default=500)
    parser.add_argument("--samplings", nargs="*", default=list(SAMPLINGS))
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for name in given.samplings:
        found = measure(name, given.device, given.explorations, at_once=given.at_once)
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
