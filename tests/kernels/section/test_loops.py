"""Sections with a corner that all but lies on another edge, against shapely's distances."""

import numpy as np
import pytest
import shapely

from palpate.kernels.section.loops import have_near_corners

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])


def near(*sections, limit=0.01):
    """Sections as lists of polygons."""
    polygons = [polygon for section in sections for polygon in section]
    after = [first + (np.arange(len(p)) + 1) % len(p) for p, first in zip(polygons, offsets(polygons), strict=True)]
    number = np.repeat(np.arange(len(sections)), [sum(map(len, section)) for section in sections])
    joined = [np.concatenate([np.zeros((0, *rest), kind), *parts])
              for parts, rest, kind in ((polygons, (2,), float), (after, (), np.int64))]  # fmt: skip
    return have_near_corners(*joined, number, len(sections), limit).tolist()


def offsets(polygons):
    return np.cumsum([0, *map(len, polygons)])[:-1]


def test_gaps_within_the_limit_are_found_in_their_own_section_only():
    beside = SQUARE + np.array([4.005, 0.5])
    slit = np.array([[0, 0], [4, 0], [4, 4], [2.004, 4], [2, 1], [1.996, 4], [0, 4]], float)
    assert near([SQUARE, beside], [SQUARE], [beside], [], [slit]) == [True, False, False, False, True]
    assert near([SQUARE, SQUARE + np.array([4.02, 0.5])]) == [False]
    assert near([SQUARE, beside[::-1]]) == [True]
    assert near() == []


def test_a_short_edge_alone_is_no_gap():
    """Two corners nearer to each other than the limit, where lines cross near the end of another."""
    assert near([np.insert(SQUARE, 1, [3.999, 0.0], axis=0)]) == [False]
    assert near([np.insert(SQUARE, 2, [4.0, 0.001], axis=0)]) == [False]


def joined_shortly(polygon, i, j, limit=0.02):
    """Whether corner i is one shorter edge away from edge j."""
    count = len(polygon)
    before = j == (i + 1) % count and np.linalg.norm(polygon[i] - polygon[j]) < limit
    return before or (i == (j + 2) % count and np.linalg.norm(polygon[i] - polygon[(j + 1) % count]) < limit)


@pytest.mark.parametrize("seed", range(5))
def test_random_polygons_are_near_as_shapely_says(seed):
    rng = np.random.default_rng(seed)
    sections = [[rng.uniform(0, 1, (int(rng.integers(3, 7)), 2)) for _ in range(3)] for _ in range(40)]
    found, expected = near(*sections, limit=0.02), []
    for section in sections:
        edges = [(k, i, p[i], p[(i + 1) % len(p)]) for k, p in enumerate(section) for i in range(len(p))]
        distances = [
            shapely.LineString([a, b]).distance(shapely.Point(corner))
            for k, i, corner, _ in edges
            for m, j, a, b in edges
            if not (k == m and (i in (j, (j + 1) % len(section[k])) or joined_shortly(section[k], i, j)))
        ]
        expected.append(min(distances) < 0.02)
    assert found == expected
    assert 0 < sum(found) < 40
