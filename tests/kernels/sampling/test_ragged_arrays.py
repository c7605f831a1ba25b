"""Ragged arrays on a device: concatenated, and searched for closed polylines whose ends differ."""

import numpy as np
import warp as wp

from palpate.kernels.sampling.concatenation import concatenate_offsets, concatenate_rows
from palpate.kernels.sampling.seams import has_open_seam


def test_rows_and_offsets_are_those_of_all_parts(device):
    rows = [np.arange(3.0), np.zeros(0), np.arange(5.0)]
    parts = [wp.array(part.astype(np.float32), dtype=wp.float32, device=device) for part in rows]
    assert concatenate_rows(parts).numpy().tolist() == [0, 1, 2, 0, 1, 2, 3, 4]
    starts = [wp.array(start, dtype=wp.int64, device=device) for start in ([0, 1, 3], [0], [0, 0, 5])]
    assert concatenate_offsets(starts, [3, 0, 5]).numpy().tolist() == [0, 1, 3, 3, 8]


def test_a_closed_polyline_whose_ends_differ_is_found(device):
    value = wp.array([0.5, 1.0, 0.5, 0.2, 0.3], dtype=wp.float32, device=device)
    start = wp.array([0, 3, 3, 5], dtype=wp.int64, device=device)
    for closed, found in (([1, 1, 0], False), ([0, 0, 1], True), ([1, 1, 1], True)):
        assert has_open_seam(value, start, wp.array(closed, dtype=wp.uint8, device=device)) is found
