"""Triangles that are there several times: which are walls, and which a surface; by hand, on two boxes with a wall."""

import numpy as np
import pytest

from palpate.render.objects.mesh.sheets import split_repeats


def square(corners):
    a, b, c, d = corners
    return [(a, b, c), (a, c, d)]


# Two unit boxes side by side: corners x + 3 y + 6 z of a grid of 3 x 2 x 2; the wall between them has x = 1.
OUTER = np.array([
    *square((0, 6, 9, 3)), *square((2, 5, 11, 8)),  # x = 0, x = 2
    *square((0, 1, 7, 6)), *square((1, 2, 8, 7)), *square((3, 9, 10, 4)), *square((4, 10, 11, 5)),  # y
    *square((0, 3, 4, 1)), *square((1, 4, 5, 2)), *square((6, 7, 10, 9)), *square((7, 8, 11, 10)),  # z
])  # fmt: skip
WALL = np.array(square((1, 4, 10, 7)))


def parts(faces):
    return [sorted(map(tuple, np.sort(own, axis=1).tolist())) for own in split_repeats(np.asarray(faces))]


OUTSIDE, WITHIN = parts(OUTER)[0], sorted(map(tuple, np.sort(WALL, axis=1).tolist()))


@pytest.mark.parametrize("copies", [(2, 2), (3, 2), (2, 5), (3, 3), (4, 2), (5, 3)])
def test_a_wall_stays_a_wall_however_often_its_triangles_are_there(copies):
    repeated = [WALL[k] for k, count in enumerate(copies) for _ in range(count)]
    assert parts([*OUTER, *repeated]) == [OUTSIDE, WITHIN]


def test_a_triangle_of_the_surface_that_is_there_three_times_counts_once():
    for k in range(len(OUTER)):
        assert parts([*OUTER, OUTER[k], OUTER[k]]) == [OUTSIDE, []], k
    assert parts([*OUTER, *OUTER, *OUTER]) == [OUTSIDE, []]  # all of them: a body of three copies
