"""Ragged rows on a device: block size of launches, and offsets from row lengths."""

from collections.abc import Sequence

import warp as wp

BLOCK = 64  # threads of a GPU block; larger ones leave more registers unused, and these kernels need many (measured)


class PointLimitError(MemoryError):
    """A batch has more points than the caller's limit."""

    def __init__(self, count: int, limit: int) -> None:
        super().__init__(f"{count} points exceed the limit of {limit}")
        self.count = count


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
