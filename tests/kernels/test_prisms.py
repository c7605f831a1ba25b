"""Clip and close against shapely: polygons on the patch's own lines, as walls that the patch cuts halfway up."""

import numpy as np
import pytest
import shapely
from drawing import LEVEL_AXES, SEARCHES, assert_same_bits, draw, patch_array, steps_of, surface_on
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from palpate.kernels.section.draw import HAND

once_a_device = settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
grid = st.integers(-12, 12).map(
    lambda i: i / 8
)  # the patch reaches from -1 to 1: corners and sides are hit all the time
fine = st.floats(-1.5, 1.5, width=32)


@st.composite
def regions(draw, coordinate):
    """A valid polygon, sometimes with a hole, as loops with the inside on the left."""
    corners = np.array(draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=9)))
    around = corners - corners.mean(axis=0)
    ring = shapely.Polygon(corners[np.argsort(np.arctan2(around[:, 1], around[:, 0]), kind="stable")])
    outer = shapely.orient_polygons(ring) if ring.is_valid and ring.area > 1e-3 else shapely.box(-0.5, -1.5, 1.25, 1.0)
    loops = [np.array(outer.exterior.coords)[:-1]]
    hole = shapely.Polygon(draw(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=5)))
    if hole.is_valid and hole.area > 1e-3 and outer.contains_properly(hole):
        loops.append(np.array(shapely.orient_polygons(hole).exterior.coords)[:-1][::-1])
    return [np.roll(loop, draw(st.integers(0, len(loop) - 1)), axis=0).astype(np.float32) for loop in loops]


def prism(loops, capped):
    """Walls of height 2 around z = 0, solid to the left of each loop; capped: a cone on each end makes it watertight.

    The cones may meet themselves or each other: z = 0 does not come near them.
    """
    vertices, faces, count = [], [], 0
    for loop in loops:
        n = len(loop)
        foot = np.arange(n) + count
        foot_after, top, top_after = np.roll(foot, -1), foot + n, np.roll(foot, -1) + n
        faces += [np.stack([foot, foot_after, top_after], axis=1), np.stack([foot, top_after, top], axis=1)]
        if capped:
            faces += [np.stack([top, top_after, np.full(n, count + 2 * n)], axis=1)]
            faces += [np.stack([foot_after, foot, np.full(n, count + 2 * n + 1)], axis=1)]
        tips = [[0.0, 0.0, 2.0], [0.0, 0.0, -2.0]][: 2 * capped]
        vertices += [np.insert(loop, 2, -1, axis=1), np.insert(loop, 2, 1, axis=1), np.reshape(tips, (-1, 3))]
        count += 2 * n + len(tips)
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces)


def found_in(drawn):
    """Length by kind, and how many polylines there are that are longer than rounding."""
    return drawn.length[0].astype(float), sum(steps_of(line).sum() > 1e-5 for line in drawn.lines_of(0))


def contours_of(loops, capped, device, strategy):
    """Contours at the level pose; both methods give the same."""
    surface, patch = surface_on(prism(loops, capped), device), patch_array((1.0, 1.0), device, LEVEL_AXES, rim=0.0)
    traced, sought = (draw(surface, [0, 0, 0, 0, 0, 0, 1], patch, strategy, method) for method in SEARCHES)
    assert_same_bits(traced, sought)
    return traced


def check_region(loops, capped, device, *, counts):
    oc, cc = (contours_of(loops, capped, device, strategy) for strategy in ("oc", "cc"))
    region = shapely.Polygon(loops[0].astype(float), [loop.astype(float) for loop in loops[1:]])
    box = shapely.box(-1, -1, 1, 1)
    inner = shapely.intersection(region.boundary, box).difference(box.boundary)
    solid = [g for g in shapely.get_parts(shapely.intersection(region, box)) if g.geom_type == "Polygon" and g.area > 0]
    open_length, open_count = found_in(oc)
    closed_length, closed_count = found_in(cc)
    assert open_length.sum() == pytest.approx(inner.length, abs=2e-5)
    assert closed_length.sum() == pytest.approx(sum(g.length for g in solid), abs=2e-5)
    assert closed_length[0] == pytest.approx(open_length[0], abs=1e-6)
    assert cc.polyline_closed.all()
    assert set(cc.kind) <= {0, HAND}
    assert set(oc.kind) <= {0}
    for line in cc.lines_of(0):
        assert (line[0] == line[-1]).all()
        assert (steps_of(line) > 0).all()
    if counts:
        lines = [g for g in shapely.get_parts(shapely.line_merge(inner)) if g.length > 1e-5]
        assert open_count == len(lines)
        assert closed_count == sum(1 + len(g.interiors) for g in solid if g.length > 1e-5)


@settings(once_a_device, max_examples=15)
@given(loops=regions(grid), capped=st.booleans())
@example(loops=[np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float32)], capped=True)
@example(loops=[np.array([[-2, 0], [0, -2], [2, 0], [0, 2]], np.float32)], capped=True)
@example(loops=[np.array([[-1, 0], [0, -1], [1, 0], [0, 1]], np.float32)], capped=False)
def test_regions_on_the_patchs_own_lines_are_clipped_and_closed_as_defined(loops, capped, device):
    check_region(loops, capped, device, counts=False)


@pytest.mark.exhaustive
@once_a_device
@given(loops=regions(fine) | regions(grid), capped=st.booleans())
def test_regions_anywhere_are_clipped_and_closed_as_shapely_does(loops, capped, device):
    points = np.concatenate(loops)
    near = np.abs(np.abs(points) - 1).min() < 1e-5
    steps = [np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).min() for loop in loops]
    check_region(loops, capped, device, counts=not near and min(steps) > 1e-4 and not passes_corner(loops))


def passes_corner(loops):
    """Whether a contour comes nearer to a corner of the patch than float32 can tell."""
    corners = shapely.points([(1, 1), (1, -1), (-1, 1), (-1, -1)])
    return min(shapely.LinearRing(loop.astype(float)).distance(corners).min() for loop in loops) < 1e-5


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("capped", [False, True])
def test_many_crossings_of_a_side_and_of_every_corner_are_matched_in_order(capped, device):
    """A star of 24 spikes that all leave the patch, its hollows inside or near the corners."""
    angle = np.arange(48) * 2 * np.pi / 48 + 0.01
    for reach in (1.2, 2.0, 4.0):
        for hollow in (0.5, 0.97, 1.3):
            radius = np.where(np.arange(48) % 2 == 0, reach * np.sqrt(2), hollow)
            loop = (radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(np.float32)
            check_region([loop], capped, device, counts=True)
