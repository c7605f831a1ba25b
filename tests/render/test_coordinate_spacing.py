"""Coordinates too far from the array for float32: whatever is far, object or hand, is what the way out moves."""

import numpy as np
import pytest

from palpate.render.coordinate_spacing import warn_of_spacing
from palpate.render.errors import PalpateWarning

BOX = np.array([[-0.05, -0.05, 0.15], [0.05, 0.05, 0.25]])


def test_only_an_object_that_is_far_is_to_be_moved_by_its_own_option():
    """A mesh whose middle lies 200 mm high, read in metres and fitted: float32 steps by 2^-16 m from 128 m on."""
    pose = np.array([[0, 0, 0.2, 0, 0, 0, 1]], np.float32)
    with pytest.warns(PalpateWarning, match=r"1.5e-05 m.*origin; at=\(0, 0, 0.2\) moves the object there$"):
        warn_of_spacing("mug", BOX + np.array([0, 0, 199.8]), pose)
    with pytest.warns(PalpateWarning, match=r"1.5e-05 m.*array's origin$"):
        warn_of_spacing("mug", BOX, pose + np.float32([0, 0, 199.8, 0, 0, 0, 0]))
