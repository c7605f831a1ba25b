"""How often numbers fall into bins that their leading bits define: exact counts, in whatever order they are added."""

import warp as wp

from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _count_bins(
    # In:
    value: wp.array[wp.float32],  # shape [pose]
    span_first: wp.array[wp.int64],  # first pose, shape [span]
    span_count: wp.array[wp.int64],  # poses
    part_start: wp.array[wp.int64],  # offsets into spans, shape [part + 1]
    shift: int,  # bits that are dropped
    first: int,  # leading bits of bin 2
    # Out:
    count: wp.array2d[wp.int32],  # zero-initialised, shape [part, bin]
):
    """Count the numbers of one span in the bins of its part."""
    span = wp.tid()
    part = wp.lower_bound(part_start, wp.int64(span + 1)) - 1
    last = count.shape[1] - 1
    for k in range(int(span_count[span])):
        x = value[int(span_first[span]) + k]
        if x - x == wp.float32(0.0):  # finite
            own = int(0)
            if x > wp.float32(0.0):
                own = wp.clamp((wp.cast(x, wp.int32) >> shift) - first + 2, 1, last)
            wp.atomic_add(count, part, own, 1)


@on_one_device
def count_bins(
    value: wp.array,
    span_first: wp.array,
    span_count: wp.array,
    part_start: wp.array,
    *,
    lowest: int,
    highest: int,
    bits: int,
) -> wp.array:
    """Numbers of finite values in each bin, by part, int32, shape [part, bin].

    Bin 0: values up to 0. Bin 1: above 0 and below 2^lowest. Then every factor of two up to 2^highest is divided into
    2^bits bins of equal width; each holds its lower edge. The last bin: 2^highest and more.

    value: float32, shape [pose]. span_first, span_count, part_start: as of `tally.sum_parts`.
    """
    shape = part_start.shape[0] - 1, (highest - lowest) * 2**bits + 3
    count = wp.zeros(shape, dtype=wp.int32, device=value.device)
    inputs = [value, span_first, span_count, part_start, 23 - bits, (127 + lowest) << bits]  # float32: 23 and 8 bits
    launch(_count_bins, span_first.shape[0], inputs, [count])
    return count
