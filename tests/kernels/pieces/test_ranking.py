"""Ranking of pieces: its two kernels have groups of two sizes, so two Warp modules, which are compiled ahead."""

from types import SimpleNamespace

import warp as wp

from palpate.kernels import compile_kernels
from palpate.kernels.offsets import BLOCK
from palpate.kernels.pieces import ranking


def test_both_kernels_are_compiled_ahead_for_blocks_of_their_size(monkeypatch):
    compiled = {}
    monkeypatch.setattr(wp, "get_device", lambda device: SimpleNamespace(is_cpu=False))
    monkeypatch.setattr(
        wp, "force_load", lambda device, modules, *, block_dim, **_: compiled.update({block_dim: modules})
    )
    compile_kernels("cuda", ("pieces.ranking",))
    few, many = ranking._rank_few_crossings, ranking._rank_many_crossings
    assert compiled == {BLOCK: [few.module], ranking.MANY_LANES: [many.module]}
    assert BLOCK < ranking.MANY_LANES
    assert few.module.options == many.module.options
