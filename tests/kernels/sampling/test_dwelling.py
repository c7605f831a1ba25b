"""Cells of the palm's plane: every drawn focal point is in one, or beyond all."""

import numpy as np
import warp as wp
from contour_shapes import still

from palpate.kernels.sampling.dwelling import cell_row, count_cells
from palpate.render.sampling.metrics import cell_edges, cells_of
from palpate.render.sampling.sampler import MotionSchedule
from palpate.render.sampling.strategy import SamplingStrategy


def test_focal_points_are_counted_in_their_cells(rng, device):
    strategy = SamplingStrategy(update_rate=1000.0)
    schedule = MotionSchedule.of(np.tile(np.arange(50) / 90, 2), [0, 50, 100], [50 / 90] * 2, strategy, None)
    count = int(schedule.row[-1])
    edges = cell_edges(0.08, 0.01)
    place = rng.choice([*edges, *rng.uniform(-0.06, 0.06, 50)], size=(count, 2))
    position = np.column_stack([place[:, 0], place[:, 1], np.full(count, 0.2)]).astype(np.float32)
    intensity = (rng.uniform(size=(count, 1)) > 0.2).astype(np.float32)
    cells = count_cells(
        schedule.on(device, strategy),
        wp.array(schedule.motion, dtype=wp.int64, device=device),
        wp.array(still(100), dtype=wp.transformd, device=device),  # palm down: u is X, and v is Y
        wp.array(position[:, None], dtype=wp.vec3, device=device),
        wp.array(intensity, device=device),
        *(cell_row(float(edges[0]), float(edges[-1]), 8) for _ in range(2)),
    ).numpy()
    for motion in range(2):
        rows = slice(*schedule.sample_start[motion : motion + 2])
        shown = intensity[rows, 0] > 0
        u, v = (cells_of(position[rows, axis].astype(float)[shown], edges) for axis in range(2))
        inside = (u >= 0) & (v >= 0)
        assert cells[motion, :-1].tolist() == np.bincount(u[inside] * 8 + v[inside], minlength=64).tolist()
        assert cells[motion, -1] == np.count_nonzero(~inside) > 0
