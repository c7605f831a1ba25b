"""Intervals between poses of many motions, halved where another pose is wanted; then all poses in the order of time.

A pose in the middle has the position halfway and the rotation halfway along the shorter arc, in float64, rounded to
float32: sums, products and roots alone, which round alike on every processor and GPU. Of two rotations half a turn
apart, both arcs are as short; the first one's sign decides.

A row is a pose that contours are compared at; the intervals of a level are those between a row and the next. Its key
orders it: the number of the tracker's pose before it, times 2^32, and the time since, as a share of the interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..offsets import BLOCK, scan_counts
from ..patch import EXACT

wp.set_module_options(EXACT)

LEVELS_MOST = 32  # of halving; an interval of 30 hours is then shorter than 50 us
KEY_BITS = wp.constant(wp.int64(LEVELS_MOST))
ZERO, HALF, ONE, TWO = (wp.constant(wp.float64(value)) for value in (0.0, 0.5, 1.0, 2.0))


@wp.struct
class IntervalRows:
    """Poses in the order of time."""

    time: wp.array[wp.float64]  # [s]
    pose: wp.array[wp.transform]
    key: wp.array[wp.int64]
    compared: wp.array[wp.uint8]  # whether the interval to the next row may be halved


@dataclass(frozen=True)
class HalvedIntervals:
    """One level of halving."""

    rows: Any
    """Ends and middles of the intervals: IntervalRows."""
    middle: Any
    """The middles alone."""


@wp.func
def widened(q: wp.quat):
    """A quaternion in float64."""
    return wp.vec4d(wp.float64(q[0]), wp.float64(q[1]), wp.float64(q[2]), wp.float64(q[3]))


@wp.func
def summed(x: wp.vec4d):
    """Sum in the order of NumPy."""
    return ((x[0] + x[1]) + x[2]) + x[3]


@wp.kernel
def _choose_intervals(
    rows: IntervalRows,
    far: wp.array[wp.uint8],
    hold: wp.float64,  # longer intervals are halved in any case [s]
    least: wp.float64,  # halves are no shorter [s]
    chosen: wp.array[wp.int64],  # shape [row + 1]
):
    """Choose the intervals to be halved, by 1."""
    i = wp.tid()
    if i + 1 >= rows.time.shape[0] or rows.compared[i] == wp.uint8(0):
        return
    lasting = rows.time[i + 1] - rows.time[i]
    if (far[i] != wp.uint8(0) or lasting > hold) and lasting / TWO >= least:
        chosen[i] = wp.int64(1)


@wp.kernel
def _count_rows(
    chosen: wp.array[wp.int64],
    count: wp.array[wp.int64],  # shape [row + 1]
):
    """Count the rows of the next level: begin and middle of an interval; its end, where no other begins."""
    i = wp.tid()
    if chosen[i] > wp.int64(0):
        count[i] = wp.int64(2)
    elif i > 0:
        count[i] = chosen[i - 1]


@wp.func
def middle_turn(q: wp.quat, r: wp.quat):
    """Halfway between two rotations along the shorter arc."""
    a = widened(q)
    b = widened(r)
    if summed(wp.cw_mul(a, b)) < ZERO:
        b = -b
    both = a + b
    return both / wp.sqrt(summed(wp.cw_mul(both, both)))


@wp.func
def write_row(out: IntervalRows, at: wp.int64, time: wp.float64, pose: wp.transform, key: wp.int64, compared: wp.uint8):
    """Write one row."""
    out.time[at] = time
    out.pose[at] = pose
    out.key[at] = key
    out.compared[at] = compared


@wp.kernel
def _halve_intervals(
    # In:
    rows: IntervalRows,
    chosen: wp.array[wp.int64],
    number: wp.array[wp.int64],  # of a chosen interval
    start: wp.array[wp.int64],  # of a row's rows at the next level
    step: wp.int64,  # of keys, to the middle
    # Out:
    out: IntervalRows,
    middle: IntervalRows,
):
    """Write the ends and the middles of intervals."""
    i = wp.tid()
    at = start[i]
    if start[i + 1] == at:
        return
    write_row(out, at, rows.time[i], rows.pose[i], rows.key[i], wp.uint8(chosen[i]))
    if chosen[i] == wp.int64(0):
        return
    k = number[i]
    p = rows.pose[i]
    q = rows.pose[i + 1]
    x = middle_turn(wp.transform_get_rotation(p), wp.transform_get_rotation(q))
    turn = wp.quat(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]), wp.float32(x[3]))
    one = wp.transform_get_translation(p)
    two = wp.transform_get_translation(q)
    position = wp.vec3()
    for axis in range(3):
        near = wp.float64(one[axis])
        position[axis] = wp.float32(near + HALF * (wp.float64(two[axis]) - near))
    pose = wp.transform(position, turn)
    time = HALF * (rows.time[i] + rows.time[i + 1])
    key = rows.key[i] + step
    write_row(out, at + wp.int64(1), time, pose, key, wp.uint8(1))
    write_row(middle, k, time, pose, key, wp.uint8(0))


@wp.kernel
def _gather_rows(
    rows: IntervalRows, order: wp.array[wp.int32], time: wp.array[wp.float64], pose: wp.array[wp.transform]
):
    """Take rows in an order."""
    i = wp.tid()
    time[i] = rows.time[order[i]]
    pose[i] = rows.pose[order[i]]


@wp.kernel
def _find_starts(
    key: wp.array[wp.int64],  # ascending
    motion_start: wp.array[wp.int64],
    start: wp.array[wp.int64],
):
    """Find where the rows of a motion begin."""
    m = wp.tid()
    start[m] = wp.int64(wp.lower_bound(key, motion_start[m] << KEY_BITS))


def given_rows(time: np.ndarray, pose: np.ndarray | wp.array, compared: np.ndarray, device: str) -> Any:
    """Rows of poses that a tracker gave; compared: whether the interval to the next may be halved, bool [pose]."""
    rows = IntervalRows()
    rows.time = wp.array(time, dtype=wp.float64, device=device)
    rows.pose = wp.array(pose, dtype=wp.transform, device=device)
    rows.key = wp.array(np.arange(len(time), dtype=np.int64) << LEVELS_MOST, dtype=wp.int64, device=device)
    rows.compared = wp.array(compared.astype(np.uint8), dtype=wp.uint8, device=device)
    return rows


def halve_intervals(rows: Any, far: wp.array, level: int, *, hold: float, least: float) -> HalvedIntervals | None:
    """Halve the intervals to be halved; None if there are none.

    rows: IntervalRows. far: whether another pose is wanted between a row and the next, uint8, shape [row]. level: how
    often these intervals have been halved. hold: longer intervals are halved in any case [s]; least: but none whose
    halves are shorter [s].
    """
    device, count = rows.time.device, rows.time.shape[0]
    chosen = wp.zeros(count + 1, dtype=wp.int64, device=device)
    inputs = [rows, far, float(hold), float(least)]
    wp.launch(_choose_intervals, count, inputs=inputs, outputs=[chosen], device=device, block_dim=BLOCK)
    (number,), (middles,) = scan_counts(chosen)
    if middles == 0 or level >= LEVELS_MOST:
        return None
    counted = wp.zeros(count + 1, dtype=wp.int64, device=device)
    wp.launch(_count_rows, count, inputs=[chosen], outputs=[counted], device=device, block_dim=BLOCK)
    (start,), (total,) = scan_counts(counted)
    out, middle = empty_rows(total, device), empty_rows(middles, device)
    inputs = [rows, chosen, number, start, 1 << (LEVELS_MOST - 1 - level)]
    wp.launch(_halve_intervals, count, inputs=inputs, outputs=[out, middle], device=device, block_dim=BLOCK)
    return HalvedIntervals(out, middle)


def ordered_rows(parts: Sequence[Any], motion_start: np.ndarray) -> tuple[wp.array, wp.array, np.ndarray]:
    """All rows in the order of time: times, poses, and offsets of motions into them, int64, shape [motion + 1].

    parts: IntervalRows, first those of the tracker. motion_start: offsets of motions into the tracker's poses.
    """
    count = sum(part.time.shape[0] for part in parts)
    device = parts[0].time.device
    rows = empty_rows(count, device)
    key = wp.empty(2 * count, dtype=wp.int64, device=device)  # sorting takes twice the room
    order = wp.array(np.arange(2 * count, dtype=np.int32), dtype=wp.int32, device=device)
    at = 0
    for part in parts:
        own = part.time.shape[0]
        wp.copy(rows.time, part.time, dest_offset=at, count=own)
        wp.copy(rows.pose, part.pose, dest_offset=at, count=own)
        wp.copy(key, part.key, dest_offset=at, count=own)
        at += own
    wp.utils.radix_sort_pairs(key, order, count)
    time = wp.empty(count, dtype=wp.float64, device=device)
    pose = wp.empty(count, dtype=wp.transform, device=device)
    wp.launch(_gather_rows, count, inputs=[rows, order], outputs=[time, pose], device=device, block_dim=BLOCK)
    given = wp.array(np.asarray(motion_start[:-1], np.int64), dtype=wp.int64, device=device)
    start = wp.empty_like(given)
    inputs = [key[:count], given]
    wp.launch(_find_starts, len(given), inputs=inputs, outputs=[start], device=device, block_dim=BLOCK)
    return time, pose, np.append(start.numpy(), count)


def empty_rows(count: int, device: Any) -> Any:
    """IntervalRows without values."""
    rows = IntervalRows()
    for name, dtype in (("time", wp.float64), ("pose", wp.transform), ("key", wp.int64), ("compared", wp.uint8)):
        setattr(rows, name, wp.empty(count, dtype=dtype, device=device))
    return rows
