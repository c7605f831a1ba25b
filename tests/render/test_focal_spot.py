"""Size of a focal point: published simulations, an integral worked out otherwise, and what must hold of any array."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import j1

from palpate.device.registry import array_model
from palpate.render.errors import StrategyError
from palpate.render.focal_spot import focal_width, peak_width

# 16 x 16 transducers at 10.5 mm, exact pistons, phases only: height; FWHM of p^2 across and along [m];
# the same 60 mm off the middle, across and along, where there are figures.
TABLE = [
    (0.10, 0.0063, 0.027, 0.0075, 0.019),
    (0.15, 0.0081, 0.045, 0.0093, 0.028),
    (0.20, 0.0101, 0.070, 0.0111, 0.041),
    (0.25, 0.0122, 0.100, 0.0130, 0.056),
    (0.30, 0.0144, 0.133, 0.0151, 0.074),
]


@pytest.mark.parametrize(("height", "across", "along", "aside_across", "aside_along"), TABLE)
def test_sizes_are_those_of_a_simulation_by_others(height, across, along, aside_across, aside_along):
    size = focal_width(height)
    assert size.x == pytest.approx(across, rel=0.03)
    assert size.y == pytest.approx(size.x, rel=1e-6)
    assert size.z == pytest.approx(along, rel=0.03)
    assert size.width == pytest.approx(size.x)
    aside = focal_width(np.array([0.06, 0.0, height]))
    assert aside.x == pytest.approx(aside_across, rel=0.03)
    assert aside.z == pytest.approx(aside_along, rel=0.03)
    assert aside.y < aside.x


def squared_pressure(points, focus):
    """|p|^2 of the default array, transducer by transducer."""
    k, total = 2 * np.pi * 40e3 / 343, 0
    for x in array_model("emulator").position.astype(float):
        way = points - x
        r = np.linalg.norm(way, axis=1)
        s = k * 4.5e-3 * np.hypot(way[:, 0], way[:, 1]) / r
        directivity = np.where(s > 1e-9, 2 * j1(s) / np.maximum(s, 1e-9), 1)
        total = total + directivity / r * np.exp(1j * k * (r - np.linalg.norm(focus - x)))
    return np.abs(total) ** 2


@pytest.mark.exhaustive
def test_the_half_power_points_are_where_a_plain_sum_has_half_the_peak():
    focus = np.array([0.02, -0.01, 0.17])
    size = focal_width(focus)
    t = np.linspace(-0.05, 0.05, 20001)
    for axis, width in enumerate((size.x, size.y, size.z)):
        power = squared_pressure(focus + t[:, None] * np.eye(3)[axis], focus)
        top = np.argmax(np.where(np.abs(t) < 0.01, power, 0))
        below = np.flatnonzero(power < power[top] / 2)
        assert width == pytest.approx(t[below[below > top][0]] - t[below[below < top][-1]], abs=3e-5)


def test_a_placed_array_has_the_same_focus_in_its_own_frame():
    turned = array_model("emulator").placed([0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5])  # its z is the common x
    near = focal_width(0.15, array=turned)
    there = focal_width(np.array([0.1 + 0.15, 0.2, 0.3]), array=turned)
    own = focal_width(0.15)
    for name in ("x", "y", "z", "width"):
        assert getattr(near, name) == pytest.approx(getattr(own, name), rel=1e-4)
        assert getattr(there, name) == pytest.approx(getattr(own, name), rel=1e-4)


def test_a_slower_sound_and_a_larger_array_focus_better():
    assert focal_width(0.2, speed_of_sound=330.0).width < focal_width(0.2).width
    autd = focal_width(0.2, array=array_model("autd3"))
    assert autd.x < 0.95 * autd.y  # 18 columns, 14 rows


def test_transducers_count_by_their_gain():
    array = array_model("emulator")
    inner = np.abs(array.position[:, 0]) < 0.5 * np.abs(array.position[:, 0]).max()
    narrow = focal_width(0.2, array=replace(array, gain=np.where(inner, 1.0, 0.0).astype(array.gain.dtype)))
    assert narrow.x > 1.5 * focal_width(0.2).x  # half as broad an array along x
    assert narrow.y == pytest.approx(focal_width(0.2).y, rel=0.05)


def test_a_size_is_reckoned_once():
    assert focal_width(0.123) is focal_width(np.array([0, 0, 0.123]))


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (0.003, "from a transducer, must be 0.01 m at least"),
        (-0.1, "behind the array"),
        (np.nan, "finite"),
        (np.zeros(2), "three finite numbers"),
        ("high", "three finite numbers .* not 'high'"),
        (10**400, "three finite numbers"),
        (1e300, "10 m at most"),
        (10.5, "m from the nearest transducer, must be 10 m at most"),
    ],
)
def test_where_there_is_no_focus_is_refused(point, words):
    with pytest.raises(StrategyError, match=words):
        focal_width(point)
    with pytest.raises(StrategyError, match="speed of sound"):
        focal_width(0.2, speed_of_sound=0)


def test_widths_of_a_known_curve():
    bell = peak_width(lambda t: np.exp(-(((t - 5e-4) / 4e-3) ** 2)), 1e-3)
    assert bell == pytest.approx(8e-3 * np.sqrt(np.log(2)), rel=1e-3)
    two = peak_width(lambda t: np.exp(-((t / 4e-3) ** 2)) + 5 * np.exp(-(((t - 0.05) / 4e-3) ** 2)), 1e-3)
    assert two == pytest.approx(bell, rel=1e-3)  # the top that is nearest uphill, not the highest
    assert np.isfinite(peak_width(lambda t: np.ones_like(t), 1e-3))
