"""Crossings of rows with outlines: how many, in which order, and that memory for them is asked for first."""

from itertools import pairwise

import numpy as np
from stage_cases import assert_limited
from transform_cases import plane_arrays, random_stars

from palpate.kernels.fillings.hatch_crossings import find_crossings, find_rows


def test_crossings_are_sorted_within_their_region(device, rng):
    regions = random_stars(rng, 40)
    arrays = plane_arrays(regions, device)
    c = find_crossings(find_rows(*arrays, spacing=0.002, angle=0.5))
    start, order = c.start.numpy(), c.order.numpy()
    row, x, enters = c.row.numpy(), c.x.numpy(), c.enters.numpy()
    base = start[arrays[2].numpy()]
    assert base[-1] == len(order) > 1000
    for first, stop in pairwise(base):
        own = order[first:stop]
        assert sorted(own) == list(range(stop - first))
        keys = list(zip(row[first + own], x[first + own], -enters[first + own], own, strict=True))
        assert keys == sorted(keys)
        assert np.bincount(row[first:stop], weights=enters[first:stop]).any() == 0  # each row leaves what it enters


def test_crossings_run_along_their_outline(device, rng):
    c = find_crossings(find_rows(*plane_arrays(random_stars(rng, 20), device), spacing=0.002, angle=0.0))
    start, edge, row = c.start.numpy(), c.edge.numpy(), c.row.numpy()
    for first, stop in pairwise(start):
        assert (np.diff(edge[first:stop]) >= 0).all()
        assert (np.abs(np.diff(row[first:stop])) <= 1).all()  # a way from row to row passes those between


def test_more_crossings_than_the_limit_are_refused_with_their_number(device, rng):
    o = find_rows(*plane_arrays(random_stars(rng, 10), device), spacing=0.002, angle=0.0)
    assert_limited(lambda limit: find_crossings(o, limit).x.shape[0])
