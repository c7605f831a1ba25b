"""Numbers that a user's function gives of each pose: validated, and added up in an order that never changes.

The function is called with the contours of one span after another, counted from the chunk's first pose. So its results
do not depend on how poses are put into batches, whatever it does.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from ...contour_batch import ContourBatch
from ...errors import SweepError
from .unit import SPAN, text_of

Payload = dict[str, Any]
Numbers = dict[str, np.ndarray]
"""A number for each pose, by key; of a function that returns one array, the key is empty."""


@dataclass(frozen=True)
class UserMetric:
    """A function of contours, and the group of its results."""

    group: str
    source: str
    """`file.py:function` or `package.module:function`, for messages."""
    function: Callable[[ContourBatch], Any] = field(compare=False)

    def numbers(self, contours: ContourBatch) -> Numbers:
        """The function's numbers of poses, float64; raises SweepError, naming what came and what is expected."""
        for array in contours.by_name().values():
            array.flags.writeable = False  # other metrics see the same arrays
        try:
            found = self.function(contours)
        except BaseException as error:  # in a worker, whose Ctrl-C is its parent's: all of these are the function's own
            raise SweepError(f"metric {self.source}: raised {type(error).__name__}: {text_of(error)}") from error
        if not isinstance(found, Mapping):
            return {"": self._checked(found, "", contours.pose_count)}
        if not found or not all(isinstance(key, str) and key.isidentifier() for key in found):
            keys = ", ".join(f"{key!r:.40}" for key in found) or "none"
            raise SweepError(f"metric {self.source}: the keys of its dict must be names such as 'corners', not {keys}")
        return {key: self._checked(found[key], f" as {key!r}", contours.pose_count) for key in sorted(found)}

    def _checked(self, found: Any, key: str, pose_count: int) -> np.ndarray:
        """Numbers as float64, shape [pose]."""
        wanted = f"metric {self.source}: must return{key} one number per pose, an array of shape [{pose_count}]"
        try:
            array = np.asarray(found)
        except Exception as error:  # of lists of several lengths, and of whatever has an __array__
            raise SweepError(f"{wanted}, not {type(found).__name__} ({error})") from error
        if array.dtype.kind not in "biuf":
            raise SweepError(f"{wanted}, not {type(found).__name__} of {array.dtype} ({found!r:.60})")
        if array.shape != (pose_count,):
            raise SweepError(f"{wanted}, not of shape {list(array.shape)}")
        numbers = array.astype(np.float64)
        if np.isinf(numbers).any():
            first = int(np.flatnonzero(np.isinf(numbers))[0])
            raise SweepError(f"{wanted}, each finite or NaN, not {numbers[first]} at pose {first} of the span")
        return numbers


def measure(metric: UserMetric, batch: ContourBatch, first: int, count: int, before: Payload | None) -> Payload:
    """What is stored of poses first..first + count of a batch on the host, which begin at a span of their chunk.

    before: what is stored of the poses of the chunk before these. Returns {"poses": n, "stat": {key: [count, sum, sum
    of squares, least, greatest]}, "seconds": {"metrics": s}}; NaN does not count.
    Raises SweepError for what is no number per pose, and for other keys than before.
    """
    started = perf_counter()
    known = before or {"poses": 0, "stat": {}, "seconds": {"metrics": 0.0}}
    stat: dict[str, list[Any]] = known["stat"]
    for begin in range(first, first + count, SPAN):
        numbers = metric.numbers(batch.select(begin, min(begin + SPAN, first + count)))
        if stat and set(numbers) != set(stat):
            raise SweepError(
                f"metric {metric.source}: must return the same keys for all poses, first {_shown(stat)}, then "
                f"{_shown(numbers)}"
            )
        stat = {key: _added(stat.get(key), own[~np.isnan(own)].tolist()) for key, own in numbers.items()}
    seconds = {"metrics": known["seconds"]["metrics"] + perf_counter() - started}
    return {"poses": known["poses"] + count, "stat": stat, "seconds": seconds}


def _added(known: Sequence[Any] | None, numbers: Sequence[float]) -> list[Any]:
    """Statistics with those of one more span, whose sums are exact before they are rounded."""
    count, total, square, least, greatest = known or (0, 0.0, 0.0, None, None)
    if not numbers:
        return [count, total, square, least, greatest]
    return [
        count + len(numbers),
        total + math.fsum(numbers),
        square + math.fsum(number * number for number in numbers),
        min(numbers) if least is None else min(least, *numbers),
        max(numbers) if greatest is None else max(greatest, *numbers),
    ]


def _shown(keys: Mapping[str, Any]) -> str:
    return ", ".join(key or "one array" for key in keys)
