"""Warp functions of position, good and bad, for tests of implicit objects."""

import warp as wp

RADIUS = 0.04


@wp.func
def ball(x: wp.vec3) -> float:
    return wp.length(x) - RADIUS


@wp.func
def ball_of_doubles(x: wp.vec3d):
    return wp.length_sq(x) - wp.float64(RADIUS) * wp.float64(RADIUS)


@wp.func
def steep(x: wp.vec3) -> float:
    return wp.tanh(1.0e6 * (wp.length(x) - RADIUS))


@wp.func
def jumping(x: wp.vec3) -> float:
    return wp.sign(wp.length(x) - RADIUS)


@wp.func
def jumping_a_little(x: wp.vec3) -> float:
    r = wp.length(x) - RADIUS
    return r + 1.0e-5 * wp.sign(r)


@wp.func
def level(x: wp.vec3) -> float:
    return 3.0


@wp.func
def high(x: wp.vec3) -> float:
    return x[0] + 1.0


@wp.func
def low(x: wp.vec3) -> float:
    return x[0] - 1.0


@wp.func
def low_but_on_a_sheet(x: wp.vec3) -> float:
    return 1.0e-9 - wp.abs(x[0] - 0.02)


@wp.func
def unknown_below_zero(x: wp.vec3) -> float:
    return wp.sqrt(x[0]) - 0.1


@wp.func
def of_two(x: wp.vec3, y: float) -> float:
    return y


@wp.func
def of_a_number(x: float) -> float:
    return x


@wp.func
def a_vector(x: wp.vec3):
    return x


def plain(x):
    return x
