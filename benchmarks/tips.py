"""What looking for tips costs: contours (CC) of functions on palms of 34 x 34 cells, random poses, on one device.

    python benchmarks/tips.py
    python benchmarks/tips.py --device cuda:0 --poses 50000

"with" and "without" are measured by turns, and the medians are given, one line of JSON an object: microseconds a
section (CPU time on the CPU, else wall time until the device is done), and points. Without: the field has a grain
above a step, so that marching squares alone is left.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import warp as wp

from palpate.kernels.contours import Contours
from palpate.kernels.march.contours import march_patches
from palpate.render import ImplicitObject, Palm, Placement
from palpate.render.bench.cases import random_poses
from palpate.render.objects.functions.expression import Expression, box, cylinder, half_space, sphere, torus

STEP = 0.0025


def wedge(angle: float) -> Expression:
    """Half-spaces that meet at an angle [degrees], cut off 60 mm behind the edge."""
    slope = np.tan(np.radians(angle / 2))
    sides = [half_space((side, 0, slope), 0) for side in (1, -1)]
    return sides[0] & sides[1] & box(0.12, 0.12, 0.12)


OBJECTS = {
    "sphere of 50 mm": sphere(0.05),
    "torus of 45 and 14 mm": torus(0.045, 0.014),
    "sphere of 10 mm": sphere(0.01),
    "box of 90 mm": box(0.09, 0.09, 0.09),
    "tube": cylinder(0.06, 0.13) - cylinder(0.035, 0.2),
    "wedge of 20 degrees": wedge(20),
    "sphere less sphere": sphere(0.05) - sphere(0.05).moved(0.02, 0, 0),
}


def marching(tree: Expression, pose: wp.array, device: str, *, tips: bool) -> Callable[[], Contours]:
    """A function that renders an object on all poses."""
    thing = ImplicitObject(tree, placement=Placement(at=(0, 0, 0.2)))
    field = thing.field_on(device)._replace(grain=0.0 if tips else 1.0)
    patch = Palm().on(device)
    return lambda: march_patches(field, pose, patch, step=STEP, bounds=thing.bounds, bounded=True, closes=True)


def seconds(run: Callable[[], Contours], device: str) -> float:
    """Time of one call."""
    clock = time.process_time if device == "cpu" else time.perf_counter
    wp.synchronize_device(device)
    start = clock()
    run()
    wp.synchronize_device(device)
    return clock() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=1500)
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    poses = random_poses(options.poses)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=options.device)
    for name, tree in OBJECTS.items():
        runs = {way: marching(tree, pose, options.device, tips=way == "with") for way in ("without", "with")}
        points = {way: run().points.shape[0] for way, run in runs.items()}  # compiles, too
        times: dict[str, list[float]] = {way: [] for way in runs}
        for _ in range(options.rounds):
            for way, run in runs.items():
                times[way].append(seconds(run, options.device))
        figures = {way: round(statistics.median(t) / options.poses * 1e6, 2) for way, t in times.items()}
        print(json.dumps({"object": name, "microseconds": figures, "points": points}), flush=True)


if __name__ == "__main__":
    main()
