"""Functions of angles against NumPy's of 80 bits, and their exact values."""

import numpy as np
import pytest

from palpate.datasets.motions.portable_angles import arc_tangent, hyperbolic_tangent, sine_cosine, sine_of_turns

WIDE = np.longdouble
pytestmark = pytest.mark.skipif(np.finfo(WIDE).eps > 1e-18, reason="long double is no wider than float64 here")


def error(found, exact):
    return float(np.abs(found.astype(WIDE) - exact).max())


@pytest.mark.parametrize("span", [1e-6, 1.0, 7.0, 3000.0, 8e5])
def test_sines_and_cosines(span, rng):
    x = np.append(rng.uniform(-span, span, 100_000), [0.0, np.pi / 4, -np.pi / 4, np.pi / 2, np.pi])
    sine, cosine = sine_cosine(x)
    assert error(sine, np.sin(x.astype(WIDE))) < 2e-16
    assert error(cosine, np.cos(x.astype(WIDE))) < 2e-16


def test_sines_of_turns(rng):
    x = np.append(rng.uniform(-3000.0, 3000.0, 100_000), [0.25, 0.5, 0.75, 1e6])
    exact = np.sin(2 * np.arctan2(WIDE(0), WIDE(-1)) * (x - np.floor(x)).astype(WIDE))
    assert error(sine_of_turns(x), exact) < 4e-16
    assert sine_of_turns(x)[-4:].tolist() == [1.0, 0.0, -1.0, 0.0]


def test_arcs(rng):
    across, along = np.abs(rng.normal(size=100_000)), rng.normal(size=100_000)
    assert error(arc_tangent(across, along), np.arctan2(across.astype(WIDE), along.astype(WIDE))) < 1e-15
    sides = arc_tangent(np.array([0.0, 1.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, -1.0, 1.0, 0.0]))
    assert sides == pytest.approx([0.0, np.pi / 2, np.pi, np.pi / 4, 0.0], abs=2e-16)


def test_the_hyperbolic_tangent(rng):
    x = np.append(rng.uniform(0.0, 20.0, 100_000), [0.0, 1e-9])
    assert error(hyperbolic_tangent(x), np.tanh(x.astype(WIDE))) < 1e-14
    assert hyperbolic_tangent(x)[-2] == 0.0
