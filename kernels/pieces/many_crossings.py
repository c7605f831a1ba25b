"""Pieces of sections with many crossings: groups of many lanes, which share one memory near them.

This is `few_crossings` with another size of groups, in a module of its own: Warp compiles a module for one size of
blocks.
"""

from typing import Any

import warp as wp

from ..lanes import lane_count
from ..patch import EXACT, Patch
from ..section.half_edges import Surface
from ..section.pieces import ContourPieces
from .flat_ranks import rank_rows
from .lane_space import NEAR_MANY, address_of_many, near_space
from .row_block import RowBlock

wp.set_module_options(EXACT)

BLOCK = 128  # threads of a GPU block, which are the lanes of a group


@wp.kernel(launch_bounds=(BLOCK, 6))
def _rank_many_crossings(
    surface: Surface,
    patch: wp.array[Patch],
    bounded: int,
    lanes: int,  # of a group
    block: RowBlock,
    pieces: ContourPieces,
):
    """Store the pieces of each row of a block, and list the half-edges of their steps, as `rank_rows`."""
    near = near_space(address_of_many(), NEAR_MANY)
    rank_rows(surface, patch, bounded, wp.tid(), lanes, near, block, pieces)


def rank_many_crossings(surface: Any, patch: wp.array, block: Any, *, bounded: bool, pieces: Any) -> None:
    """Store the pieces of each row of a RowBlock, and list the half-edges of their steps: see `rank_rows`."""
    lanes = lane_count(patch.device, BLOCK)
    wp.launch(
        _rank_many_crossings,
        block.groups * lanes,
        inputs=[surface, patch, int(bounded), lanes],
        outputs=[block, pieces],
        device=patch.device,
        block_dim=BLOCK,
    )
