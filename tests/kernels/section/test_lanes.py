"""What lanes tell each other, against NumPy: blocks of 64 on GPUs and with --lanes, on CPUs each lane alone."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.offsets import BLOCK
from palpate.kernels.section.join import PLANE_WORDS, number_memory
from palpate.kernels.section.lanes import (
    WARP,
    any_lane,
    bits_to,
    claim_place,
    first_places,
    from_first_lane,
    in_step,
    lane_of_warp,
    mark_bit,
    numbers_of_warps,
    owner_of,
    set_int,
    sums_of_warp,
    sync_lanes,
    sync_warp,
    votes_of,
    warp_numbers_of,
    warp_size,
    warp_votes_of,
)

LANES = 5 * BLOCK


@wp.kernel
def _ask(x: wp.array[wp.int32], own: wp.array[wp.int64], out: wp.array2d[wp.int32]):
    i = wp.tid()
    odd = x[i] % 2 == 1
    out[i, 0] = lane_of_warp()
    out[i, 1] = warp_size()
    out[i, 2] = int(in_step())
    for k in range(5):
        pair = wp.vec2i(0, 0)
        if k == 0:
            pair = warp_votes_of(odd)
        elif k == 1:
            pair = warp_numbers_of(x[i])
        elif k == 2:
            pair = sums_of_warp(x[i])
        elif k == 3:
            pair = votes_of(odd, 0)
        else:
            pair = numbers_of_warps(warp_votes_of(odd)[1])
        out[i, 3 + 2 * k] = pair[0]
        out[i, 4 + 2 * k] = pair[1]
    sync_lanes()
    out[i, 13] = int(any_lane(x[i] == 7))
    out[i, 14] = from_first_lane(x[i])
    firsts = number_memory(own)
    set_int(firsts, lane_of_warp(), sums_of_warp(x[i])[0])
    sync_warp()
    out[i, 15] = owner_of(firsts, lane_of_warp())
    sync_warp()
    set_int(firsts, lane_of_warp(), 0)
    sync_warp()
    if odd:
        mark_bit(firsts, wp.uint32(lane_of_warp()))
    sync_warp()
    out[i, 16] = bits_to(firsts, wp.uint32(lane_of_warp()))


@wp.kernel
def _take(count: int, taken: wp.array[wp.int32], who: wp.array[wp.int32]):
    i = wp.tid()
    ours = first_places(i)
    turn = wp.int32(0)
    works = wp.bool(True)
    while works:
        place = claim_place((i + turn) % 3 != 0 or warp_size() == 1, ours, taken, count)
        ours = wp.vec2i(place[1], place[2])
        if place[0] >= 0:
            wp.atomic_add(who, place[0], 1)
        turn += 1
        works = ours[0] < count


@pytest.fixture
def lanes(device, request):
    """Lanes of a warp and of a block."""
    alone = wp.get_device(device).is_cpu and not request.config.getoption("--lanes")
    return (1, 1) if alone else (WARP, BLOCK)


def told(x, size):
    """Of each lane: the sum of those below it in its group of so many, and of all."""
    rows = x.reshape(-1, size)
    below = np.cumsum(rows, axis=1) - rows
    return np.stack([below.ravel(), np.repeat(rows.sum(axis=1), size)], axis=1)


def test_lanes_tell_each_other_what_they_have(device, lanes, rng):
    warp, block = lanes
    x = rng.integers(0, 8, LANES).astype(np.int32)
    x[:BLOCK] = np.minimum(x[:BLOCK], 6)  # no 7 in this block
    own, out = (
        wp.zeros(PLANE_WORDS + 1, dtype=wp.int64, device=device),
        wp.zeros((LANES, 17), dtype=wp.int32, device=device),
    )
    wp.launch(_ask, LANES, inputs=[wp.array(x, device=device), own], outputs=[out], device=device, block_dim=BLOCK)
    got, odd = out.numpy(), x % 2
    assert got[:, 0].tolist() == (np.arange(LANES) % warp).tolist()
    assert set(got[:, 1]) == {warp}
    assert set(got[:, 2]) == {int(warp > 1)}
    of_warps = np.add.reduceat(odd, np.arange(0, LANES, warp))
    for k, expected in enumerate(
        (told(odd, warp), told(x, warp), told(x, warp), told(odd, block), told(of_warps, block // warp).repeat(warp, 0))
    ):
        np.testing.assert_array_equal(got[:, 3 + 2 * k : 5 + 2 * k], expected)
    blocks = x.reshape(-1, block)
    np.testing.assert_array_equal(got[:, 13], np.repeat((blocks == 7).any(axis=1), block))
    np.testing.assert_array_equal(got[:, 14], np.repeat(blocks[:, 0], block))
    if warp > 1:
        first = told(x, warp)[:, 0].reshape(-1, warp)
        owner = [np.searchsorted(row, lane, side="right") - 1 for row in first for lane in range(warp)]
        assert got[:, 15].tolist() == owner
    np.testing.assert_array_equal(got[:, 16], told(odd, warp)[:, 0] + odd)


@pytest.mark.parametrize("count", [0, 1, 31, 32, 33, 64, 1000])
def test_each_place_is_claimed_once(count, device, lanes):
    who, taken = wp.zeros(max(count, 1), dtype=wp.int32, device=device), wp.zeros(1, dtype=wp.int32, device=device)
    size = max(count, 1) if lanes[0] == 1 else LANES
    wp.launch(_take, size, inputs=[count, taken], outputs=[who], device=device, block_dim=BLOCK)
    assert who.numpy()[:count].tolist() == [1] * count
    assert who.numpy()[count:].sum() == 0
