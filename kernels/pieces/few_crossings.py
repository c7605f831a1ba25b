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
    surface: Surface,
    patch: wp.array[Patch],
    bounded: int,
    lanes: int,  # of a group
    block: RowBlock,
    pieces: ContourPieces,
):
    """Store the pieces of each row of a block, and list the half-edges of their steps, as `rank_rows`."""
    near = near_space(address_of_few(), NEAR_FEW)
    rank_rows(surface, patch, bounded, wp.tid(), lanes, near, block, pieces)


def rank_few_crossings(surface: Any, patch: wp.array, block: Any, *, bounded: bool, pieces: Any) -> None:
    """Store the pieces of each row of a RowBlock, and list the half-edges of their steps: see `rank_rows`."""
    lanes = lane_count(patch.device)
    wp.launch(
        _rank_few_crossings,
        block.groups * lanes,
        inputs=[surface, patch, int(bounded), lanes],
        outputs=[block, pieces],
        device=patch.device,
        block_dim=BLOCK,
    )
