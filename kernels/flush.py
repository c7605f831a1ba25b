"""The flush tolerance, within which a point counts as on a patch's plane or sides, for all patches of a hand."""

from typing import Any

import warp as wp

from .offsets import BLOCK
from .patch import EXACT, Patch

wp.set_module_options(EXACT)

FLUSH_RATE = 3.0 * 2.0**-23
"""Default flush for each metre of the largest coordinate: three float32 spacings.
Measured (docs/measured/performance.md): a resting palm needs 1.4, that of an object that moves 2.1."""


@wp.kernel
def _resolve_flush(
    patch: wp.array[Patch], flush: wp.float64, flush_rate: wp.float64, relative: wp.int32, resolved: wp.array[Patch]
):
    """Copy each patch with its flush and its frame of output points."""
    i = wp.tid()
    own = patch[i]
    own.flush = flush
    own.flush_rate = flush_rate
    own.relative = relative
    resolved[i] = own


def resolve_flush(patch: wp.array, *, flush: float, flush_rate: float = 0.0, relative: bool = False) -> Any:
    """Copies of patches with another flush, and with output points in the array's frame or relative to the patch.

    patch: Patch, shape [patch]. At a pose, the flush is the larger of `flush` [m] and `flush_rate` times the patch's
    largest coordinate [m], at most FLUSH_MOST; a vertex at most that far below the plane counts as on it.
    Returns Patch, shape [patch], on the same device.
    """
    resolved = wp.empty_like(patch)
    inputs = [patch, wp.float64(flush), wp.float64(flush_rate), int(relative)]
    wp.launch(_resolve_flush, patch.shape[0], inputs=inputs, outputs=[resolved], device=patch.device, block_dim=BLOCK)
    return resolved
