"""Seams: the first and the last point of a closed polyline are one place, and must have one intensity."""

import warp as wp

from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)


@wp.kernel
def _find_open_seam(
    # In:
    value: wp.array[wp.float32],  # of each point
    polyline_start: wp.array[wp.int64],
    polyline_closed: wp.array[wp.uint8],
    # Out:
    found: wp.array[wp.int32],  # shape [1]
):
    """Note if a closed polyline has another value at its last point than at its first."""
    line = wp.tid()
    first = polyline_start[line]
    stop = polyline_start[line + 1]
    if int(polyline_closed[line]) != 0 and stop > first:
        if value[first] != value[stop - wp.int64(1)]:
            found[0] = 1  # whichever thread writes it


def has_open_seam(value: wp.array, polyline_start: wp.array, polyline_closed: wp.array) -> bool:
    """Whether a closed polyline has another value, float32, at its last point than at its first."""
    found = wp.zeros(1, dtype=wp.int32, device=value.device)
    wp.launch(
        _find_open_seam,
        polyline_closed.shape[0],
        inputs=[value, polyline_start, polyline_closed],
        outputs=[found],
        device=value.device,
        block_dim=BLOCK,
    )
    return int(found.numpy()[0]) != 0
