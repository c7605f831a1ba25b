"""Cells of the palm's plane: every drawn focal point is in one, or beyond all."""

import numpy as np
import warp as wp
from contour_shapes import still
from sampling_cases import schedule_of_motions

from palpate.kernels.sampling.dwelling import cell_row, count_cells
from palpate.render.sampling.metrics import cell_edges


def cells_of(place, edges):
    """Number of the cell of each place, -1 outside; 1e-6 m from an edge is on it, and an edge is of the cell above."""
    cell = np.minimum(np.searchsorted(edges - 1e-6, place, side="right") - 1, len(edges) - 2)
    return np.where(np.abs(place) <= edges[-1] + 1e-6, cell, -1)


def test_focal_points_are_counted_in_their_cells(rng, device):
    counts = [rng.integers(0, 12, 50) for _ in range(2)]
    first = np.cumsum([0, *[own.sum() for own in counts]])
    edges = cell_edges(0.08, 0.01)
    place = rng.choice([*edges, *rng.uniform(-0.06, 0.06, 50)], size=(first[-1], 2))
    position = np.column_stack([place[:, 0], place[:, 1], np.full(first[-1], 0.2)]).astype(np.float32)
    intensity = (rng.uniform(size=(first[-1], 1)) > 0.2).astype(np.float32)
    cells = count_cells(
        schedule_of_motions(counts, device),
        wp.array(still(100), dtype=wp.transformd, device=device),  # palm down: u is X, and v is Y
        wp.array(position[:, None], dtype=wp.vec3, device=device),
        wp.array(intensity, device=device),
        *(cell_row(float(edges[0]), float(edges[-1]), 8) for _ in range(2)),
        motions=2,
        poses=100,
    ).numpy()
    for motion in range(2):
        rows = slice(*first[motion : motion + 2])
        shown = intensity[rows, 0] > 0
        u, v = (cells_of(position[rows, axis].astype(float)[shown], edges) for axis in range(2))
        inside = (u >= 0) & (v >= 0)
        assert cells[motion, :-1].tolist() == np.bincount(u[inside] * 8 + v[inside], minlength=64).tolist()
        assert cells[motion, -1] == np.count_nonzero(~inside) > 0
