"""Ages in whole ticks against exact arithmetic with fractions."""

import math
from fractions import Fraction

import numpy as np
import pytest

from palpate.render.sampling.fading import TICKS, age_at, fade_ticks, ticks_of


@pytest.mark.parametrize("rate", [1_000.0, 10_000.0, 40_000.0, 40_000 / 3])
def test_a_time_is_within_half_a_tick_of_its_exact_product_with_the_rate(rate):
    for seconds in np.random.default_rng(3).uniform(0, 3600, 200).tolist():
        exact = Fraction(seconds) * Fraction(rate) * int(TICKS)
        error = abs(Fraction(float(ticks_of(seconds, rate))) - exact)
        assert error <= Fraction(1, 2) + exact * Fraction(1, 2**52)  # and the rounding of one product


def test_no_time_is_ever_reached_that_never_comes():
    assert ticks_of(math.inf, 10_000.0) == math.inf


@pytest.mark.parametrize("rate", [10_000.0, 40_000 / 3])
def test_ages_of_two_samples_differ_by_the_samples_between_them_however_late_it_is(rate):
    """`Sampler.draw` takes seconds: the whole number of ticks comes back from them, up to a day of samples."""
    for time in (0.011, 7.3, 3599.9871, 86_399.123):
        first = math.ceil(time * rate)
        start = ticks_of(age_at(first, time, rate), rate)
        assert 0 <= start <= TICKS
        for later in (1, 1024, 99_999):
            assert ticks_of(age_at(first + later, time, rate), rate) == start + later * TICKS


def test_a_fade_of_no_time_takes_one_tick_at_least():
    assert fade_ticks(0.0, 1.0) == 1.0
    assert fade_ticks(0.02, 10_000.0) == 200 * TICKS
