"""Intervals of a moved edge in the stadium of another, against distances of points along it."""

import numpy as np
import shapely
import warp as wp
from transform_cases import plane_arrays

from palpate.kernels.fillings.inset_edges import InsetEdges, find_edges, square_distance
from palpate.kernels.fillings.stadium import stadium_interval


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
