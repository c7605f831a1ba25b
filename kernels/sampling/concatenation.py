"""Concatenation of ragged arrays on a device."""

from collections.abc import Sequence

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _shift_offsets(
    # In:
    part: wp.array[wp.int64],
    first: wp.int64,  # place in `start`
    shift: wp.int64,
    # Out:
    start: wp.array[wp.int64],
):
    """Write offsets behind those of the parts before."""
    i = wp.tid()
    start[first + wp.int64(i)] = part[i] + shift


def concatenate_rows(parts: Sequence[wp.array]) -> wp.array:
    """Rows of all parts, one after the other; of one type, on one device."""
    out = wp.empty(sum(len(part) for part in parts), dtype=parts[0].dtype, device=parts[0].device)
    first = 0
    for part in parts:
        if len(part) > 0:
            wp.copy(out, part, dest_offset=first, count=len(part))
        first += len(part)
    return out


def concatenate_offsets(parts: Sequence[wp.array], rows: Sequence[int]) -> wp.array:
    """Offsets int64 into the rows of all parts, of which each has so many."""
    device = parts[0].device
    out = wp.zeros(1 + sum(len(part) - 1 for part in parts), dtype=wp.int64, device=device)
    first, shift = 0, 0
    for part, count in zip(parts, rows, strict=True):
        inputs = [part, wp.int64(first), wp.int64(shift)]
        wp.launch(_shift_offsets, len(part), inputs=inputs, outputs=[out], device=device, block_dim=BLOCK)
        first, shift = first + len(part) - 1, shift + count
    return out
