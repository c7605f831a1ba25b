"""Facing angles of poses that can be worked out by hand."""

import numpy as np
import pytest

from palpate.datasets.motions.facing import facing_angles
from palpate.datasets.motions.hand_motion import PALM_DOWN

DOWN, UP = PALM_DOWN, (-PALM_DOWN[0], 0.0, 0.0, PALM_DOWN[3])


@pytest.mark.parametrize(
    ("place", "turn", "degrees"),
    [
        ((0.0, 0.0, 0.2), DOWN, 0.0),
        ((0.2, 0.0, 0.2), DOWN, 45.0),
        ((0.0, -0.3, 0.0), DOWN, 90.0),
        ((0.0, 0.0, 0.2), UP, 180.0),
        ((0.0, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0), 90.0),  # fingers down, the skin faces the user
        ((0.0, 0.2, 0.0), (0.0, 0.0, 0.0, 1.0), 0.0),
        ((0.0, 0.0, 0.0), DOWN, 90.0),
    ],
)
def test_a_palms_angle(place, turn, degrees):
    assert np.degrees(facing_angles(np.array([[*place, *turn]]))) == pytest.approx([degrees], abs=1e-6)
