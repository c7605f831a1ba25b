"""Arc lengths along polylines and points at them, against the NumPy way."""

import numpy as np
import pytest
import warp as wp
from contour_random import degenerate_batch, random_batch, weighted_batch
from contour_shapes import batch_of, square
from polyline_oracle import Lines

from palpate.kernels.patch import EXACT, to_float32
from palpate.kernels.stages.arc_length import MeasuredLines, measure_lines, point_along

wp.set_module_options(EXACT)


@wp.kernel
def _find_points(
    # In:
    lines: MeasuredLines,
    line: wp.array[wp.int32],
    arc: wp.array[wp.float64],
    # Out:
    points: wp.array[wp.vec3],
):
    """Point at each arc length of a polyline."""
    i = wp.tid()
    points[i] = to_float32(point_along(lines, line[i], arc[i]))


def measured(batch, device):
    there = batch.to(device)
    return measure_lines(there.points, there.polyline_start, there.polyline_closed)


def points_at(batch, line, arc, device):
    out = wp.empty(len(line), dtype=wp.vec3, device=device)
    where = wp.array(line, dtype=wp.int32, device=device), wp.array(arc, dtype=wp.float64, device=device)
    wp.launch(_find_points, len(line), inputs=[measured(batch, device), *where], outputs=[out], device=device)
    return out.numpy()


def test_arcs_are_those_of_the_oracle(device, rng):
    for batch in (weighted_batch(rng, 30), degenerate_batch(rng, 100), random_batch(rng, 0)):
        got, want = measured(batch, device), Lines.of(batch)
        np.testing.assert_array_equal(got.line.numpy(), want.line)
        np.testing.assert_array_equal(got.arc.numpy(), want.arc)
        np.testing.assert_array_equal(got.total.numpy(), want.total)


def test_points_at_arcs_are_those_of_the_oracle(device, rng):
    for batch in (weighted_batch(rng, 30), degenerate_batch(rng, 100)):
        lines = Lines.of(batch)
        line = np.repeat(np.flatnonzero(np.diff(batch.polyline_start) > 1), 20)
        arc = rng.uniform(-2, 3, len(line)) * lines.total[line]  # beyond ends, and more than once around loops
        arc[::5] = lines.arc[np.minimum(batch.polyline_start[line] + 1, len(lines.arc) - 1)][::5]  # at a vertex
        np.testing.assert_array_equal(points_at(batch, line, arc, device), lines.at(line, arc).astype(np.float32))


@pytest.mark.parametrize("arc", [-0.01, 0.15, 0.31])
def test_arcs_of_a_closed_polyline_go_round(arc, device):
    batch = batch_of([[(square(0.04, (0, 0, 0)), True)]])
    np.testing.assert_allclose(points_at(batch, [0], [arc], device), [[-0.02, -0.01, 0]], atol=1e-8)
