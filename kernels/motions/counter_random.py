"""Random numbers from a counter, Philox4x64-10 (Salmon et al. 2011): those of datasets/motions/counter_random.py."""

from typing import Any

import warp as wp

ROUNDS = wp.constant(10)
MULTIPLIER_A, MULTIPLIER_C = wp.constant(wp.uint64(0xD2E7470EE14C6C93)), wp.constant(wp.uint64(0xCA5A826395121157))
STEP_A, STEP_C = wp.constant(wp.uint64(0x9E3779B97F4A7C15)), wp.constant(wp.uint64(0xBB67AE8584CAA73B))
WORD_HALF = wp.constant(wp.uint64(32))
LOW_HALF = wp.constant(wp.uint64(0xFFFFFFFF))
UNIT = wp.constant(wp.float64(2.0**-53))
ROOT_OF_3 = wp.constant(wp.float64(3.0**0.5))

vec2ul: Any = wp.types.vector(length=2, dtype=wp.uint64)


@wp.func
def high_product(x: wp.uint64, y: wp.uint64):
    """The high word of a product of 128 bits."""
    x_high = x >> WORD_HALF
    x_low = x & LOW_HALF
    y_high = y >> WORD_HALF
    y_low = y & LOW_HALF
    one = y_high * x_low
    two = y_low * x_high
    middle = ((y_low * x_low) >> WORD_HALF) + (one & LOW_HALF) + (two & LOW_HALF)
    return y_high * x_high + (one >> WORD_HALF) + (two >> WORD_HALF) + (middle >> WORD_HALF)


@wp.func
def uniform_of(word: wp.uint64):
    """A multiple of 2^-53 in 0..1, 1 left out."""
    return wp.float64(word >> wp.uint64(11)) * UNIT


@wp.func
def uniform(key: vec2ul, first: wp.int64, second: int, third: int, fourth: int):
    """Four numbers of a key and a counter."""
    a = wp.uint64(first)
    b = wp.uint64(second)
    c = wp.uint64(third)
    d = wp.uint64(fourth)
    key_a = key[0]
    key_c = key[1]
    for _turn in range(ROUNDS):
        high_a = high_product(MULTIPLIER_A, a)
        high_c = high_product(MULTIPLIER_C, c)
        low_a = MULTIPLIER_A * a
        low_c = MULTIPLIER_C * c
        a = high_c ^ b ^ key_a
        b = low_c
        c = high_a ^ d ^ key_c
        d = low_a
        key_a = key_a + STEP_A
        key_c = key_c + STEP_C
    return wp.vec4d(uniform_of(a), uniform_of(b), uniform_of(c), uniform_of(d))


@wp.func
def bell(key: vec2ul, first: wp.int64, second: int, third: int):
    """A number of mean 0 and standard deviation 0.97, nearly normal, within -2..2."""
    u = uniform(key, first, second, third, 0)
    sum = ((u[0] + u[1]) + u[2]) + u[3]
    return wp.clamp((sum - wp.float64(2.0)) * ROOT_OF_3, wp.float64(-2.0), wp.float64(2.0))
