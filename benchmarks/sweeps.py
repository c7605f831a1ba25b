"""What sweeping costs beside rendering: engine overhead, many recipes, two processes, metrics only, several GPUs.

    python benchmarks/sweeps.py overhead                         # one recipe and a plain rendering of its poses
    python benchmarks/sweeps.py recipes                          # the same poses as a hundred recipes
    python benchmarks/sweeps.py workers                          # two processes and two independent renderings
    python benchmarks/sweeps.py metrics --device cuda:0 --poses 100000000    # metrics only and the bare kernels
    python benchmarks/sweeps.py finished                         # until 10^4 finished recipes are recognised
    python benchmarks/sweeps.py devices --devices cuda:0 cuda:1  # one GPU, two, ...
    python benchmarks/sweeps.py parent --device cuda:0           # what the process with the store does for a chunk

Tube, CC, palm 85 x 85 mm, random poses. One line of JSON a case; sides take turns, medians of wall time.

| case | a sweep | beside |
|---|---|---|
| overhead | one recipe, metrics, one process, store included | contours and lengths of the same poses, one worker |
| recipes | a hundred recipes, as many poses | the same |
| workers | one recipe, two processes, their start left out | two processes that each render half |
| metrics | one recipe, metrics: by one process, by two (start left out) | find, join, draw of 4 M at a time |
| finished | `palpate sweep` once more | nothing |
| devices | one recipe, a process a device, start left out and told | one device |
| parent | one recipe, one process beside: processor time of this process a chunk | nothing |
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter, process_time, sleep

import numpy as np
import warp as wp
from loky.process_executor import ProcessPoolExecutor
from turns import seconds_by_turns

from palpate.datasets.motions.hand_motion import HandMotion
from palpate.kernels.metrics.random_pose import random_poses
from palpate.render.hands.hand import Palm
from palpate.render.intersection.batch_rendering import rendered_chunks
from palpate.render.intersection.job import ContourJob
from palpate.render.intersection.mesh_section import intersect
from palpate.render.intersection.scene import Scene
from palpate.render.objects.mesh.solid_mesh import MeshObject
from palpate.render.strategies.intersection_strategy import closed_contour
from palpate.render.sweeps.make.unit import CHUNK_POSES
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.run.executors import start_only, start_worker
from palpate.render.sweeps.run.sweep_run import run_sweep

BATCH = 4_000_000  # poses; of the bare kernels
CUBE = {"size": 0.13, "at": (0.0, 0.0, 0.2)}


class Workers:
    """Processes for a device, which live on from sweep to sweep, as they do through a long one."""

    def __init__(self, device: str, count: int) -> None:
        started = perf_counter()
        self.device = device
        self.executor = ProcessPoolExecutor(count, timeout=None, initializer=start_worker, initargs=(os.getpid(), 0))
        for future in [self.executor.submit(start_only) for _ in range(count)]:
            future.result()
        self.seconds = perf_counter() - started
        """Of the start."""

    def close(self) -> None:
        self.executor.shutdown(kill_workers=True)


class Sweeps:
    """Sweeps of the tube's CC, each into a store of its own."""

    def __init__(self, folder: Path, count: int, recipe_count: int = 1) -> None:
        self._folder, self._number = folder / str(count), 0
        self._folder.mkdir(exist_ok=True)
        self.poses = count // recipe_count * recipe_count
        path = self._folder / "plan.toml"
        path.write_text(
            f'[object]\nsource = "tube"\n[strategy]\nsource = "cc"\n[motion]\nsource = "random"\n'
            f"count = {count // recipe_count}\nseed = {{ first = 1, count = {recipe_count} }}\n"
        )
        self.plan = load_plans([path])

    def run(self, workers: Workers) -> None:
        """Sweep from nothing."""
        self._number += 1
        store = self._folder / f"store{self._number}"
        report = run_sweep(self.plan, store, workers.executor, device=workers.device)
        if report.failures or report.poses_rendered != self.poses:
            raise SystemExit(f"the sweep failed: {report}")

    def run_on(self, names: Sequence[str]) -> None:
        """Sweep from nothing on devices, processes started anew; a name that is repeated has so many processes."""
        self._number += 1
        store, repeated = self._folder / f"store{self._number}", names.count(names[0])
        workers = repeated if repeated == len(names) > 1 else None
        run_sweep(self.plan, store, device=",".join(dict.fromkeys(names)), workers=workers)


def tube_scene() -> Scene:
    return Scene.of(MeshObject.load("tube"), Palm(), closed_contour())


def host_poses(first: int, stop: int) -> np.ndarray:
    return random_poses(first, stop, seed=1, device="cpu", **CUBE).numpy().reshape(-1, 7)


def plain(poses: np.ndarray, device: str) -> Callable[[], None]:
    """Contours and lengths, one worker; a scene of its own, as the sweep has."""
    motion = HandMotion(None, poses)

    def run() -> None:
        for _ in rendered_chunks(ContourJob.of(tube_scene(), motion, device=device)):
            pass

    return run


def overhead(folder: Path, device: str, count: int, rounds: int, recipe_count: int = 1) -> dict:
    sweeps, one = Sweeps(folder, count, recipe_count), Workers(device, 1)
    sides = [lambda: sweeps.run(one), plain(host_poses(0, sweeps.poses), device)]
    swept, rendered = seconds_by_turns(sides, "wall", rounds)
    one.close()
    figures = {"poses": sweeps.poses, "recipes": recipe_count, "sweep_seconds": swept, "render_seconds": rendered}
    return figures | {"overhead": swept / rendered - 1, "poses_per_second": sweeps.poses / swept}


def bare(count: int, device: str) -> Callable[[], None]:
    """Find, join and draw; poses are there, batch after batch the same."""
    scene = tube_scene()
    batch = min(count, BATCH)
    pose = random_poses(0, batch, seed=1, device=device, **CUBE)

    def run() -> None:
        for _ in range(-(-count // batch)):
            intersect(scene.solid, scene.hand, pose, scene.strategy)
        wp.synchronize_device(device)

    return run


def metrics(folder: Path, device: str, count: int, rounds: int) -> list[dict]:
    count = count if count < BATCH else count // BATCH * BATCH
    sweeps, kernels = Sweeps(folder, count), bare(count, device)
    out = []
    for size in (1, 2):
        workers = Workers(device, size)
        swept, alone = seconds_by_turns([lambda own=workers: sweeps.run(own), kernels], "wall", rounds)
        workers.close()
        figures = {"processes": size, "poses": count, "sweep_seconds": swept, "kernel_seconds": alone}
        out.append(figures | {"share": alone / swept, "poses_per_second": count / swept})
    return out


def render_beside(first: int, stop: int, rounds: int, gate: object, out: object) -> None:
    """What an independent process does: wait for the others, render its share, tell the seconds."""
    wp.config.log_level = wp.LOG_ERROR
    run = plain(host_poses(first, stop), "cpu")
    run()
    for _ in range(rounds):
        gate.wait()
        started = perf_counter()
        run()
        out.put(perf_counter() - started)


def workers(folder: Path, count: int, rounds: int, worker_count: int = 2) -> dict:
    context = multiprocessing.get_context("spawn")
    gate, out = context.Barrier(worker_count + 1), context.SimpleQueue()
    share = count // worker_count
    beside = [
        context.Process(target=render_beside, args=(k * share, (k + 1) * share, rounds, gate, out), daemon=True)
        for k in range(worker_count)
    ]
    for process in beside:
        process.start()
    sweeps = Sweeps(folder, share * worker_count)
    own = Workers("cpu", worker_count)
    apart, together = [], []
    sweeps.run(own)
    for _ in range(rounds):
        gate.wait()
        apart.append(max(out.get() for _ in beside))
        sleep(0.1)  # they have ended
        started = perf_counter()
        sweeps.run(own)
        together.append(perf_counter() - started)
    for process in beside:
        process.join()
    own.close()
    figures = {"poses": sweeps.poses, "workers": worker_count, "start_seconds": own.seconds}
    seconds = {"sweep_seconds": float(np.median(together)), "apart_seconds": float(np.median(apart))}
    return figures | seconds | {"share": seconds["apart_seconds"] / seconds["sweep_seconds"]}


def devices(folder: Path, names: Sequence[str], count: int, rounds: int) -> list[dict]:
    """One device, then two, four, ...; the start of processes, which a sweep of few poses takes, is left out."""
    out: list[dict] = []
    for size in [size for size in (1, 2, 4, 8) if size <= len(names)]:
        part, named = folder / str(size), names[:size]
        part.mkdir()
        few, many = Sweeps(part, 1000), Sweeps(part, count)
        sides = [lambda s=few, n=named: s.run_on(n), lambda s=many, n=named: s.run_on(n)]
        start, whole = seconds_by_turns(sides, "wall", rounds)
        seconds = whole - start
        first = out[0]["seconds"] if out else seconds
        out.append({"devices": size, "poses": count, "start_seconds": start, "seconds": seconds})
        out[-1] |= {"poses_per_second": count / seconds, "speedup": first / seconds}
    return out


def parent(folder: Path, device: str, count: int, rounds: int) -> dict:
    sweeps, one = Sweeps(folder, count), Workers(device, 1)
    seconds = []
    for _ in range(rounds + 1):
        started = process_time()
        sweeps.run(one)
        seconds.append(process_time() - started)
    one.close()
    return {"poses": count, "parent_seconds_a_chunk": float(np.median(seconds[1:])) / -(-count // CHUNK_POSES)}


def finished(folder: Path, recipe_count: int, rounds: int) -> dict:
    """The command once more, wall time of its process; one pose a recipe."""
    plan = folder / "plan.toml"
    seeds = f"seed = {{ first = 1, count = {recipe_count} }}"
    plan.write_text(f'[object]\nsource = "cube"\n[motion]\nsource = "random"\ncount = 1\n{seeds}\n')
    command = [sys.executable, "-c", "from palpate.render.cli.app import main; main()", "sweep", str(plan)]
    seconds = []
    for _ in range(rounds + 1):
        started = perf_counter()
        subprocess.run([*command, "--workers", "1", "--device", "cpu", "--json"], check=True, capture_output=True)
        seconds.append(perf_counter() - started)
    return {"recipes": recipe_count, "first_seconds": seconds[0], "again_seconds": float(np.median(seconds[1:]))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", choices=("overhead", "recipes", "workers", "metrics", "finished", "devices", "parent"))
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--devices", nargs="+", default=["cpu", "cpu"])
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--recipes", type=int, help="a hundred, or 10,000 finished ones")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        measured = {
            "overhead": lambda: overhead(folder, options.device, options.poses, options.rounds),
            "recipes": lambda: overhead(folder, options.device, options.poses, options.rounds, options.recipes or 100),
            "workers": lambda: workers(folder, options.poses, options.rounds),
            "metrics": lambda: metrics(folder, options.device, options.poses, options.rounds),
            "finished": lambda: finished(folder, options.recipes or 10_000, options.rounds),
            "devices": lambda: devices(folder, options.devices, options.poses, options.rounds),
            "parent": lambda: parent(folder, options.device, options.poses, options.rounds),
        }[options.case]()
        for line in measured if isinstance(measured, list) else [measured]:
            place = options.devices if options.case == "devices" else options.device
            print(json.dumps({"case": options.case, "device": place, **line}), flush=True)


if __name__ == "__main__":
    main()
