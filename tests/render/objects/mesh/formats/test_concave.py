"""Polygons with corners that point inwards, judged by the shoelace formula and by shapely's polygons."""

import numpy as np
import pytest
import shapely

from palpate.render.objects.mesh.formats.concave import unfolded
from palpate.render.objects.mesh.formats.polygons import fan_triangles, polygon_triangles

L = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
KEYHOLE = [(0, 0), (3, 0), (3, 3), (0, 3), (0, 0), (1, 1), (1, 2), (2, 2), (2, 1), (1, 1)]  # a hole, joined by a slit
TURNS = [np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]], np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1])]


def star(count, rng):
    """Corners of a polygon around the origin, each at a random distance."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return (rng.uniform(0.2, 2, count) * np.stack([np.cos(angle), np.sin(angle)])).T


def covered(flat, triangles):
    """What triangles cover together, each counter-clockwise, and the sum of their areas."""
    parts = [shapely.Polygon(flat[triangle]) for triangle in triangles]
    assert all(shapely.is_ccw(part.exterior) for part in parts if part.area > 1e-9)
    return shapely.union_all(parts), sum(part.area for part in parts)


@pytest.mark.parametrize("turn", range(len(TURNS)))
@pytest.mark.parametrize("name", ["L", "keyhole", "star"])
def test_triangles_lie_within_their_polygon(name, turn, rng):
    outline = {"L": np.array(L, float), "keyhole": np.array(KEYHOLE, float), "star": star(12, rng)}[name]
    for roll in range(len(outline)):
        flat = np.roll(outline, roll, axis=0)
        vertices = np.column_stack([flat, np.full(len(flat), 0.5)]) @ TURNS[turn].T
        faces = polygon_triangles(np.arange(len(flat)), [len(flat)], vertices)
        assert faces.shape == (len(flat) - 2, 3)
        ground = shapely.Polygon([(0, 0), (3, 0), (3, 3), (0, 3)], [[(1, 1), (1, 2), (2, 2), (2, 1)]])
        expected = ground if name == "keyhole" else shapely.Polygon(flat)
        whole, total = covered(flat, faces)
        assert whole.symmetric_difference(expected).area < 1e-9
        assert total == pytest.approx(expected.area)


def test_polygons_that_point_nowhere_inwards_keep_their_fans(rng):
    angle = np.linspace(0, 2 * np.pi, 7, endpoint=False)
    flat = np.stack([np.cos(angle), np.sin(angle), np.ones(7)], axis=1)
    vertices = np.concatenate([flat, np.column_stack([np.roll(L, -1, axis=0), np.zeros(6)])])
    corners, counts = np.concatenate([np.arange(7), np.arange(7, 13), [0, 1, 2]]), np.array([7, 6, 3])
    fans = fan_triangles(corners, counts)
    faces = unfolded(fans.copy(), corners, counts, vertices)
    np.testing.assert_array_equal(faces[[*range(5), 9]], fans[[*range(5), 9]])
    assert (faces[5:9] != np.array(fans[5:9])).any()


@pytest.mark.parametrize("points", [[(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (1, 0), (0, 0), (1, 0)]])
def test_a_polygon_that_no_triangles_fill_keeps_its_fan(points):
    vertices = np.column_stack([np.array(points, float), np.zeros(4)])
    corners, counts = np.arange(4), np.array([4])
    np.testing.assert_array_equal(polygon_triangles(corners, counts, vertices), [[0, 1, 2], [0, 2, 3]])
