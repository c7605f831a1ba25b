"""The table of loops: that of a slow walk, face by face, for every pattern of vertices above the plane."""

import numpy as np
import pytest
from mesh_cases import built_in, merged, triangle
from small_solids import SOLIDS, hull, tetrahedron

from palpate.kernels.patterns.loop_table import KEY, LOWER, NEXT, PLACE, loops_of, upload_loop_table
from palpate.kernels.section.half_edges import HalfEdges


def walked_loops(surface, above):
    """Loops of half-edges that run down through the plane, if the vertices `above` lie above it: the slow way.

    A contour enters a triangle by the edge that runs down, leaves it by the one that runs up, and goes on in the
    triangle behind that. A loop begins at the scanned crossing of lowest rank; loops are in the order of these ranks.
    """
    runs_down, leads_to = [], {}
    for face in range(len(surface.faces)):
        halves = [3 * face + corner for corner in range(3)]
        down = [h for h in halves if surface.ends[h][0] in above and surface.ends[h][1] not in above]
        up = [h for h in halves if surface.ends[h][0] not in above and surface.ends[h][1] in above]
        assert len(down) == len(up) <= 1
        if down:
            runs_down += down
            leads_to[down[0]] = int(surface.twin[up[0]])
    loops = []
    while runs_down:
        loop = [runs_down[0]]
        while leads_to[loop[-1]] != loop[0]:
            loop.append(leads_to[loop[-1]])
        runs_down = [h for h in runs_down if h not in loop]
        begin = min((surface.rank[h], k) for k, h in enumerate(loop) if surface.scanned[h])[1]
        loops.append(loop[begin:] + loop[:begin])
    return sorted(loops, key=lambda loop: surface.rank[loop[0]])


def loops_in(halves, onward):
    """A pattern's crossings, loop by loop."""
    loops, begin = [], 0
    for k in range(len(halves)):
        if onward[k] <= k:
            assert onward[k] == begin
            loops.append(halves[begin : k + 1].tolist())
            begin = k + 1
        else:
            assert onward[k] == k + 1
    assert begin == len(halves)
    return loops


def patterns_of(loops, most):
    """Numbers of all patterns, or of so many of them."""
    count = len(loops.start) - 1
    return range(0, count, -(-count // most))


@pytest.mark.exhaustive(but="few")
@pytest.mark.parametrize("most", [201, 4096], ids=["few", "all"])
@pytest.mark.parametrize("name", SOLIDS)
def test_loops_of_every_pattern_are_those_of_a_slow_walk(name, most):
    surface = HalfEdges(*SOLIDS[name]())
    loops = loops_of(surface)
    assert len(loops.start) == 2 ** len(loops.vertex) + 1
    for pattern in patterns_of(loops, most):
        own = slice(loops.start[pattern], loops.start[pattern + 1])
        above = {int(v) for k, v in enumerate(loops.vertex) if pattern >> k & 1}
        assert loops_in(loops.half[own], loops.onward[own]) == walked_loops(surface, above)


@pytest.mark.parametrize("name", SOLIDS)
def test_packed_crossings_hold_ends_order_and_keys(name, device):
    surface = HalfEdges(*SOLIDS[name]())
    loops, table = loops_of(surface), upload_loop_table(surface, device)
    vertex, start, packed = (array.numpy() for array in (table.vertex, table.start, table.crossing))
    np.testing.assert_array_equal(start, loops.start)
    upper, lower, onward = packed & 15, packed >> int(LOWER) & 15, packed >> int(NEXT) & 31
    np.testing.assert_array_equal(vertex[upper, :3], surface.vertices[surface.ends[loops.half, 0]])
    np.testing.assert_array_equal(vertex[lower, :3], surface.vertices[surface.ends[loops.half, 1]])
    np.testing.assert_array_equal(onward, loops.onward)
    for pattern in patterns_of(loops, 301):
        first, stop = start[pattern : pattern + 2]
        halves = loops.half[first:stop].tolist()
        assert (packed[first:stop] >> int(KEY) & 31).tolist() == [sorted(halves).index(half) for half in halves]
        assert (packed[first:stop] >> int(PLACE) & 31).tolist() == [halves.index(half) for half in sorted(halves)]


def test_twelve_vertices_have_a_table_of_4096_patterns():
    assert len(loops_of(HalfEdges(*hull(12, 3, round_=True))).start) == 4097


def test_open_and_large_surfaces_have_no_table(device):
    thirteen = hull(13, 1, round_=True)
    many = merged(*(tetrahedron(0.01, (0.02 * k, 0, 0)) for k in range(4)))
    cube = built_in("cube")
    torn = cube[0], cube[1][1:]
    for mesh in (thirteen, many, torn, triangle(), built_in("sphere"), built_in("tube")):
        assert loops_of(HalfEdges(*mesh)) is None
    assert upload_loop_table(HalfEdges(*thirteen), device) is None


def test_surfaces_with_more_crossings_than_a_word_has_bits_have_no_table():
    """Eleven tetrahedra on the same four vertices: a plane can cut all 44 triangles."""
    vertices, faces = tetrahedron()
    surface = HalfEdges(vertices, np.tile(faces, (11, 1)))
    assert surface.open_count == 0
    assert len(surface.faces) == 44
    assert loops_of(surface) is None
