"""Sines, arcs and the hyperbolic tangent from + - * / and square roots alone: the same bits on every device.

The libraries of CPUs and GPUs round such functions in different ways, so a pose made by one would differ from that made
by the other. kernels/motions/portable_angles.py has the same operations in the same order; a test compares bits. All
values are within 1e-15 of the functions, those of the hyperbolic tangent within 1e-14.
"""

import math

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.float64]

SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))
"""Taylor's coefficients of sin(x) / x in x^2: beyond, terms are below 1e-19 for x up to pi / 4."""
COSINE = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(10))
"""Those of cos(x)."""
ARC = tuple((-1.0) ** k / (2 * k + 1) for k in range(12))
"""Those of arctan(x) / x: beyond, terms are below 1e-19 for x up to tan(pi / 16)."""
EXPONENT = tuple(1.0 / math.factorial(k) for k in range(13))
"""Those of exp(x)."""
HALVINGS = 7  # of an exponent, squared as often afterwards: up to 40 becomes 0.32

QUARTER_HIGH = 1.5707963267341256  # pi / 2 in 33 bits, so its product with a small integer is exact
QUARTER_LOW = 6.077100506506192e-11  # the rest


def sine_cosine(angle: Numbers) -> tuple[Numbers, Numbers]:
    """Sine and cosine of angles [rad] of up to 800,000."""
    quarter = np.rint(angle * (2.0 / np.pi))
    return _turned(quarter, (angle - quarter * QUARTER_HIGH) - quarter * QUARTER_LOW)


def sine_of_turns(turns: Numbers) -> Numbers:
    """Sine of 2 pi times a number of turns."""
    quarter = np.rint(4.0 * turns)
    return _turned(quarter, (4.0 * turns - quarter) * (np.pi / 2.0))[0]


def arc_tangent(across: Numbers, along: Numbers) -> Numbers:
    """Angle 0..pi [rad] between the direction `along` and a vector with that part and the part `across` >= 0."""
    flat = np.abs(along)
    steep = across > flat
    larger = np.where(steep, across, flat)
    x = np.where(steep, flat, across) / np.where(larger > 0.0, larger, 1.0)
    for _ in range(2):  # half the angle
        x = x / (1.0 + np.sqrt(1.0 + x * x))
    angle = 4.0 * (x * _polynomial(ARC, x * x))
    angle = np.where(steep, np.pi / 2.0 - angle, angle)
    return np.where(along < 0.0, np.pi - angle, angle)


def hyperbolic_tangent(x: Numbers) -> Numbers:
    """tanh(x) of x in 0..20."""
    e = _polynomial(EXPONENT, -2.0 * x / 2.0**HALVINGS)
    for _ in range(HALVINGS):
        e = e * e
    return (1.0 - e) / (1.0 + e)


def _turned(quarter: Numbers, rest: Numbers) -> tuple[Numbers, Numbers]:
    """Sine and cosine of so many quarter turns and the rest, within -pi / 4..pi / 4 [rad]."""
    square = rest * rest
    sine, cosine = rest * _polynomial(SINE, square), _polynomial(COSINE, square)
    k = quarter - 4.0 * np.floor(0.25 * quarter)
    swapped = (k == 1.0) | (k == 3.0)
    first, second = np.where(swapped, cosine, sine), np.where(swapped, sine, cosine)
    return np.where(k >= 2.0, -first, first), np.where((k == 1.0) | (k == 2.0), -second, second)


def _polynomial(coefficients: tuple[float, ...], x: Numbers) -> Numbers:
    """Horner's rule; the first coefficient is that of 1."""
    value = np.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        value = value * x + coefficient
    return value
