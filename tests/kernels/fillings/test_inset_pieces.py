"""Pieces of offsets: what of each is at least the distance away from all edges, by a look at points along it."""

import numpy as np
import shapely
import warp as wp
from transform_cases import plane_arrays, random_stars

from palpate.kernels.fillings.inset_edges import (
    InsetEdges,
    find_edges,
    has_arc,
    offset_end,
    offset_point,
    square_distance,
)
from palpate.kernels.fillings.inset_pieces import find_pieces, stadium_interval

SHARES = 41


@wp.kernel
def _sample_offsets(
    # In:
    edges: InsetEdges,
    # Out:
    parameter: wp.array2d[wp.float64],  # -1 where there is no arc
    point: wp.array2d[wp.vec2d],
):
    """Points along each offset."""
    offset, k = wp.tid()
    parameter[offset, k] = wp.float64(-1.0)
    if offset % 2 == 0 or has_arc(edges, offset // 2):
        t = (wp.float64(k) + wp.float64(0.5)) / wp.float64(41.0) * offset_end(edges, offset)
        parameter[offset, k] = t
        point[offset, k] = offset_point(edges, offset, t)


def test_pieces_are_what_of_offsets_is_far_enough_from_all_edges(device, rng):
    regions, distance = random_stars(rng, 12), 0.004
    edges, failed = find_edges(*plane_arrays(regions, device), distance)
    pieces = find_pieces(edges, failed)
    count, region = 2 * edges.origin.shape[0], edges.region.numpy()
    parameter = wp.empty((count, SHARES), dtype=wp.float64, device=device)
    point = wp.zeros((count, SHARES), dtype=wp.vec2d, device=device)
    wp.launch(_sample_offsets, (count, SHARES), inputs=[edges], outputs=[parameter, point], device=device)
    start, begin, end = pieces.start.numpy(), pieces.begin.numpy(), pieces.end.numpy()
    np.testing.assert_array_equal(pieces.offset.numpy(), np.repeat(np.arange(count), np.diff(start)))
    boundary = [shapely.MultiLineString([np.vstack([loop, loop[:1]]) for loop in loops]) for loops in regions]
    kept = 0
    for offset in range(count):
        own = slice(start[offset], start[offset + 1])
        assert (begin[own] < end[own]).all()
        assert (end[own][:-1] <= begin[own][1:]).all()
        if failed.numpy()[region[offset // 2]]:
            continue
        t = parameter.numpy()[offset]
        away = shapely.distance(boundary[region[offset // 2]], shapely.points(point.numpy()[offset]))
        inside = ((begin[own] <= t[:, None]) & (t[:, None] <= end[own])).any(axis=1)
        assert not inside[t < 0].any()
        clear = (t >= 0) & ((np.abs(away - distance) > 2e-9) | (away >= distance))
        np.testing.assert_array_equal(inside[clear], away[clear] > distance - 1e-9, err_msg=str(offset))
        kept += inside.sum()
    assert 0.1 < kept / (parameter.numpy() >= 0).sum() < 0.9


def test_regions_that_have_failed_have_no_pieces(device, rng):
    regions = random_stars(rng, 10)
    edges, _ = find_edges(*plane_arrays(regions, device), 0.0001)
    failed = wp.array(np.arange(10) % 2, dtype=wp.int32, device=device)
    pieces = find_pieces(edges, failed)
    has = np.unique(edges.region.numpy()[pieces.offset.numpy() // 2])
    assert len(has) > 3
    assert (has % 2 == 0).all()


@wp.kernel
def _find_intervals(
    # In:
    edges: InsetEdges,
    # Out:
    interval: wp.array2d[wp.vec2d],
    square: wp.array2d[wp.float64],
):
    """The interval of each moved edge in the stadium of each edge, and the square of its start's distance from that."""
    e, j = wp.tid()
    interval[e, j] = stadium_interval(edges, e, j)
    square[e, j] = square_distance(edges, j, edges.origin[e])


def test_a_moved_edge_is_in_a_stadium_for_one_interval(device, rng):
    """Of a tangle of edges in all directions, some of which run along others."""
    distance, points = 0.006, rng.uniform(-0.02, 0.02, (30, 2))
    points[1::3] = points[::3] + 0.5 * (points[2::3] - points[::3])  # edges that go on straight
    edges, _ = find_edges(*plane_arrays([[points]], device), distance)
    interval = wp.empty((30, 30), dtype=wp.vec2d, device=device)
    square = wp.empty((30, 30), dtype=wp.float64, device=device)
    wp.launch(_find_intervals, (30, 30), inputs=[edges], outputs=[interval, square], device=device)
    following, inside = np.roll(points, -1, axis=0), 0
    for e in range(30):
        way = following[e] - points[e]
        length = np.linalg.norm(way)
        normal = np.array([-way[1], way[0]]) / length
        t = np.linspace(0, length, 50)
        moved = shapely.points(points[e] + distance * normal + t[:, None] * way / length)
        for j in range(30):
            edge = shapely.LineString([points[j], following[j]])
            np.testing.assert_allclose(square.numpy()[e, j], edge.distance(shapely.Point(points[e])) ** 2, atol=1e-15)
            away = shapely.distance(moved, edge)
            clear = np.abs(away - distance) > 2e-9
            low, high = interval.numpy()[e, j]
            np.testing.assert_array_equal(
                ((t > low) & (t < high))[clear & (t > 0) & (t < length)],
                (away < distance)[clear & (t > 0) & (t < length)],
            )
            inside += (away < distance).sum()
    assert 0.2 < inside / (30 * 30 * 50) < 0.8
