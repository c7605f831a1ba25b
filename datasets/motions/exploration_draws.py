"""What chance decides of an exploration around an object: stroke by stroke, by one generator of random numbers."""

import itertools
from collections.abc import Generator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INTERVAL = 0.15  # between control points [s]: a hand changes its mind no faster
STANDOFF = 0.045  # from the bounds, before a visit [m]: half a palm

AROUND, INTO, BACK = range(3)
"""Strokes: around the object to a new direction; to a place in it; a little back."""


KIND, OCTANT, DEPTH, SPEED = range(4)
"""Columns of a stroke's numbers: its kind; from which octant it comes, after a stroke around; how deep it goes (0 the
object's middle, 1 its surface), or how far back [m]; its median speed [m/s]."""
ASIDE, DIRECTION, TURN, HASTE = slice(4, 7), slice(7, 10), slice(10, 13), 13
"""Further ones: how far aside, as shares of half the object's box; and of mean 0 and standard deviation 1, three
numbers of a direction, three of a tilt, one of the speed."""
_UNUSED = (0.0, 0.0, 0.0)

Draws = Generator[tuple[Array, tuple[float, ...]], int, None]
"""Gives numbers of mean 0 and standard deviation 1 for the tremor of the last stroke and of the rest after it,
[control, 3], and numbers of the next stroke, in these columns. Takes how many control points that one has."""


def stroke_draws(seed: int) -> Draws:
    """What is drawn of an exploration, for ever; the first stroke is one point, without tremor."""
    rng = np.random.default_rng(seed)
    octant = int(rng.integers(8))
    yield np.zeros((0, 3)), (AROUND, octant, 0.0, 1.0, *_UNUSED, *rng.standard_normal(6).tolist(), 0.0)
    tremor = np.zeros((1, 3))
    for octant in itertools.chain.from_iterable(rng.permutation(8).tolist() for _ in itertools.count()):
        count = yield tremor, (AROUND, octant, 0.0, 0.32, *_UNUSED, *rng.standard_normal(7).tolist())
        tremor = rng.standard_normal((count, 3))
        depths = [rng.uniform(0.8, 1.1), *rng.uniform(-0.25, 1.1, int(rng.integers(2, 5))).tolist()]
        for index, depth in enumerate(depths):
            aside = rng.uniform(-0.7, 0.7, 3).tolist()
            speed = 0.25 if index == 0 else 0.18
            count = yield tremor, (INTO, 0, depth, speed, *aside, *_UNUSED, *rng.standard_normal(4).tolist())
            tremor = rng.standard_normal((count, 3))
            if index > 0 and rng.random() < 0.5:
                resting = max(1, round(rng.uniform(0.2, 0.7) / INTERVAL))
                tremor = np.concatenate([tremor, rng.standard_normal((resting, 3))])
        far = rng.uniform(0.01, STANDOFF)
        count = yield tremor, (BACK, 0, far, 0.25, *_UNUSED, *_UNUSED, *rng.standard_normal(4).tolist())
        tremor = rng.standard_normal((count, 3))
