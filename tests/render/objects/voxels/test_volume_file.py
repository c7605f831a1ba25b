"""Units of lengths as the SI defines them, and axes that hold nothing."""

import numpy as np
import pytest

from palpate.render.objects.voxels.files import UNIT_NAMES, UNITS, scaled, without_ones


@pytest.mark.parametrize(("name", "metres"), [("metre", 1.0), ("centimeter", 1e-2), ("mm", 1e-3), ("micron", 1e-6)])
def test_an_affine_map_becomes_one_in_metres(name, metres):
    affine = np.array([[2.0, 0, 0, 5], [0, 3, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]])
    found = scaled(affine, UNIT_NAMES[name])
    np.testing.assert_allclose(found[:3], affine[:3] * metres, rtol=1e-15)
    assert found[3].tolist() == [0, 0, 0, 1]
    assert UNITS[UNIT_NAMES[name]] == metres


def test_axes_of_one_beyond_the_third_are_left_out():
    assert without_ones(np.zeros((1, 2, 1, 1, 1))).shape == (1, 2, 1)
    assert without_ones(np.zeros((1, 2, 3, 4))).shape == (1, 2, 3, 4)
