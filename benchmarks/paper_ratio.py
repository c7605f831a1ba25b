"""The founding paper's r = mean |CC| / mean |OC|, over synthetic explorations (Mulot et al. 2024, figure 6C).

The explorations are of the model `around`; explorers.py has persons over an array. The paper gives neither the palm's
size nor the hands' paths: the side of a square palm is fitted on the cube alone, and the tube and the dog are then
predictions.

    python benchmarks/paper_ratio.py --seeds 20
"""

import argparse

import numpy as np
import warp as wp
from scipy.optimize import brentq

from palpate.render import MeshObject, Palm, closed_contour, exploration, render
from palpate.render.reports.file_summary import length_ratio

PAPER = {"cube": 2.54, "tube": 1.48, "dog": 1.36}
DURATION, RATE = 30.0, 90.0  # [s], [Hz]


def ratios(thing: MeshObject, side: float, seeds: range) -> np.ndarray:
    """r of each exploration, one a seed; palm of this side [m]."""
    out = []
    for seed in seeds:
        motion = exploration(thing.bounds, duration=DURATION, rate=RATE, seed=seed, model="around")
        lengths = render(thing, Palm(side, side), motion, closed_contour()).lengths().sum(axis=0, dtype=np.float64)
        out.append(length_ratio(lengths.sum(), lengths[0]))
    return np.array(out)


def fitted_side(thing: MeshObject, r: float, seeds: range) -> float:
    """Side of the palm [m] at which the mean of r over the explorations is the given one."""
    return brentq(lambda side: ratios(thing, side, seeds).mean() - r, 0.06, 0.15, xtol=1e-4)


def table(seeds: range) -> list[dict]:
    """Means and standard deviations at the paper's usual palm, and at the one fitted on the cube."""
    things = {name: MeshObject.load(name) for name in PAPER}
    sides = (0.085, fitted_side(things["cube"], PAPER["cube"], seeds))
    rows = []
    for side in sides:
        for name, thing in things.items():
            r = ratios(thing, side, seeds)
            rows.append({"side": side, "object": name, "mean": r.mean(), "sd": r.std(ddof=1), "paper": PAPER[name]})
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for row in table(range(1, options.seeds + 1)):
        print("{side:.4f} m  {object:5s} r = {mean:.3f} +- {sd:.3f}   paper {paper}".format(**row))


if __name__ == "__main__":
    main()
