"""Several workers against as many independent processes, poses to contours on the host.

    python benchmarks/scaling.py --devices cpu cpu            # two cores
    python benchmarks/scaling.py --devices cuda:0 cuda:1      # two GPUs, two workers on each

One: the first device alone. Together: one rendering with workers on all devices. Apart: one process a device, each with
its share of the poses; the slowest counts, start of the process and compiling apart. Sides take turns; medians.
"""

import argparse
import json
import multiprocessing
import sys
from pathlib import Path
from time import perf_counter

import numpy as np
import warp as wp

sys.path.insert(0, str(Path(__file__).parent))
from palpate.render.bench.cases import random_poses
from palpate.render.hands.hand import Palm
from palpate.render.intersection.batch_rendering import rendered_chunks
from palpate.render.intersection.job import ContourJob
from palpate.render.intersection.scene import Scene
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.runtime.worker_devices import GPU_WORKERS
from palpate.render.strategies.intersection_strategy import closed_contour


def workers_on(devices: list[str]) -> list[str]:
    """Names of the workers' devices: one a core, two a GPU."""
    return [name for name in devices for _ in range(1 if name == "cpu" else GPU_WORKERS)]


def render_seconds(thing: str, poses: np.ndarray, devices: list[str]) -> float:
    """Seconds until the last chunk is on the host."""
    loaded = MeshObject.load(thing)
    scene = Scene.of(loaded, Palm(), closed_contour())
    few, all_poses = (ContourJob.of(scene, own, devices=devices) for own in (poses[:1000], poses))
    for _ in rendered_chunks(few):
        pass
    started = perf_counter()
    for _ in rendered_chunks(all_poses):
        pass
    return perf_counter() - started


def render_beside(
    thing: str, count: int, seed: int, devices: list[str], repeats: int, gate: object, out: object
) -> None:
    """What an independent process does: wait for the others before each repetition, render, and tell the seconds."""
    wp.config.log_level = wp.LOG_ERROR
    poses = random_poses(count, seed)
    for _ in range(repeats + 1):
        gate.wait()
        out.put((seed, render_seconds(thing, poses, devices)))


def measure(thing: str, devices: list[str], count: int, repeats: int) -> dict:
    """Figures of one object; `devices` names one a process."""
    context = multiprocessing.get_context("spawn")
    gate, out = context.Barrier(len(devices) + 1), context.SimpleQueue()
    share = count // len(devices)
    processes = [
        context.Process(target=render_beside, args=(thing, share, seed, workers_on([name]), repeats, gate, out))
        for seed, name in enumerate(devices)
    ]
    for process in processes:
        process.start()
    poses = random_poses(share * len(devices))
    one, together, apart = [], [], []
    for _ in range(repeats + 1):  # the first is not counted: it compiles
        gate.wait()
        apart.append(max(out.get()[1] for _ in devices))
        one.append(render_seconds(thing, poses, workers_on(devices[:1])))
        together.append(render_seconds(thing, poses, workers_on(devices)))
    for process in processes:
        process.join()
    medians = {"one": one, "together": together, "apart": apart}
    seconds = {name: float(np.median(values[1:])) for name, values in medians.items()}
    return {
        "object": thing,
        "devices": devices,
        "poses": len(poses),
        "seconds": seconds,
        "poses_per_second": {name: len(poses) / value for name, value in seconds.items()},
        "speedup": seconds["one"] / seconds["together"],
        "together_over_apart": seconds["apart"] / seconds["together"],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devices", nargs="+", default=["cpu", "cpu"], help="one a process; a core is cpu")
    parser.add_argument("--poses", type=int, default=400_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--objects", nargs="+", default=["cube", "tube"])
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for thing in options.objects:
        print(json.dumps(measure(thing, options.devices, options.poses, options.repeats)), flush=True)


if __name__ == "__main__":
    main()
