"""Which of the chosen poses a page holds, and what would fit."""

import math

import numpy as np


def spread(chosen: range, most: int) -> list[int]:
    """At most `most` of the chosen poses, evenly spread."""
    rows = np.unique(np.linspace(0, len(chosen) - 1, min(most, len(chosen))).astype(np.int64))
    return [chosen[int(row)] for row in rows]


def what_fits(chosen: range, share: float) -> str:
    """The arguments for those of the chosen poses that a page of `share` of the size holds; "" where it holds none.

    >>> what_fits(range(0, 1000), 0.25)
    'every=4, or poses="0:250"'
    """
    count = math.floor(len(chosen) * share)
    if count < 1:
        return ""
    every = chosen.step * math.ceil(len(chosen) / count)
    step = f" with every={chosen.step}" if chosen.step > 1 else ""
    return f'every={every}, or poses="{chosen.start}:{chosen.start + count * chosen.step}"{step}'
