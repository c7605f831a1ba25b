"""close-together: what a line loses does not depend on how it is cut into polylines that touch end to end."""

import itertools

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch
from prune_cases import a_setting, circle, flat_frames, lines_at, pruned
from thinning_oracle import SlowThinning

from palpate.kernels.stages.cut import divide_segments
from palpate.kernels.stages.prune_crowded import Beside, thin_contours
from palpate.render import ContourBatch

U = np.array([(0.012, 0, 0.2), (0, 0, 0.2), (0, 0.004, 0.2), (0.012, 0.004, 0.2)])


def cut_at_vertices(batch, rng):
    """The same lines in pieces, cut at random vertices, all as they ran, the pieces of a pose in random order.

    Returns the batch and, for each of its segments, the number of the segment in the batch that was cut.
    """
    pieces, patches, pose_start, segments = [], [], [0], []
    for a, b in zip(batch.pose_start[:-1], batch.pose_start[1:], strict=True):
        own = []
        for line in range(a, b):
            first, stop = batch.polyline_start[line : line + 2]
            cuts = first + 1 + np.flatnonzero(rng.random(stop - first - 2) < 0.6)
            whole = batch.polyline_closed[line] and len(cuts) == 0
            ends = [first, *cuts, stop - 1]
            own.append([(p, q, batch.polyline_patch[line], whole) for p, q in itertools.pairwise(ends)])
        rest = [(k, piece) for k, line in enumerate(own) for piece in line[1:]]
        rest = [rest[i] for i in rng.permutation(len(rest))]
        for p, q, patch, whole in [line[0] for line in own] + [piece for _, piece in rest]:  # lines begin as they did
            pieces.append((batch.points[p : q + 1], whole))
            patches.append(patch)
            segments.append(np.append(np.arange(p, q), -1))
        pose_start.append(len(pieces))
    return ContourBatch(
        points=np.concatenate([p for p, _ in pieces]),
        kind=np.zeros(sum(len(p) for p, _ in pieces), np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum([len(p) for p, _ in pieces])]),
        polyline_patch=np.array(patches, np.int32),
        polyline_closed=np.array([whole for _, whole in pieces], np.uint8),
        pose_start=np.array(pose_start),
    ), np.concatenate(segments)


def kept_by_segment(batch, device, across, apart):
    """Parts that are kept of each segment, in the order in which it was given, as tuples by its first point."""
    fast = Beside()
    fast.distance, fast.parallel = wp.float64(0.01), wp.float64(np.cos(0.6))
    fast.apart, fast.patches = wp.float64(apart), int(across)
    on = batch.to(device)
    parts = divide_segments(on.struct, 0.004)
    keep, segment = thin_contours(on.struct, parts, fast).numpy(), parts.segment.numpy()
    return {i: keep[segment == i].tolist() for i in np.unique(segment)}


@pytest.mark.exhaustive
@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize("apart", [0.005, 0.02, 0.1])
def test_a_line_cut_in_pieces_loses_what_it_loses_whole(device, rng, across, apart):
    """However it is cut: the whole lines are judged by code that knows nothing of pieces."""
    batch = random_batch(rng, 25, spread=0.015, line_most=3, point_most=9, patch_count=2)
    cut, origin = cut_at_vertices(batch, rng)
    assert len(cut.polyline_closed) > 2 * len(batch.polyline_closed)
    whole = kept_by_segment(batch, device, across, apart)
    rule = {"distance": 0.01, "angle": 0.6, "apart": apart, "across": across}
    slow = [kept for pose in range(25) for kept in SlowThinning(batch, pose, 0.004, **rule).run()]
    np.testing.assert_array_equal([kept for i in sorted(whole) for kept in whole[i]], slow)
    pieces = kept_by_segment(cut, device, across, apart)
    assert {int(origin[i]): kept for i, kept in pieces.items()} == {int(i): kept for i, kept in whole.items()}
    assert 0.02 < 1 - np.mean(slow) < 0.9


@pytest.mark.parametrize("turned", [(), (0,), (1,), (0, 2)])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 8])
def test_small_rings_and_bends_in_pieces_that_touch_lose_nothing(count, turned, device):
    """A ring of 18.8 mm and a U of 12 + 4 + 12 mm: any two places are within 2.98 widths, 30.1 mm, along them."""
    setting = a_setting(flat_frames([(0, 0, 0.2), (0, 0, 0.3)], [(0.1, 0.1)] * 2), device)
    ring = circle(0.003, count=48)
    for line in (np.vstack([ring, ring[:1]]), U):
        cuts = np.unique(np.linspace(0, len(line) - 1, count + 1).round().astype(int))
        pieces = [line[a : b + 1] for a, b in itertools.pairwise(cuts)]
        pieces = [piece[::-1] if k in turned else piece for k, piece in enumerate(pieces)]
        for patches in ([0] * len(pieces), [0, *[1] * (len(pieces) - 1)]):  # a line may go on over another patch
            assert pruned(lines_at(*pieces, patches=patches), setting, "close-together")[1].tolist() == [0]


def test_where_three_lines_meet_the_two_that_go_straight_on_are_one(device):
    """A stem goes on through a fork; the branch beside it, at 20 degrees, is another line and shorter."""
    setting = a_setting(flat_frames([(0, 0, 0.2)]), device)
    stem, ahead = [(-0.02, 0, 0.2), (0, 0, 0.2)], [(0, 0, 0.2), (0.02, 0, 0.2)]
    branch = [(0, 0, 0.2), (0.018 * np.cos(0.35), 0.018 * np.sin(0.35), 0.2)]
    whole = pruned(lines_at([stem[0], ahead[1]], branch), setting, "close-together")[1]
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        lines = [(stem, ahead, branch)[k] for k in order]
        assert pruned(lines_at(*lines), setting, "close-together")[1] == pytest.approx(whole, abs=1e-9)
    assert whole[0] > 0.01
