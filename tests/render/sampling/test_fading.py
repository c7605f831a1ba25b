"""Ages in whole ticks against exact arithmetic with fractions."""

import math
from fractions import Fraction

import numpy as np
import pytest
from contour_shapes import batch_of, square, still

from palpate.datasets.motions import last_pose
from palpate.render import Sampler, SamplingStrategy, sample_contours
from palpate.render.sampling.plan import TICKS, plan_of, ticks_of
from palpate.render.sampling.sampler import age_at, hold_of


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
    assert plan_of(SamplingStrategy(update_rate=1.0, fade=0.0)).fade == 1.0
    assert plan_of(SamplingStrategy(fade=0.02)).fade == 200 * TICKS


def test_a_pose_fades_by_the_first_intervals_as_when_a_file_is_played(monkeypatch):
    """The file's reader knows the first intervals alone, here three of 0.1 s: 0.8 s of each later second are held."""
    monkeypatch.setattr(last_pose, "INTERVALS_LOOKED_AT", 3)
    time = np.array([0.0, 0.1, 0.2, 0.3, 1.3, 2.3, 3.3])
    strategy = SamplingStrategy(update_rate=1000.0, hold=0.05)
    sampler = Sampler(strategy)
    contours = batch_of([[(square(0.04), True)]] * len(time))
    list(sample_contours([contours], still(len(time)), time, 3.3, sampler))
    assert sampler.count.held == 3 * 799  # at 0.2 s itself a pose is not older than that
    assert hold_of(time, strategy) == pytest.approx(0.2)
