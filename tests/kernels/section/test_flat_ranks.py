"""Ranking of pieces: its two kernels have groups of two sizes, so two Warp modules, which are compiled ahead."""

from types import SimpleNamespace

import warp as wp

from palpate.kernels import compile_kernels
from palpate.kernels.offsets import BLOCK
from palpate.kernels.section import flat_ranks


def test_both_kernels_are_compiled_ahead_for_blocks_of_their_size(monkeypatch):
    compiled = {}
    monkeypatch.setattr(wp, "get_device", lambda device: SimpleNamespace(is_cpu=False))
    monkeypatch.setattr(
        wp, "force_load", lambda device, modules, *, block_dim, **_: compiled.update({block_dim: modules})
    )
    compile_kernels("cuda", ("section.flat_ranks",))
    few, many = flat_ranks._rank_few_crossings, flat_ranks._rank_many_crossings
    assert compiled == {BLOCK: [few.module], flat_ranks.MANY_LANES: [many.module]}
    assert BLOCK < flat_ranks.MANY_LANES
    assert few.module.options == many.module.options
