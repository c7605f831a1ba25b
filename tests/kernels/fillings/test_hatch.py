"""Hatch lines over regions: the same lines as plain NumPy draws, bit by bit, whatever the regions and the batch."""

import numpy as np
import pytest
from hatch_oracle import hatch_lines
from stage_cases import assert_limited
from transform_cases import plane_arrays, random_stars

from palpate.kernels.fillings.hatch import draw_hatch
from palpate.kernels.offsets import PointLimitError

SQUARE = 0.02 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])


def lines_of(hatch):
    """(region, points [m]) of each line, on the host."""
    points, start = hatch.points.numpy().reshape(-1, 2), hatch.line_start.numpy()
    assert (start[0], start[-1], len(start)) == (0, len(points), hatch.line_region.shape[0] + 1)
    return [
        (int(region), points[a:b])
        for region, a, b in zip(hatch.line_region.numpy(), start[:-1], start[1:], strict=True)
    ]


def assert_hatched(regions, device, *, filled=None, order=None, spacing=0.003, angle=0.0, connected=True):
    """The kernel's lines are the oracle's, bit by bit, in their order; how many there are."""
    options = {"spacing": spacing, "angle": angle, "connected": connected}
    got = lines_of(draw_hatch(*plane_arrays(regions, device, order=order, filled=filled), **options))
    want = [
        (k, line)
        for k, loops in enumerate(regions)
        if filled is None or filled[k]
        for line in hatch_lines(loops, spacing, angle, connected=connected)
    ]
    assert [k for k, _ in got] == [k for k, _ in want]
    for (_, line), (_, other) in zip(got, want, strict=True):
        np.testing.assert_array_equal(line, other)
    return len(got)


def lattice_loops(rng, count, spacing):
    """Loops that cross themselves and each other, with vertices and edges on rows, and vertices that coincide."""
    return [
        [spacing * rng.integers(-3, 4, (int(rng.integers(3, 12)), 2)) for _ in range(int(rng.integers(1, 4)))]
        for _ in range(count)
    ]


@pytest.mark.parametrize("connected", [True, False])
@pytest.mark.parametrize("angle", [0.0, 0.6, -2.5])
def test_random_regions_have_the_lines_of_the_oracle(angle, connected, device, rng):
    """Whatever the order of their loops in the batch."""
    regions = random_stars(rng, 60)
    order = rng.permutation(sum(len(region) for region in regions))
    assert assert_hatched(regions, device, angle=angle, connected=connected, order=order) > 60


@pytest.mark.parametrize("connected", [True, False])
def test_loops_that_cross_and_touch_on_rows_have_the_lines_of_the_oracle(connected, device, rng):
    for spacing in (0.003, 0.25):
        regions = lattice_loops(rng, 60, spacing)
        for angle in (0.0, np.pi / 2):
            assert assert_hatched(regions, device, spacing=spacing, angle=angle, connected=connected) > 60


def test_a_region_between_two_rows_gets_one_through_its_middle(device):
    thin = np.array([[-0.02, 0.004], [0.02, 0.004], [0.02, 0.006], [-0.02, 0.006]])
    arrays = plane_arrays([[thin]], device)
    ((_, line),) = lines_of(draw_hatch(*arrays, spacing=0.02, angle=0.0, connected=True))
    np.testing.assert_allclose(line, [[-0.02, 0.005], [0.02, 0.005]], atol=1e-12)
    assert assert_hatched([[thin], [SQUARE], [thin + 0.02]], device, spacing=0.02) == 3


def test_polylines_that_enclose_nothing_have_no_lines(device):
    point, two = np.array([[0.001, 0.003]]), np.array([[-0.01, -0.01], [0.01, 0.01]])
    flat = np.array([[-0.01, 0.003], [0.0, 0.003], [0.01, 0.003]])
    assert assert_hatched([], device) == 0
    assert assert_hatched([[point], [two], [flat]], device) == 0
    assert assert_hatched([[point], [SQUARE], [flat, SQUARE]], device) == 2
    none = [np.zeros((0, 2))]  # no points at all, not even the one that is repeated
    got = lines_of(draw_hatch(*plane_arrays([none, [SQUARE]], device), spacing=0.01, angle=0.0, connected=True))
    assert [k for k, _ in got] == [1]


def test_more_points_than_the_limit_are_refused_with_their_number(device):
    arrays, options = plane_arrays([[SQUARE]] * 3, device), {"spacing": 0.006, "angle": 0.0, "connected": True}
    assert draw_hatch(*arrays, **options).points.shape[0] == 3 * 14
    assert_limited(lambda limit: draw_hatch(*arrays, **options, point_limit=limit).points.shape[0])
    # a vertex between the third and the fourth of 7 rows, where the line turns round it, is a point, too
    corner = plane_arrays([[np.array([[-0.02, -0.02], [0.02, -0.003], [-0.02, 0.02]])]], device)
    with pytest.raises(PointLimitError) as caught:
        draw_hatch(*corner, **options, point_limit=14)
    assert caught.value.count == 15
