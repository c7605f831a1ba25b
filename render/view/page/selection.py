"""Which poses of a file a page holds."""

import math
import operator
from typing import Any

import numpy as np

from ...errors import StrategyError
from ...validation import value_text
from ..file_scene import FileScene

Ends = str | tuple[int | None, int | None] | None
"""First pose and the pose after the last, as a text "FIRST:STOP" or two numbers; either may be left out (None)."""


def choose_rows(scene: FileScene, poses: Ends = None, every: int | None = None) -> range:
    """Numbers of the poses of a file that are shown; each `every`-th of the range `poses`.

    Raises StrategyError for a range that is none, holds no pose, or is not in the file.
    """
    if every is not None and (isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1):
        raise StrategyError(f"every must be a whole number of at least 1, not {value_text(every)}")
    first, stop = _ends(poses, scene.pose_count)
    if first < 0 or stop > scene.pose_count:
        raise StrategyError(f"poses {first}:{stop} are not all in {scene.path}, which has poses 0:{scene.pose_count}")
    if first >= stop:
        raise StrategyError(f"poses {first}:{stop} are none: the pose after the last must be greater than the first")
    return range(first, stop, int(every or 1))


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


def _ends(poses: Any, pose_count: int) -> tuple[int, int]:
    if poses is None:
        return 0, pose_count
    parts = poses.split(":") if isinstance(poses, str) else poses
    if not isinstance(parts, tuple | list) or len(parts) != 2:
        raise StrategyError(f"poses must be a range FIRST:STOP, as 100:200, 100: or :200, not {value_text(poses)}")
    try:
        first, stop = (
            default if end in (None, "") else int(end) if isinstance(end, str) else operator.index(end)
            for end, default in zip(parts, (0, pose_count), strict=True)
        )
    except (TypeError, ValueError):
        raise StrategyError(f"poses must be a range of whole numbers, FIRST:STOP, not {value_text(poses)}") from None
    return first, stop
