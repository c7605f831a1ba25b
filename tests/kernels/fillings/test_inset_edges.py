"""Edges of regions and their offsets: at the distance, on the left, round corners, and by region."""

import numpy as np
import pytest
import warp as wp
from transform_cases import plane_arrays, random_stars

from palpate.kernels.fillings.inset_edges import (
    InsetEdges,
    diamond_angle,
    find_edges,
    has_arc,
    offset_end,
    offset_point,
)


@wp.kernel
def _sample_offsets(
    # In:
    edges: InsetEdges,
    share: wp.array[wp.float64],
    # Out:
    arc: wp.array[wp.int32],
    point: wp.array2d[wp.vec2d],
):
    """Points of each offset at shares of its parameter."""
    offset, k = wp.tid()
    arc[offset // 2] = wp.where(has_arc(edges, offset // 2), 1, 0)
    point[offset, k] = offset_point(edges, offset, share[k] * offset_end(edges, offset))


@wp.kernel
def _find_angles(
    # In:
    vector: wp.array[wp.vec2d],
    # Out:
    angle: wp.array[wp.float64],
):
    """Diamond angles of vectors."""
    i = wp.tid()
    angle[i] = diamond_angle(vector[i][0], vector[i][1])


def test_diamond_angles_grow_with_the_angle(device):
    turn = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    vectors = wp.array(np.stack([np.cos(turn), np.sin(turn)], axis=1), dtype=wp.vec2d, device=device)
    angle = wp.empty(720, dtype=wp.float64, device=device)
    wp.launch(_find_angles, 720, inputs=[vectors], outputs=[angle], device=device)
    assert (np.diff(angle.numpy()) > 0).all()
    assert angle.numpy()[[0, 180, 360, 540]] == pytest.approx([0, 1, 2, 3], abs=1e-12)


def test_offsets_run_at_the_distance_to_the_left_and_around_right_turns(device, rng):
    regions, distance = random_stars(rng, 20), 0.003
    edges, failed = find_edges(*plane_arrays(regions, device), distance)
    share = np.linspace(0, 1, 9)
    count = edges.origin.shape[0]
    arc = wp.empty(count, dtype=wp.int32, device=device)
    point = wp.empty((2 * count, 9), dtype=wp.vec2d, device=device)
    shares = wp.array(share, dtype=wp.float64, device=device)
    wp.launch(_sample_offsets, (2 * count, 9), inputs=[edges, shares], outputs=[arc, point], device=device)
    points, e = point.numpy(), 0
    for loop in (loop for region in regions for loop in region):
        a, b, c = loop, np.roll(loop, -1, axis=0), np.roll(loop, -2, axis=0)
        for p, q, r in zip(a, b, c, strict=True):
            way = (q - p) / np.linalg.norm(q - p)
            normal = np.array([-way[1], way[0]])
            line = p + share[:, None] * (q - p) + distance * normal
            np.testing.assert_allclose(points[2 * e], line, atol=1e-15)
            assert (arc.numpy()[e] == 1) == (normal @ (r - q) < 0)
            if arc.numpy()[e]:
                other = (r - q) / np.linalg.norm(r - q)
                np.testing.assert_allclose(np.linalg.norm(points[2 * e + 1] - q, axis=1), distance, rtol=1e-12)
                np.testing.assert_allclose(points[2 * e + 1, 0], line[-1], atol=1e-15)
                end = q + distance * np.array([-other[1], other[0]])
                np.testing.assert_allclose(points[2 * e + 1, -1], end, atol=1e-12)
            e += 1
    assert e == count
    assert not failed.numpy().any()


def test_edges_are_linked_around_their_polyline_and_have_its_region(device, rng):
    regions = random_stars(rng, 8)
    order = rng.permutation(sum(len(region) for region in regions))
    filled = np.array([1, 1, 0, 1, 1, 1, 1, 1])
    edges, _ = find_edges(*plane_arrays(regions, device, order=order, filled=filled), 0.001)
    after, before, region = edges.after.numpy(), edges.before.numpy(), edges.region.numpy()
    origin, start = edges.origin.numpy(), edges.start.numpy()
    np.testing.assert_array_equal(after[before], np.arange(len(after)))
    entry = 0
    for k, loops in enumerate(regions):
        for loop in loops:
            own = slice(start[entry], start[entry + 1])
            assert (region[own] == k).all()
            np.testing.assert_array_equal(origin[own].reshape(-1, 2), loop if filled[k] else np.zeros((0, 2)))
            np.testing.assert_array_equal(origin[after[own]].reshape(-1, 2), np.roll(origin[own], -1, axis=0))
            entry += 1
