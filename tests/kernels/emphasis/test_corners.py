"""Corners of polylines, ramps of intensity there and pauses, and arc lengths, against the NumPy way."""

import numpy as np
import pytest
import warp as wp
from contour_random import degenerate_batch, random_batch, weighted_batch
from contour_shapes import batch_of, square
from emphasis_oracle import emphasise_corners
from emphasis_oracle import find_corners as slow_find_corners
from polyline_oracle import Lines
from stage_cases import assert_limited, stage_batches, stage_result
from transform_cases import assert_equal

from palpate.kernels.emphasis.corners import (
    MeasuredLines,
    find_corners,
    measure_lines,
    pause_at_corners,
    point_along,
    ramp_rows,
    weigh_corners,
)
from palpate.kernels.patch import EXACT, to_float32
from palpate.kernels.stages.insertion import insert_points

wp.set_module_options(EXACT)

OPTIONS = [
    {},
    {"window": 0.001, "reach": 0.08, "level": 0.1, "dwell": 0.5},  # ramps that go around loops several times
    {"angle": 0.0, "window": 0.002, "reach": 0.003, "level": 0.0},
    {"angle": 2.0, "window": 0.03, "reach": 0.02, "level": 1.0, "dwell": 0.02},
    {"angle": np.pi, "level": 0.25, "dwell": 0.01},  # no corner at all
]
RULES = [
    {"angle": np.pi / 6, "window": 0.005},
    {"angle": 0.0, "window": 0.001},
    {"angle": 1.5, "window": 0.03},
    {"angle": np.pi, "window": 0.01},
]


def found(batch, device, **rule):
    return find_corners(batch.to(device).struct, **rule)[1]


def assert_same_corners(batch, device, **rule):
    """Corners are those of the oracle; returns how many."""
    lines = Lines.of(batch)
    at, line = slow_find_corners(lines, **rule)
    got = found(batch, device, **rule)
    np.testing.assert_array_equal(got.point.numpy(), at)
    np.testing.assert_array_equal(got.start.numpy(), np.searchsorted(line, np.arange(batch.polyline_count + 1)))
    np.testing.assert_array_equal(got.arc.numpy(), lines.arc[at])
    return len(at)


@pytest.mark.parametrize("rule", RULES)
def test_corners_are_those_of_the_oracle(rule, device, rng):
    batches = [*stage_batches(rng), random_batch(rng, 30, point_most=100, spread=0.005)]
    count = sum(assert_same_corners(batch, device, **rule) for batch in batches)
    assert (count > 100) == (rule["angle"] < np.pi)


def test_corners_of_a_jagged_line_of_many_points_are_those_of_the_oracle(device, rng):
    points = np.cumsum(rng.normal(size=(800, 3)) * 0.001, axis=0)
    for closed in (False, True):
        assert assert_same_corners(batch_of([[(points, closed)]]), device, angle=0.5, window=0.004) > 60


def test_of_equally_sharp_points_the_first_is_a_corner(device):
    """A zigzag turns by as much at every point within the window; its ends see less."""
    x = 0.001 * np.arange(41)
    batch = batch_of([[(np.stack([x, 0.001 * (np.arange(41) % 2), 0 * x], axis=1), False)]])
    step = np.sqrt(2) * 0.001
    got = found(batch, device, angle=0.5, window=0.9 * step)
    assert got.point.numpy().tolist() == list(range(1, 40))
    got = found(batch, device, angle=0.5, window=1.0001 * step)  # neighbours are within the window now
    assert got.point.numpy().tolist() == list(range(1, 40, 2))


@pytest.mark.parametrize("options", OPTIONS)
def test_corners_are_emphasised_as_the_oracle_does(options, device, rng):
    for batch in stage_batches(rng):
        assert_equal(stage_result("corners", batch, device, **options), emphasise_corners(batch, **options))


def test_an_open_corner_has_its_ramps_and_its_pause(device):
    """A right angle with sides of 20 mm: full intensity for 5 mm from the corner, then 5 mm of ramp."""
    there = batch_of([[([[0.02, 0, 0], [0, 0, 0], [0, 0.02, 0]], False)]]).to(device)
    lines, corners = find_corners(there.struct, angle=1.0, window=0.005)
    new = insert_points(there.struct, *ramp_rows(lines, corners, 0.01))
    way = [0.02, 0.01, 0.005, 0, 0.005, 0.01, 0.02]
    np.testing.assert_allclose(new.contours.points.numpy().sum(axis=1), way, atol=1e-8)
    intensity = weigh_corners(new.contours, corners, reach=0.01, level=0.2).intensity.numpy()
    np.testing.assert_allclose(intensity, [0.2, 0.2, 1, 1, 1, 0.2, 0.2], atol=1e-6)
    assert pause_at_corners(new, corners, 0.5).dwell.numpy().tolist() == [0, 0, 0, 0.5, 0, 0, 0]


def test_more_points_than_the_limit_are_refused(device, rng):
    batch = random_batch(rng, 10)
    assert stage_result("corners", batch, device).point_count > batch.point_count
    assert_limited(lambda limit: stage_result("corners", batch, device, limit=limit).point_count)


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
    return measure_lines(batch.to(device).struct)


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
