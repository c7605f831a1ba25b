"""Pieces of sections with few crossings: groups of few lanes."""

from typing import Any

import warp as wp

from ..lanes import lane_count
from ..offsets import BLOCK
from ..patch import EXACT, Patch
from ..section.half_edges import Surface
from ..section.pieces import ContourPieces
from .flat_ranks import rank_rows
from .lane_space import NEAR_FEW, address_of_few, near_space
from .row_block import RowBlock

wp.set_module_options(EXACT)


@wp.kernel(launch_bounds=(BLOCK, 14))
def _rank_few_crossings(
    # In:
    surface: Surface,
    patch: wp.array[Patch],
    bounded: int,
    lanes: int,  # of a group
    # Out:
    block: RowBlock,
    pieces: ContourPieces,
    listed: wp.array[wp.int32],
):
    """Store the pieces of each row of a block, and list the half-edges of their steps, as `rank_rows`."""
    near = near_space(address_of_few(), NEAR_FEW)
    rank_rows(surface, patch, bounded, wp.tid(), lanes, near, block, pieces, listed)


def rank_few_crossings(
    surface: Any, patch: wp.array, block: Any, *, bounded: bool, pieces: Any, listed: wp.array
) -> None:
    """Store the pieces of each row of a RowBlock, and list the half-edges of their steps.

    listed: of each row: in, its crossings; out, the steps of its pieces. `ContourPieces.excess` counts
    rows with too few slots.
    """
    lanes = lane_count(patch.device)
    wp.launch(
        _rank_few_crossings,
        block.steps.shape[0] * lanes,
        inputs=[surface, patch, int(bounded), lanes],
        outputs=[block, pieces, listed],
        device=patch.device,
        block_dim=BLOCK,
    )
