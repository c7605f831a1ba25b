"""Sines, arcs and the hyperbolic tangent from + - * / and square roots alone: the same bits on every device.

The libraries of CPUs and GPUs round such functions in different ways, so a pose made by one would differ from that made
by the other. All values are within 1e-15 of the functions, those of the hyperbolic tangent within 1e-14.
"""

import math
from typing import Any

import warp as wp


def coefficients_of(values: list[float]) -> Any:
    """A constant vector of float64."""
    return wp.constant(wp.types.vector(length=len(values), dtype=wp.float64)(*values))


# Taylor's coefficients. Beyond them, terms are below 1e-19 for angles up to pi / 4, and arcs up to tan(pi / 16).
SINE = coefficients_of([(-1.0) ** k / math.factorial(2 * k + 1) for k in range(9)])
COSINE = coefficients_of([(-1.0) ** k / math.factorial(2 * k) for k in range(10)])
ARC = coefficients_of([(-1.0) ** k / (2 * k + 1) for k in range(12)])
EXPONENT = coefficients_of([1.0 / math.factorial(k) for k in range(13)])
HALVINGS = wp.constant(7)  # of an exponent, squared as often afterwards: up to 40 becomes 0.32

ZERO, ONE, TWO, FOUR = (wp.constant(wp.float64(value)) for value in (0.0, 1.0, 2.0, 4.0))
QUARTER = wp.constant(wp.float64(0.25))
PI = wp.constant(wp.float64(math.pi))
HALF_PI = wp.constant(wp.float64(math.pi / 2.0))
QUARTERS_A_RADIAN = wp.constant(wp.float64(2.0 / math.pi))
QUARTER_HIGH = wp.constant(wp.float64(1.5707963267341256))  # 33 bits, so its product with a small integer is exact
QUARTER_LOW = wp.constant(wp.float64(6.077100506506192e-11))
SCALE = wp.constant(wp.float64(2.0**7))


@wp.func
def horner(coefficients: Any, x: wp.float64):
    """A polynomial; the first coefficient is that of 1."""
    count = int(len(coefficients))
    value = coefficients[count - 1]
    for k in range(1, count):
        value = value * x + coefficients[count - 1 - k]
    return value


@wp.func
def turned(quarter: wp.float64, rest: wp.float64):
    """Sine and cosine of so many quarter turns and the rest, within -pi / 4..pi / 4 [rad]."""
    square = rest * rest
    sine = rest * horner(SINE, square)
    cosine = horner(COSINE, square)
    k = int(quarter - FOUR * wp.floor(QUARTER * quarter))
    first = sine
    second = cosine
    if k == 1 or k == 3:
        first = cosine
        second = sine
    if k >= 2:
        first = -first
    if k == 1 or k == 2:
        second = -second
    return wp.vec2d(first, second)


@wp.func
def sine_cosine(angle: wp.float64):
    """Sine and cosine of an angle [rad] of up to 800,000."""
    quarter = wp.rint(angle * QUARTERS_A_RADIAN)
    return turned(quarter, (angle - quarter * QUARTER_HIGH) - quarter * QUARTER_LOW)


@wp.func
def sine_of_turns(turns: wp.float64):
    """Sine of 2 pi times a number of turns."""
    quarter = wp.rint(FOUR * turns)
    pair = turned(quarter, (FOUR * turns - quarter) * HALF_PI)
    return pair[0]


@wp.func
def arc_tangent(across: wp.float64, along: wp.float64):
    """Angle 0..pi [rad] between the direction `along` and a vector with that part and the part `across` >= 0."""
    flat = wp.abs(along)
    steep = across > flat
    larger = wp.max(across, flat)
    if larger == ZERO:
        larger = ONE
    x = wp.min(across, flat) / larger
    for _turn in range(2):  # half the angle
        x = x / (ONE + wp.sqrt(ONE + x * x))
    angle = FOUR * (x * horner(ARC, x * x))
    if steep:
        angle = HALF_PI - angle
    if along < ZERO:
        angle = PI - angle
    return angle


@wp.func
def hyperbolic_tangent(x: wp.float64):
    """tanh(x) of x in 0..20."""
    e = horner(EXPONENT, -TWO * x / SCALE)
    for _turn in range(HALVINGS):
        e = e * e
    return (ONE - e) / (ONE + e)
