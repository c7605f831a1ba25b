"""Functions of angles on a device: near those of 80 bits, their exact values, and the bits of those on the host."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.motions.portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns
from palpate.kernels.patch import EXACT
from palpate.render.motions.explorations import control_points as host

wp.set_module_options(EXACT)
WIDE = np.longdouble
is_wide = pytest.mark.skipif(np.finfo(WIDE).eps > 1e-18, reason="long double is no wider than float64 here")


@wp.kernel
def _ask(
    # In:
    angle: wp.array[wp.float64],
    across: wp.array[wp.float64],
    # Out:
    value: wp.array2d[wp.float64],
):
    """Every function."""
    i = wp.tid()
    pair = sine_cosine(angle[i])
    value[i, 0] = pair[0]
    value[i, 1] = pair[1]
    value[i, 2] = sine_of_turns(angle[i])
    value[i, 3] = arc_tangent(across[i], angle[i])
    value[i, 4] = hyperbolic_tangent(across[i])


def asked(angle, across, device):
    """Sine and cosine of angles, sine of as many turns, angle of (across, angle), hyperbolic tangent of across."""
    angle, across = np.asarray(angle, float), np.asarray(across, float)
    value = wp.zeros((len(angle), 5), dtype=wp.float64, device=device)
    inputs = [wp.array(column, dtype=wp.float64, device=device) for column in (angle, across)]
    wp.launch(_ask, len(angle), inputs=inputs, outputs=[value], device=device)
    return value.numpy().T


def error(found, exact):
    return float(np.abs(found.astype(WIDE) - exact).max())


@is_wide
@pytest.mark.parametrize("span", [1e-6, 1.0, 7.0, 3000.0, 8e5])
def test_values_are_those_of_80_bits(span, rng, device):
    angle, across = rng.uniform(-span, span, 8000), rng.uniform(0.0, min(span, 20.0), 8000)
    sine, cosine, of_turns, arc, tangent = asked(angle, across, device)
    x, y = angle.astype(WIDE), across.astype(WIDE)
    assert error(sine, np.sin(x)) < 2e-16
    assert error(cosine, np.cos(x)) < 2e-16
    assert error(of_turns, np.sin(2 * np.arctan2(WIDE(0), WIDE(-1)) * (x - np.floor(x)))) < 4e-16
    assert error(arc, np.arctan2(y, x)) < 1e-15
    assert error(tangent, np.tanh(y)) < 1e-14


def test_exact_values(device):
    angle, across = [0.0, 0.25, 0.5, 0.75, 1e6, 1.0, -1.0], [0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0]
    sine, cosine, of_turns, arc, tangent = asked(angle, across, device)
    assert of_turns.tolist() == [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    assert (sine[0], cosine[0], tangent[0]) == (0.0, 1.0, 0.0)
    assert arc[[0, 1, 2, 5, 6]] == pytest.approx([0.0, 0.0, np.pi / 4, np.pi / 4, np.pi], abs=2e-16)


def test_the_host_has_the_same_bits(device, rng):
    spans = np.repeat([1e-9, 1e-3, 1.0, 20.0, 3000.0], 2000)
    angle, across = spans * rng.uniform(-1, 1, len(spans)), rng.uniform(0, 20, len(spans))
    angle[:6], across[:6] = [0.0, -0.0, np.pi / 4, -np.pi / 2, np.pi, 2.5], [0.0, 0.0, np.pi / 4, 1.0, 0.0, 2.5]
    sine, cosine, _, arc, _ = asked(angle, across, device)
    np.testing.assert_array_equal((sine, cosine), host.sine_cosine(angle))
    np.testing.assert_array_equal(arc, host.arc_tangent(across, angle))
