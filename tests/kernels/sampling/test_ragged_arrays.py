"""Ragged arrays on a device are concatenated."""

import numpy as np
import warp as wp

from palpate.kernels.sampling.concatenation import concatenate_offsets, concatenate_rows


def test_rows_and_offsets_are_those_of_all_parts(device):
    rows = [np.arange(3.0), np.zeros(0), np.arange(5.0)]
    parts = [wp.array(part.astype(np.float32), dtype=wp.float32, device=device) for part in rows]
    assert concatenate_rows(parts).numpy().tolist() == [0, 1, 2, 0, 1, 2, 3, 4]
    starts = [wp.array(start, dtype=wp.int64, device=device) for start in ([0, 1, 3], [0], [0, 0, 5])]
    assert concatenate_offsets(starts, [3, 0, 5]).numpy().tolist() == [0, 1, 3, 3, 8]
