"""Ragged rows on a device: launches, offsets from row lengths, and rows that are counted and then written."""

from collections.abc import Callable, Sequence
from typing import Any

import warp as wp

BLOCK = 64  # threads of a GPU block; larger ones leave more registers unused, and these kernels need many (measured)


class PointLimitError(MemoryError):
    """A batch has more points than the caller's limit."""

    def __init__(self, count: int, limit: int) -> None:
        super().__init__(f"{count} points exceed the limit of {limit}")
        self.count = count


def launch(kernel: wp.Kernel, count: int | tuple[int, ...], inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
    """Launch on the device of the arrays, in blocks as everywhere."""
    device = device_of([*outputs, *inputs])
    wp.launch(kernel, count, inputs=inputs, outputs=outputs, device=device, block_dim=BLOCK)


def device_of(values: Sequence[Any]) -> Any:
    """The device of the first array among some values, or within a Warp struct among them; None without one."""
    for value in values:
        if isinstance(value, wp.array):
            return value.device
        if hasattr(value, "_ctype") and (device := device_of(list(vars(value).values()))) is not None:
            return device
    return None


def offsets_of(count: wp.array) -> wp.array:
    """Offsets of rows: the exclusive prefix sum of counts. The last count must be an extra 0, so the last entry is the
    total."""
    start = wp.empty_like(count)
    wp.utils.array_scan(count, start, inclusive=False)
    return start


def last_of(start: wp.array) -> int:
    """The last offset, which is the total; waits for the device."""
    return int(start[-1:].numpy()[0])


def lasts_of(starts: Sequence[wp.array]) -> wp.array:
    """The last offsets of several arrays in one on their device, which is not waited for."""
    lasts = wp.empty(len(starts), dtype=wp.int64, device=starts[0].device)
    for k, start in enumerate(starts):
        wp.copy(lasts, start, dest_offset=k, src_offset=start.shape[0] - 1, count=1)
    return lasts


def scan_counts(*counts: wp.array, limit: int | None = None) -> tuple[list[wp.array], list[int]]:
    """Offsets and totals of several counts, as of `offsets_of`; waits for the device.

    limit: of the first total, which is of points or what becomes points; raises PointLimitError beyond it.
    """
    starts = [offsets_of(count) for count in counts]
    totals = [last_of(start) for start in starts]
    if limit is not None and totals[0] > limit:
        raise PointLimitError(totals[0], limit)
    return starts, totals


def count_then_fill(
    count: wp.Kernel,
    fill: wp.Kernel | None,
    dim: int | tuple[int, ...],
    inputs: Sequence[Any],
    room: Callable[..., Sequence[Any]],
    *,
    rows: int,
    columns: int = 1,
    limit: int | None = None,
    more: Sequence[Any] = (),
    blank: Sequence[Any] = (),
) -> tuple[Sequence[Any], list[wp.array]]:
    """Rows that a kernel counts and a kernel then writes: what `room` gave for the totals, and the rows' offsets.

    count: takes the inputs, and writes `columns` arrays of counts, int64, zero-initialised, shape [rows + 1].
    fill: takes the inputs, the counts' offsets and `more`, and writes what `room(*totals)` gives. None: `count` does
    both, and takes inputs, offsets, counts and what `room` gives; while it counts, the offsets have length 0, and
    `blank` stands for what `room` gives. limit: as of `scan_counts`, before memory is allocated.
    """
    device, none = device_of(inputs), [None] * columns
    counts = [wp.zeros(rows + 1, dtype=wp.int64, device=device) for _ in none]
    if fill is None:
        launch(count, dim, [*inputs, *none], [*counts, *blank])
    else:
        launch(count, dim, inputs, counts)
    starts, totals = scan_counts(*counts, limit=limit)
    out = room(*totals)
    launch(fill or count, dim, [*inputs, *starts, *(none if fill is None else more)], out)
    return out, starts
