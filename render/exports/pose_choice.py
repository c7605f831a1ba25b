"""Which poses of a contour file are exported, and their contours block by block."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile, join_contours
from ...datasets.storage.schema import CONTOURS, Arrays
from ..errors import StrategyError
from ..validation import value_text

Ends = str | tuple[Any, Any] | None
"""Where a range begins and ends, as a text "FIRST:STOP" or two values; either may be left out (None)."""

Progress = Callable[[int, int], object]
"""Is called with how much is done, and with all that there is to do."""

POINTS_A_BLOCK = 1 << 18
SPARSE = 64  # of so many poses, one is read alone: faster than reading all and leaving out the others


class ExportBlock(NamedTuple):
    """Contours of some of the chosen poses."""

    number: np.ndarray
    """Of each pose in the file, from 0; int64, shape [pose]."""
    contours: Arrays
    """Arrays of /contours by name, offsets from 0 (docs/formats/file-format.md)."""


def choose_poses(
    file: ContourFile, poses: Ends = None, seconds: Ends = None, every: int = 1, *, may_lack: bool = False
) -> range:
    """The numbers of the chosen poses; all of them can be read, unless poses that are not rendered yet `may_lack`.

    poses: first pose, and the pose after the last. seconds: the same by the poses' times [s]. every: n for each n-th.
    Raises StrategyError for a range that is none, lies outside the file, holds no pose, or is not done yet.
    """
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise StrategyError(f"every must be a whole number of at least 1, not {value_text(every)}")
    if poses is not None and seconds is not None:
        raise StrategyError("a range is given by poses or by seconds, not by both")
    first, stop = 0, file.pose_count
    if poses is not None:
        first, stop = _by_number(file, poses)
    elif seconds is not None:
        first, stop = _by_time(file, seconds)
    if not may_lack:
        _require_done(file, first, stop)
    return range(first, stop, int(every))


def chosen_blocks(file: ContourFile, chosen: range) -> Iterator[ExportBlock]:
    """Contours of the chosen poses, in blocks of bounded size, in order."""
    for first, stop in file.blocks(point_limit=POINTS_A_BLOCK):
        low, high = max(first, chosen.start), min(stop, chosen.stop)
        low += -(low - chosen.start) % chosen.step
        if low >= high:
            continue
        part = range(low, high, chosen.step)
        yield ExportBlock(np.array(part), picked(file, part))


def picked(file: ContourFile, part: range) -> Arrays:
    """Contours of some poses of a file, as one batch."""
    if part.step >= SPARSE:
        return join_contours([file.contours(pose, pose + 1) for pose in part])
    whole = file.contours(part.start, part.stop)
    return whole if part.step == 1 else _picked(whole, np.arange(0, part.stop - part.start, part.step))


def ragged(start: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Indices start, start + 1, ... of each range of `count`, one range after the other."""
    shift = start - np.concatenate([np.zeros(1, np.int64), np.cumsum(count)[:-1]])
    return np.arange(count.sum()) + np.repeat(shift, count)


def offsets(count: np.ndarray) -> np.ndarray:
    """Offsets from 0 of ranges of `count` rows, int64, one more than ranges."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(count, dtype=np.int64)])


def _picked(contours: Arrays, rows: np.ndarray) -> Arrays:
    """The contours of some poses of a batch."""
    pose_start, polyline_start = contours["pose_start"], contours["polyline_start"]
    polylines = np.diff(pose_start)[rows]
    polyline = ragged(pose_start[rows], polylines)
    points = np.diff(polyline_start)[polyline]
    picked = {"point": ragged(polyline_start[polyline], points), "polyline": polyline}
    found = {"pose_start": offsets(polylines), "polyline_start": offsets(points)}
    for spec in CONTOURS:
        if not spec.is_offset and spec.name in contours:
            found[spec.name] = contours[spec.name][picked[str(spec.dims[0])]]
    return found


def _by_number(file: ContourFile, poses: Ends) -> tuple[int, int]:
    low, high = ends_of(poses, "poses")
    first, stop = (default if end is None else end for end, default in ((low, 0), (high, file.pose_count)))
    if first != int(first) or stop != int(stop):
        raise StrategyError(f"poses must be whole numbers FIRST:STOP, not {first:g}:{stop:g}")
    first, stop = int(first), int(stop)
    if first < 0 or max(first, stop) > file.pose_count:
        raise StrategyError(f"poses {first}:{stop} are not all in {file.path}, which has poses 0:{file.pose_count}")
    if first >= stop:
        raise StrategyError(f"poses {first}:{stop} are none: the pose after the last must be greater than the first")
    return first, stop


def _by_time(file: ContourFile, seconds: Ends) -> tuple[int, int]:
    low, high = ends_of(seconds, "seconds")
    time = file.motion().get("time")
    if time is None:
        raise StrategyError(f"{file.path}: its poses have no times, so seconds cannot be chosen; poses can")
    first = 0 if low is None else int(np.searchsorted(time, low))
    stop = len(time) if high is None else int(np.searchsorted(time, high))
    if first >= stop:
        asked = ":".join("" if end is None else f"{end:g}" for end in (low, high))
        raise StrategyError(
            f"seconds {asked} hold no pose of {file.path}, whose times are {time[0]:g} to {time[-1]:g} s"
        )
    return first, stop


def ends_of(given: Ends, name: str) -> tuple[float | None, float | None]:
    """Both ends as numbers; None where one is left out."""
    parts = tuple(given.split(":")) if isinstance(given, str) else given
    if not isinstance(parts, tuple | list) or len(parts) != 2:
        raise StrategyError(f"{name} must be a range FIRST:STOP, as 100:200, 100: or :200, not {value_text(given)}")
    try:
        low, high = (None if end is None or end == "" else float(end) for end in parts)
    except (TypeError, ValueError):
        raise StrategyError(f"{name} must be a range of two numbers, FIRST:STOP, not {value_text(given)}") from None
    if not all(end is None or math.isfinite(end) for end in (low, high)):
        raise StrategyError(f"{name} must be a range of finite numbers, not {value_text(given)}")
    return low, high


def _require_done(file: ContourFile, first: int, stop: int) -> None:
    """Refuse poses of an unfinished file that are not rendered yet; the message says which are."""
    done = file.done
    if any(low <= first and stop <= high for low, high in done):
        return
    ranges = ", ".join(f"{low}:{high}" for low, high in done[:5]) + (", ..." if len(done) > 5 else "")
    way = f"; poses {ranges} are done and can be exported with poses={done[0][0]}:{done[0][1]}" if done else ""
    raise StrategyError(
        f"{file.path}: is not finished, and of poses {first}:{stop} some are missing{way}; "
        "palpate render --resume finishes it"
    )
