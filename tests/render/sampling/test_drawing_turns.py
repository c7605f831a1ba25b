"""What a cycle's whole number of samples must not cost: short polylines are drawn by turns, and bands are kept."""

from fractions import Fraction

import numpy as np
import pytest
from contour_shapes import batch_of, circle, still
from hypothesis import assume, given
from hypothesis import strategies as st

from palpate.render.errors import StrategyError
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler
from palpate.render.sampling.strategy import Gap, Order, Pace, SamplingStrategy, Sections

BIG = (circle(0.02, (0, -0.04, 0.2), 360), True)
STEP = 7e-4


def loops(length, count=10):
    """Small loops, of so long a way each [m], well apart."""
    side = length / 4
    corners = side * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    return [(corners + np.array([4e-3 * k, 0.01 * (k % 3), 0.2]), True) for k in range(count)]


def visits(lines, strategy, samples):
    """How many samples lie on each line, of a pose that stays."""
    sampler = Sampler(strategy)
    position = sampler.draw(batch_of([lines]), still(1)[0], samples).position.reshape(-1, 3).astype(float)
    centres = np.array([points.mean(axis=0) for points, _ in lines])
    reach = [
        np.linalg.norm(points - centre, axis=1).max() + 1e-6 for (points, _), centre in zip(lines, centres, strict=True)
    ]
    near = np.linalg.norm(position[:, None] - centres, axis=2) < np.array(reach)
    return near.sum(axis=0), sampler


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("route", ["shortest", "given"])
@pytest.mark.parametrize("length", [0.1 * STEP, 0.3 * STEP, 0.62 * STEP, 0.99 * STEP, 1.5 * STEP, 1e-6])
def test_ten_small_loops_are_all_drawn_in_some_of_the_cycles(length, route):
    """Of places that lie evenly, a stretch of x spacings holds as many as x rounded down or up: arithmetic."""
    lines = [BIG, *loops(length)]
    total = 360 * np.linalg.norm(BIG[0][1] - BIG[0][0]) + 10 * length
    nominal = int(np.ceil(total / STEP))
    given = max(length, total / nominal / 8)  # a loop shorter than an eighth of a step is given that
    step = (total + 10 * (given - length)) / nominal
    turns = int(np.ceil(step / given + 1 / nominal)) if given < step else 1
    found, sampler = visits(lines, SamplingStrategy(order=Order(route=route)), 20 * (turns * nominal + (turns > 1)))
    share = given / step * turns
    assert found[1:].min() >= 20 * np.floor(share)
    assert found[1:].max() <= 20 * np.ceil(share + 0.1)
    assert np.floor(share) >= 1
    assert sampler.count.draw_frequency(10_000.0) == pytest.approx(7.0 / total, rel=0.01)
    assert sampler.count.absence_max <= turns * (nominal + 1) / 10_000


@pytest.mark.parametrize(
    "strategy",
    [
        SamplingStrategy(pace=Pace(kind="capped")),
        SamplingStrategy(pace=Pace(kind="frequency", frequency=70.0)),
        SamplingStrategy(order=Order(kind="pendulum")),
        SamplingStrategy(gap=Gap(kind="return")),
        SamplingStrategy(gap=Gap(kind="close")),
        SamplingStrategy(foci=3),
    ],
)
def test_small_loops_are_drawn_by_every_way_to_sample(strategy):
    found, _ = visits([BIG, *loops(0.4 * STEP)], strategy, 10_000)
    assert found.min() >= 10


def test_samples_over_all_turns_are_evenly_spread():
    """Exact arithmetic: k T / (N T + 1) mod 1 for k = 0 .. N T are the multiples of 1 / (N T + 1), each once."""
    length = 0.3 * STEP
    contours = batch_of([[BIG, *loops(length)]])
    sampler = Sampler(SamplingStrategy())
    cycle = sampler.cycle(contours)
    count = len(cycle.intensity)
    nominal = SamplingStrategy().samples_a_cycle(contours.length()[0])
    turns = next(t for t in range(2, 20) if nominal * t + 1 == count)
    places = sorted({Fraction(k * turns, count) % 1 for k in range(count)})
    assert places == [Fraction(j, count) for j in range(count)]
    found = (
        np.linalg.norm(cycle.position[:, None] - np.array([p.mean(axis=0) for p, _ in loops(length)]), axis=2) < length
    )
    share = length / contours.length()[0] * count  # of the evenly spread places
    assert set(found.sum(axis=0)) <= {int(np.floor(share)), int(np.ceil(share))}
    assert np.floor(share) >= 1


@pytest.mark.exhaustive
def test_a_contour_that_moves_draws_its_small_loops_too():
    sampler, found = Sampler(SamplingStrategy()), np.zeros(10, int)
    for k in range(180):
        shift = np.array([0, 0, 1e-4 * k])
        lines = [(points + shift, closed) for points, closed in [BIG, *loops(0.4 * STEP)]]
        position = sampler.draw(batch_of([lines]), still(1)[0], 111).position.astype(float)
        centres = np.array([points.mean(axis=0) for points, _ in lines[1:]])
        found += (np.linalg.norm(position[:, None] - centres, axis=2) < 0.4 * STEP).sum(axis=0)
    assert found.min() > 20


def test_contours_without_short_ones_repeat_after_one_cycle():
    lines = [BIG, *loops(1.2 * STEP)]
    contours = batch_of([lines])
    count = len(Sampler(SamplingStrategy()).cycle(contours).intensity)
    assert count == SamplingStrategy().samples_a_cycle(contours.length()[0])
    assert len(Sampler(preset("stp", sections=Sections(count=7))).cycle(contours, limit=20_000).intensity) == 20_000


@given(
    length=st.floats(1e-3, 3.0),
    rate=st.sampled_from([40_000.0, 10_000.0, 40_000 / 3, 5000.0, 1234.5]),
    lowest=st.floats(5.0, 150.0),
    width=st.floats(1.0, 20.0),
)
def test_capped_stays_in_its_band(length, rate, lowest, width):
    highest = lowest * width
    assume(np.ceil(rate / highest) <= np.floor(rate / lowest))
    strategy = SamplingStrategy(update_rate=rate, pace=Pace(kind="capped", lowest=lowest, highest=highest))
    actual = rate / strategy.samples_a_cycle(length)
    assert lowest * (1 - 1e-9) <= actual <= highest * (1 + 1e-9)


def test_by_turns_too_the_band_is_kept():
    """At 12 kHz the floor of 60 Hz is 200 samples; one more in several cycles would be below it."""
    strategy = SamplingStrategy(update_rate=12_000.0, pace=Pace(kind="capped", lowest=60.0, highest=200.0))
    ring = (circle(0.05, (0, -0.06, 0.2), 360), True)
    found, sampler = visits([ring, *loops(2e-4)], strategy, 12_000)
    assert found.min() > 0
    assert 60.0 <= sampler.count.draw_frequency(12_000.0) < 60.5


def test_a_band_without_a_whole_number_of_samples_is_refused():
    with pytest.raises(StrategyError, match=r"pace\.lowest\.\.highest, 60\.\.60 Hz.*update_rate 10000 Hz"):
        SamplingStrategy(pace=Pace(kind="capped", lowest=60.0, highest=60.0))
    SamplingStrategy(pace=Pace(kind="capped", lowest=100.0, highest=100.0))
