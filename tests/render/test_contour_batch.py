"""Polylines without points change nothing, wherever they stand in a batch."""

import numpy as np
import pytest
from contour_shapes import batch_of, square

from palpate.render.contour_batch import without_empty_polylines

NOTHING = np.zeros((0, 3)), False
LINES = [(square(0.04), True), (square(0.02), False)]


@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_polyline_without_points_has_no_length(place, device):
    poses = [[*LINES[:place], NOTHING, *LINES[place:]], [NOTHING], LINES, [NOTHING, NOTHING]]
    batch = batch_of(poses)
    expected = [[0.22, 0, 0], [0, 0, 0], [0.22, 0, 0], [0, 0, 0]]
    np.testing.assert_allclose(batch.lengths(), expected, rtol=1e-6)
    np.testing.assert_allclose(batch.to(device).lengths(), expected, rtol=1e-6)
    full = without_empty_polylines(batch)
    for name, value in batch_of([LINES, [], LINES, []]).by_name().items():
        assert (getattr(full, name) == value).all(), name


def test_a_batch_of_points_alone_is_not_copied():
    batch = batch_of([LINES])
    assert without_empty_polylines(batch) is batch
