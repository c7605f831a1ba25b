"""Polygons, strips and fans as triangles, compared with the definitions of OpenGL, corner by corner."""

import numpy as np
import pytest
import shapely

from palpate.datasets.bounded_file import LIMIT_VARIABLE, FileBoundError
from palpate.render.objects.mesh.formats.polygons import (
    fan_triangles,
    polygon_triangles,
    strip_triangles,
)


def test_polygons_of_any_number_of_corners_are_fans(rng):
    counts = rng.integers(1, 8, 50)
    corners = rng.integers(0, 99, counts.sum())
    expected = []
    for own in np.split(corners, np.cumsum(counts)[:-1]):
        expected += [[own[0], own[k], own[k + 1]] for k in range(1, len(own) - 1)]
    np.testing.assert_array_equal(fan_triangles(corners, counts), expected)
    assert fan_triangles(np.empty(0), np.empty(0)).shape == (0, 3)


def test_polygons_become_no_more_than_the_budget_of_a_file(monkeypatch):
    """24 bytes a triangle: 41,000 are within 1 MB, 42,000 are not."""
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    assert fan_triangles(np.zeros(41_002), np.array([41_002])).shape == (41_000, 3)
    with pytest.raises(FileBoundError, match="what its polygons become takes 1008000 bytes"):
        fan_triangles(np.zeros(42_002), np.array([42_002]))


def test_every_second_triangle_of_a_strip_is_turned():
    """OpenGL 4.6, section 10.1.8: triangle i has the corners i, i + 1, i + 2, and an odd one i + 1, i, i + 2."""
    strip = [4, 5, 6, 7, 8, -1, 1, 2, 3, -1, -1, 9, 0]
    assert strip_triangles(np.array(strip)).tolist() == [[4, 5, 6], [6, 5, 7], [6, 7, 8], [1, 2, 3]]
    joined = [0, 1, 2, 2, 3, 3, 4, 5]  # two strips joined by corners that repeat
    assert strip_triangles(np.array(joined)).tolist() == [[0, 1, 2], [4, 3, 5]]


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


@pytest.mark.parametrize("points", [[(0, 0), (1, 1), (1, 0), (0, 1)], [(0, 0), (1, 0), (0, 0), (1, 0)]])
def test_a_polygon_that_no_triangles_fill_keeps_its_fan(points):
    vertices = np.column_stack([np.array(points, float), np.zeros(4)])
    corners, counts = np.arange(4), np.array([4])
    np.testing.assert_array_equal(polygon_triangles(corners, counts, vertices), [[0, 1, 2], [0, 2, 3]])
