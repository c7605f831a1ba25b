"""Insets of regions against shapely's and manifold3d's: random sections, waists, holes, ties, outlines that cross.

An arc is a polygon of 64 segments a turn, in manifold3d as here, so an inset is known to 0.0012 of its distance: it
holds the exact inset at a distance that is larger by so much, and lies in that at a smaller one.
"""

import numpy as np
import pytest
import shapely
from inset_oracle import inset_loops, signed_area
from stage_cases import assert_limited
from transform_cases import plane_arrays, random_stars

from palpate.kernels.fillings.inset import draw_inset

SAGITTA = 1.0 - np.cos(np.pi / 64)  # of the distance, between an arc and its polygon
SQUARE = 0.02 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]])
TURNED = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])


def inset_of(regions, device, distance, **options):
    """Loops of each region [m], None where they are not known."""
    inset, failed_regions = draw_inset(*plane_arrays(regions, device), distance=distance, **options)
    points, start = inset.points.numpy().reshape(-1, 2), inset.line_start.numpy()
    loops = [None if failed else [] for failed in failed_regions.numpy()]
    for k, region in enumerate(inset.line_region.numpy()):
        loops[region].append(points[start[k] : start[k + 1]])
    assert start[-1] == len(points)
    return loops


def enclosed(loops):
    """What loops enclose: counter-clockwise ones, less clockwise ones."""
    outer = [shapely.Polygon(loop).buffer(0) for loop in loops if signed_area(loop) > 0]
    holes = [shapely.Polygon(loop).buffer(0) for loop in loops if signed_area(loop) < 0]
    return shapely.union_all(outer).difference(shapely.union_all(holes))


def assert_inset(loops, region, distance):
    """Loops enclose the exact inset of a region up to the polygons of arcs, and come in their order."""
    error = 1.05 * SAGITTA * distance + 1e-7
    polygon, got = shapely.Polygon(region[0], region[1:]), enclosed(loops)
    assert polygon.buffer(-distance - error, quad_segs=128).difference(got.buffer(1e-8)).area < 1e-12
    assert got.difference(polygon.buffer(error - distance, quad_segs=128).buffer(1e-8)).area < 1e-12
    areas = [signed_area(loop) for loop in loops]
    assert areas == pytest.approx(sorted(areas, reverse=True), rel=1e-9)
    for loop in loops:  # which starts near the region's start
        away = np.linalg.norm(loop - region[0][0], axis=1)
        assert away[0] == away.min()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("distance", [0.0005, 0.002, 0.005, 0.012, 0.03])
def test_random_sections_have_the_inset_of_shapely_and_manifold(distance, seed, device):
    regions = random_stars(np.random.default_rng(seed), 40)
    for loops, region in zip(inset_of(regions, device, distance), regions, strict=True):
        if not shapely.Polygon(region[0], region[1:]).is_valid:
            continue  # a hole that crosses its loop
        assert loops is not None
        assert_inset(loops, region, distance)
        want = enclosed(inset_loops(region, distance))
        assert enclosed(loops).symmetric_difference(want).area <= 1e-4 * shapely.Polygon(region[0]).area


def test_smooth_outlines_of_many_points_have_their_inset(device):
    def ring(radius, count):
        angle = 2 * np.pi * np.arange(count) / count
        return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)

    regions = [[ring(0.02, n)] for n in range(3, 200, 12)]
    regions += [[ring(0.02, n), ring(0.008, m)[::-1]] for n in range(5, 60, 6) for m in range(3, 60, 16)]
    regions += [[ring(0.02, n), ring(0.011, n)[::-1]] for n in range(6, 60, 4)]  # too thin in between
    for loops, region in zip(inset_of(regions, device, 0.005), regions, strict=True):
        assert_inset(loops, region, 0.005)


def random_cells(rng, count):
    """Outlines of random squares of a grid, many corners of which touch other corners, 0.01 m a side."""
    for _ in range(count):
        chosen = np.argwhere(rng.random((6, 6)) < 0.6)
        union = shapely.union_all([shapely.box(i, j, i + 1, j + 1) for i, j in chosen])
        parts = [union] if union.geom_type == "Polygon" else union.geoms
        polygon = shapely.geometry.polygon.orient(max(parts, key=lambda part: part.area))
        yield [0.01 * np.array(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]


@pytest.mark.parametrize("distance", [0.002, 0.00499, 0.005, 0.0050001, 0.0075, 0.01])
def test_outlines_on_a_grid_have_their_inset(distance, device, rng):
    """At 0.005 and 0.01 m what is left of corridors has no width."""
    regions = list(random_cells(rng, 20))
    for turn in (np.eye(2), TURNED):
        turned = [[loop @ turn for loop in region] for region in regions]
        for loops, region in zip(inset_of(turned, device, distance), turned, strict=True):
            assert_inset(loops, region, distance)


def test_outlines_that_cross_turn_straight_back_or_repeat_points_have_the_inset_of_manifold(device):
    eight = 0.01 * np.array([[-1, -1], [1, 1], [1, -1], [-1, 1.0]])
    hole = 0.5 * SQUARE[::-1] + [0.015, 0.0]
    back = np.array([[-0.02, -0.02], [0.02, -0.02], [0.03, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])
    twice = np.array([[-0.02, -0.02], [0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]])
    corridor = 0.004 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * [5, 0.5]  # of twice the distance
    regions = [[eight], [SQUARE, hole], [back], [twice], [corridor], [SQUARE]]
    for loops, region in zip(inset_of(regions, device, 0.002), regions, strict=True):
        want = enclosed(inset_loops(region, 0.002))
        assert enclosed(loops).symmetric_difference(want).area < 1e-7  # [m2], of outlines 0.1 m long
        assert len(loops) == (0 if region[0] is corridor else 1)


def test_a_slit_is_an_outline(device):
    """An outline that runs in and straight back encloses everything around it: its tip is rounded by half a turn."""
    slit = np.array([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.0], [0.0, 0.0], [0.02, 0.0], [0.02, 0.02], [-0.02, 0.02]])
    ((*loops,),) = inset_of([[slit]], device, 0.002)
    line = shapely.LineString([(0.0, 0.0), (0.02, 0.0)])
    want = shapely.Polygon(SQUARE).buffer(-0.002).difference(line.buffer(0.002, quad_segs=128))
    assert enclosed(loops).symmetric_difference(want).area < 1e-7


def test_outlines_that_wind_around_themselves_have_the_inset_of_manifold_or_are_reported(device, rng):
    tangles = [[loop if signed_area(loop) > 0 else loop[::-1]] for loop in rng.normal(0, 0.02, (60, 6, 2))]
    found = inset_of(tangles, device, 0.001)
    for loops, tangle in zip(found, tangles, strict=True):
        if loops is not None:
            want = enclosed(inset_loops(tangle, 0.001))
            assert enclosed(loops).symmetric_difference(want).area < 1e-6
    assert 0 < sum(loops is None for loops in found) < 20


def test_what_lies_in_a_hole_is_not_inside(device):
    """A clockwise loop in a hole has its left side in the hole, where nothing is to be filled."""
    region = [SQUARE, 0.7 * SQUARE[::-1], 0.3 * SQUARE[::-1]]
    ((*loops,),) = inset_of([region], device, 0.001)
    assert_inset(loops, region[:2], 0.001)
    assert len(loops) == 2


def test_a_region_has_the_same_loops_in_every_batch(device, rng):
    regions = random_stars(rng, 12)
    together = inset_of(regions, device, 0.002)
    for region, loops in zip(regions, together, strict=True):
        ((*alone,),) = inset_of([region], device, 0.002)
        assert len(alone) == len(loops)
        for one, other in zip(alone, loops, strict=True):
            np.testing.assert_array_equal(one, other)
    assert sum(len(loops) for loops in together) > 6


def test_batches_of_nothing_and_regions_that_are_left_out_have_no_loops(device):
    assert inset_of([], device, 0.002) == []
    point, two = np.array([[0.001, 0.003]]), np.array([[-0.01, -0.01], [0.01, 0.01]])
    for regions in ([[np.zeros((0, 2))]], [[point]], [[two]], [[SQUARE]]):
        arrays = plane_arrays(regions, device, filled=[0])
        inset, failed = draw_inset(*arrays, distance=0.002)
        assert (inset.points.shape, inset.line_region.shape, failed.numpy().tolist()) == ((0,), (0,), [0])


def test_more_points_than_the_limit_are_refused_with_their_number(device, rng):
    regions = random_stars(rng, 6)

    def points_within(limit):
        return sum(len(loop) for loops in inset_of(regions, device, 0.002, point_limit=limit) for loop in loops)

    assert_limited(points_within)
