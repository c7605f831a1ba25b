"""Random numbers from a counter: Philox4x64-10 of Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011).

A key and a counter give four numbers by integer arithmetic alone, so any of them can be made without those before it,
in any order, and a device that has 64-bit integers makes the same bits. `numpy.random.Philox` is the same generator; a
test compares them.
"""

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]

ROUNDS = 10
_MULTIPLIERS = (0xD2E7470EE14C6C93, 0xCA5A826395121157)
_KEY_STEPS = (0x9E3779B97F4A7C15, 0xBB67AE8584CAA73B)  # 2^64 / golden ratio, and sqrt(3) - 1
_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_UNIT = 2.0**-53


def philox(key: tuple[int, int], counter: Words) -> Words:
    """Four random 64-bit words of each counter, shape [..., 4]; key: two integers of 0 to 2^64 - 1."""
    a, b, c, d = (counter[..., k].astype(np.uint64) for k in range(4))
    with np.errstate(over="ignore"):  # products are modulo 2^64; NumPy warns of those of scalars
        for turn in range(ROUNDS):
            keys = [np.uint64((word + turn * step) % 2**64) for word, step in zip(key, _KEY_STEPS, strict=True)]
            (high_a, low_a), (high_c, low_c) = _product(_MULTIPLIERS[0], a), _product(_MULTIPLIERS[1], c)
            a, b, c, d = high_c ^ b ^ keys[0], low_c, high_a ^ d ^ keys[1], low_a
    return np.stack([a, b, c, d], axis=-1)


def uniform(key: tuple[int, int], *counter: "NDArray[np.int64] | int") -> NDArray[np.float64]:
    """Four numbers of each counter, multiples of 2^-53 in 0..1 (1 left out), shape [..., 4].

    counter: up to four integers of 0 or more, or arrays of them that broadcast; those left out are 0.
    """
    words = np.broadcast_arrays(*(np.asarray(word, np.uint64) for word in (*counter, 0, 0, 0)[:4]))
    return (philox(key, np.stack(words, axis=-1)) >> np.uint64(11)).astype(np.float64) * _UNIT


def bell(key: tuple[int, int], *counter: "NDArray[np.int64] | int") -> NDArray[np.float64]:
    """One number of each counter, of mean 0 and standard deviation 1 (0.97), nearly normal, within -2..2.

    It is a sum of four uniform numbers, as that needs no logarithm, which devices round in different ways. What lies
    beyond 2 (4 %) is set to 2; without that the deviation would be 1.
    """
    return np.clip((uniform(key, *counter).sum(axis=-1) - 2.0) * np.sqrt(3.0), -2.0, 2.0)


def _product(factor: int, x: Words) -> tuple[Words, Words]:
    """High and low word of the 128-bit products of a 64-bit factor and words."""
    f_high, f_low = np.uint64(factor >> 32), np.uint64(factor & 0xFFFFFFFF)
    x_high, x_low = x >> _HALF, x & _LOW
    low, one, two = x_low * f_low, x_high * f_low, x_low * f_high
    middle = (low >> _HALF) + (one & _LOW) + (two & _LOW)
    high = x_high * f_high + (one >> _HALF) + (two >> _HALF) + (middle >> _HALF)
    return high, x * np.uint64(factor)
