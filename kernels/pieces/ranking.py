"""Pieces of sections: groups of few lanes where sections have few crossings, else of many, which share one memory."""

from typing import Any

import warp as wp

from ..lanes import lane_count
from ..offsets import BLOCK
from ..patch import EXACT, Patch
from ..section.half_edges import Surface
from ..section.pieces import ContourPieces
from .flat_ranks import rank_rows
from .lane_space import NEAR_FEW, NEAR_MANY, address_of_few, address_of_many, near_space
from .row_block import RowBlock

MANY_LANES = 128  # of a group, which are the threads of a GPU block
OTHER_BLOCKS = {f"{__name__}.many": MANY_LANES}  # a Warp module of its own: all kernels of one have blocks of one size
(MANY,) = OTHER_BLOCKS

wp.set_module_options(EXACT)
wp.set_module_options(EXACT, MANY)


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


@wp.kernel(launch_bounds=(MANY_LANES, 6), module=MANY)
def _rank_many_crossings(
    surface: Surface, patch: wp.array[Patch], bounded: int, lanes: int, block: RowBlock, pieces: ContourPieces
):
    """The same with more memory near the lanes."""
    near = near_space(address_of_many(), NEAR_MANY)
    rank_rows(surface, patch, bounded, wp.tid(), lanes, near, block, pieces)


def rank_crossings(surface: Any, patch: wp.array, block: Any, *, many: bool, bounded: bool, pieces: Any) -> None:
    """Store the pieces of each row of a RowBlock, and list the half-edges of their steps: see `rank_rows`."""
    kernel, threads = (_rank_many_crossings, MANY_LANES) if many else (_rank_few_crossings, BLOCK)
    lanes = lane_count(patch.device, threads)
    wp.launch(
        kernel,
        block.groups * lanes,
        inputs=[surface, patch, int(bounded), lanes],
        outputs=[block, pieces],
        device=patch.device,
        block_dim=threads,
    )
