"""Faults of contours are found by name."""

from dataclasses import replace

import numpy as np
import pytest
from contour_shapes import batch_of, square

from palpate.kernels.sampling.contour_faults import find_faults

PLAIN = batch_of([[(square(0.04), True), (square(0.02), False)]])
LEVEL = np.linspace(0, 1, PLAIN.point_count, dtype=np.float32)
LEVEL[4] = LEVEL[0]


def changed(values, index, value):
    out = values.copy()
    out[index] = value
    return out


@pytest.mark.parametrize(
    ("batch", "faults"),
    [
        (PLAIN, set()),
        (replace(PLAIN, intensity=LEVEL), set()),
        (replace(PLAIN, intensity=changed(LEVEL, 4, 0.5)), {"open_seam"}),
        (replace(PLAIN, intensity=changed(LEVEL, 8, 0.5)), set()),  # of an open polyline
        (replace(PLAIN, intensity=changed(LEVEL, 7, np.nan)), {"not_finite"}),
        (replace(PLAIN, dwell=LEVEL), set()),
        (replace(PLAIN, dwell=changed(LEVEL, 4, 0.5)), {"open_seam"}),
        (replace(PLAIN, dwell=changed(LEVEL, 7, np.inf)), {"not_finite"}),
        (replace(PLAIN, points=changed(PLAIN.points, (8, 2), np.inf)), {"not_finite"}),
        (batch_of([[(np.zeros((0, 3)), False), (square(0.04), True)]]), {"empty"}),
    ],
)
def test_faults_are_found(batch, faults, device):
    assert find_faults(batch.to(device).struct) == faults
