"""Time of small batches, poses to contours that stay on the device: prepared for their number, and as usual, by turns.

    python benchmarks/small_batches.py --device cuda:0 --poses 1 100 1000 10000 100000

One line of JSON a number of poses: milliseconds a batch, medians of wall time; the device is waited for after each
batch. The cases also run small as tests (tests/house/test_benchmarks.py).
"""

import argparse
import json
from statistics import median
from time import perf_counter

import warp as wp

from palpate.render import MeshObject, Palm, PreparedContours, Scene
from palpate.render.bench.cases import random_poses


def measure(count: int, device: str, *, thing: str = "tube", strategy: str = "cc", rounds: int = 20) -> dict:
    """Figures of one number of poses."""
    mesh, pose = MeshObject.load(thing), wp.array(random_poses(count), dtype=wp.transform, device=device)
    scene, prepared = Scene.of(mesh, Palm(), strategy), PreparedContours(mesh, Palm(), strategy, count, device=device)
    source = pose.numpy() if device == "cpu" else pose
    points: list[int] = []
    taken: dict[str, list[float]] = {"prepared": [], "usual": []}
    for _ in range(rounds + 1):
        for name, make in (
            ("prepared", lambda: prepared.at_checked(source)),
            ("usual", lambda: scene.contours(pose, 0, device)[0]),
        ):
            started = perf_counter()
            batch = make()
            wp.synchronize_device(device)
            taken[name].append(1e3 * (perf_counter() - started))
            points.append(batch.point_count)
    if len(set(points)) != 1:
        raise SystemExit(f"numbers of points differ: {sorted(set(points))}")
    medians = {f"{name}_ms": median(own[1:]) for name, own in taken.items()}
    return {"object": thing, "strategy": strategy, "device": device, "poses": count, "points": points[0], **medians}


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, nargs="+", default=[1, 100, 1000])
    parser.add_argument("--objects", nargs="+", default=["cube", "tube"])
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for thing in given.objects:
        for count in given.poses:
            print(json.dumps(measure(count, given.device, thing=thing)), flush=True)


if __name__ == "__main__":
    main()
