"""Recipes and a store by hand, for tests of what is made of results."""

from collections.abc import Mapping

from palpate.render.playback.drive import DriveStrategy
from palpate.render.sampling.strategy import SamplingStrategy
from palpate.render.sweeps.plan.recipe import Recipe

PLACED = {"scale": 1.0, "up": "z", "fit": None, "rotate": [0, 0, 0], "at": [0, 0, 0.2]}
CUBE = {"size": 0.13, "at": [0, 0, 0.2]}
TRANSFORM = {"oc": [], "cc": ["close"], "hatch": ["close", {"stage": "hatch", "spacing": 0.01}]}
DRIVE = {name: getattr(DriveStrategy(), name) for name in DriveStrategy.__dataclass_fields__}


def recipe(thing="tube", strategy="cc", seed=1, speed=7.0, count=1000):
    """A recipe of random poses."""
    described = {"raw": "section", "prune": ["outside"], "transform": TRANSFORM[strategy]}
    sampling = {name: getattr(SamplingStrategy(), name) for name in ("update_rate", "foci")} | {"speed": speed}
    return Recipe(
        {"source": thing, "name": thing, "sha256": None, **PLACED, "volume": {}, "bounds": None, "simplify": None},
        {"source": "palm", "name": "palm", "sha256": None, "palm": [0.085, 0.085]},
        {"source": "random", "name": "random", "sha256": None, **CUBE, "seed": seed, "count": count},
        {"source": strategy, "name": strategy, "described": described, "step": None},
        {"source": "stm", "name": "stm", "described": sampling},
        {"source": "emulator", "name": "emulator", "described": {"identity": "emulator", "drive": DRIVE}},
    )  # fmt: skip


def statistic(values):
    """What a part's payload says of a metric."""
    return [len(values), sum(values), sum(v * v for v in values), min(values, default=None), max(values, default=None)]


def payload(poses=1000, **values):
    """A part's payload; values: of each metric."""
    return {
        "poses": poses,
        "poses_drawn": poses - 1,
        "stat": {name: statistic(list(own)) for name, own in values.items()},
        "seconds": {"find": 0.5, "draw": 0.25},
    }


class HandMadeStore:
    """Results by (group, key), a list of parts' payloads."""

    code = "hand"

    def __init__(self, results: Mapping[tuple[str, str], list[dict]]) -> None:
        self._results = results
        self.asked = 0

    def results(self, keys):
        """As a store gives them."""
        self.asked += 1
        for group, key in keys:
            for part, content in enumerate(self._results.get((group, key), ())):
                yield group, key, part, content


def table(*rows):
    """A table of rows, each a dict of the columns that matter; the others are made up."""
    base = {
        "object": "tube", "object_fit": None, "hand": "palm", "palm_width": 0.085, "palm_length": 0.085, "seed": 1,
        "strategy": "cc", "speed": 7.0, "poses": 100, "length_mean": 0.2, "r": 1.5, "draw_frequency_actual": 30.0,
        "jumps_pose": 4, "area_mean": 1e-3, "complete": True, "recipe": "{}", "maker": "hand", "seconds": 1.0,
    }  # fmt: skip
    whole = [base | {"recipe_hash": f"{k:032x}"} | row for k, row in enumerate(rows)]
    return {name: [row[name] for row in whole] for name in whole[0]}
