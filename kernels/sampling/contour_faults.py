"""Faults of contours that cannot be drawn as they are; one thread a polyline looks for all of them."""

import warp as wp

from ..contours import Contours
from ..offsets import BLOCK
from ..patch import EXACT

wp.set_module_options(EXACT)

FAULTS = ("open_seam", "empty", "not_finite")
OPEN_SEAM, EMPTY, NOT_FINITE = (wp.constant(k) for k in range(len(FAULTS)))


@wp.kernel
def _find_faults(
    c: Contours,
    found: wp.array[wp.int32],  # 1: some polyline has the fault, shape [fault], zero-initialised
):
    """Note the faults of a polyline; whichever thread writes them."""
    line = wp.tid()
    first = c.polyline_start[line]
    stop = c.polyline_start[line + 1]
    if first == stop:
        found[EMPTY] = 1
        return
    weighed = c.intensity.shape[0] > 0
    pauses = c.dwell.shape[0] > 0
    if int(c.polyline_closed[line]) != 0:
        last = stop - wp.int64(1)
        if weighed and c.intensity[first] != c.intensity[last]:
            found[OPEN_SEAM] = 1
        if pauses and c.dwell[first] != c.dwell[last]:
            found[OPEN_SEAM] = 1
    row = first
    while row < stop:
        p = c.points[row]
        fine = wp.isfinite(p[0]) and wp.isfinite(p[1]) and wp.isfinite(p[2])
        if weighed:
            fine = fine and wp.isfinite(c.intensity[row])
        if pauses:
            fine = fine and wp.isfinite(c.dwell[row])
        if not fine:
            found[NOT_FINITE] = 1
        row += wp.int64(1)


def find_faults(contours: Contours) -> frozenset[str]:
    """Those of `FAULTS` that contours have.

    open_seam: a closed polyline has another intensity or pause at its last point than at its first, which are one
    place. empty: a polyline has no point. not_finite: a point, intensity or pause is no finite number.
    """
    device = contours.points.device
    found = wp.zeros(len(FAULTS), dtype=wp.int32, device=device)
    lines = contours.polyline_closed.shape[0]
    wp.launch(_find_faults, lines, inputs=[contours], outputs=[found], device=device, block_dim=BLOCK)
    return frozenset(name for name, value in zip(FAULTS, found.numpy().tolist(), strict=True) if value)
