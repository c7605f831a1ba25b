"""How near to a patch's plane and sides counts as on them, set for all patches of a hand."""

from typing import Any

import warp as wp

from .patch import EXACT, Patch

wp.set_module_options(EXACT)

FLUSH_RATE = 3.0 * 2.0**-23
"""Default flush for each metre of the largest coordinate: three float32 spacings.
Measured (docs/measured/performance.md): a resting palm needs 1.4, that of an object that moves 2.1."""


@wp.kernel
def _settle_patches(
    # In:
    patch: wp.array[Patch],
    flush: wp.float64,
    flush_rate: wp.float64,
    relative: wp.int32,
    # Out:
    settled: wp.array[Patch],
):
    """Copy each patch and set how it is asked and written."""
    i = wp.tid()
    own = patch[i]
    own.flush = flush
    own.flush_rate = flush_rate
    own.relative = relative
    settled[i] = own


def settle_patches(patch: wp.array, *, flush: float, flush_rate: float = 0.0, relative: bool = False) -> Any:
    """The same patches with another flush, and with points written in the array's frame or relative to the patch.

    patch: Patch, shape [patch]. At a pose, a vertex that is below the patch's plane by the larger of `flush` [m] and
    `flush_rate` times the patch's largest coordinate [m] at most counts as on it; never more than FLUSH_MOST.
    Returns Patch, shape [patch], on the same device.
    """
    settled = wp.empty_like(patch)
    inputs = [patch, wp.float64(flush), wp.float64(flush_rate), int(relative)]
    wp.launch(_settle_patches, patch.shape[0], inputs=inputs, outputs=[settled], device=patch.device)
    return settled
