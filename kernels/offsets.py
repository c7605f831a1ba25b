"""Rows on a device: how many threads work on them at a time, and counts to offsets."""

import warp as wp

BLOCK = 64  # threads of a GPU's block: registers are scarce, and larger blocks leave more of them unused (measured)


class PointLimitError(MemoryError):
    """A batch has more points than the caller has room for."""

    def __init__(self, count: int, limit: int) -> None:
        super().__init__(f"{count} points exceed the limit of {limit}")
        self.count = count


def offsets_of(count: wp.array) -> wp.array:
    """Exclusive prefix sum of counts whose last entry is a spare 0."""
    start = wp.empty_like(count)
    wp.utils.array_scan(count, start, inclusive=False)
    return start


def last_of(start: wp.array) -> int:
    """The total that offsets end with; waits for the device."""
    return int(start[-1:].numpy()[0])
