"""The predicted field of a stratos: its focal point is where it was asked for."""

import numpy as np
import pytest

from palpate.device import array_model
from palpate.render import Driver, FocalPoints

WAVELENGTH = 343.0 / 40e3


@pytest.mark.parametrize("focus", [(0.0, 0.0, 0.2), (0.03, -0.02, 0.15)])
def test_the_predicted_focus_is_where_it_was_asked_for(focus):
    """Superposition by hand of 256 monopoles of the published grid, 16 x 16 at 10.3 mm (HandyBeam's library)."""
    x, y = np.meshgrid((np.arange(16) - 7.5) * 10.3e-3, (np.arange(16) - 7.5) * 10.3e-3)
    place = np.stack([x.ravel(), y.ravel(), np.zeros(256)], axis=1)
    found = Driver("stratos").rounded(FocalPoints(np.float32([focus]), np.ones(1, np.float32)))
    turns = found.delay.numpy()[0] / 256

    def pressure(point):
        r = np.linalg.norm(place - point, axis=-1)
        return abs(np.sum(np.exp(-2j * np.pi * (turns + r / WAVELENGTH)) / r))

    best = np.sum(1 / np.linalg.norm(place - focus, axis=1))
    assert pressure(np.array(focus)) > 0.999 * best
    steps = np.linspace(-4e-3, 4e-3, 17)
    across = [np.argmax([pressure(focus + step * axis) for step in steps]) for axis in np.eye(3)[:2]]
    assert np.abs(steps[across]).max() <= 1e-3
    assert array_model("stratos").transducer_count == 256
