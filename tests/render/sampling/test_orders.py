"""Orders, gaps, pauses, sections and overlays, each against the slow way to draw it or what it must keep."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling_oracle import sampled_slowly

from palpate.render.errors import StrategyError
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler
from palpate.render.sampling.strategy import (
    AmplitudeModulation,
    Dwell,
    Gap,
    LateralModulation,
    Order,
    Pace,
    SamplingStrategy,
    Sections,
)

L_SHAPE = ([[0, 0, 0.2], [0.05, 0, 0.2], [0.05, 0.03, 0.2]], False)
LINE = ([[-0.03, -0.02, 0.2], [-0.03, 0.02, 0.21]], False)
SQUARE = (square(0.04), True)


def drawn(lines, strategy, count):
    sampler = Sampler(strategy)
    focus = sampler.draw(batch_of([lines]), still(1)[0], count)
    return focus.position.astype(float), focus.intensity, sampler.count


def steps_of(position):
    return np.linalg.norm(np.diff(position, axis=0), axis=-1)


def distance_to(position, lines):
    """From each point to the nearest of the polylines."""
    ends = [(np.asarray(p, float), c) for p, c in lines]
    parts = [(p[i], p[(i + 1) % len(p)]) for p, c in ends for i in range(len(p) if c else len(p) - 1)]
    out = np.full(len(position), np.inf)
    for a, b in parts:
        t = np.clip((position - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        out = np.minimum(out, np.linalg.norm(position - a - t[:, None] * (b - a), axis=1))
    return out


@pytest.mark.exhaustive(after=12)
@pytest.mark.parametrize("dwell", [Dwell(), Dwell(time=2e-3), Dwell(share=0.6)])
@pytest.mark.parametrize("gap", ["jump", "return", "pendulum", "close"])
@pytest.mark.parametrize(
    ("order", "points"),
    [("loop", None), ("loop", 37), ("pendulum", None), ("pendulum", 24), ("step", 35), ("random", 60)],
)
def test_every_order_and_gap_is_what_the_slow_way_draws(order, gap, points, dwell):
    strategy = SamplingStrategy(
        pace=Pace(points=points),
        order=Order(kind=order, step=3, seed=5, route="given"),
        gap=Gap(kind=gap),
        dwell=dwell,
    )
    lines = [L_SHAPE, SQUARE, LINE]
    position, intensity, _ = drawn(lines, strategy, 1200)
    slow = sampled_slowly(lines, strategy, 1200)
    away = np.linalg.norm(position - slow, axis=1)
    # On a seam or a jump itself the last bit decides for the point before or behind it.
    assert np.count_nonzero(away > 1e-6) <= 3
    assert set(intensity) == {1.0}


lines_drawn = st.lists(
    st.tuples(st.lists(st.tuples(*[st.integers(-40, 40)] * 3), min_size=2, max_size=5, unique=True), st.booleans()),
    min_size=1,
    max_size=4,
).map(lambda lines: [(np.array(points) * 1e-3 + [0, 0, 0.2], closed and len(points) > 2) for points, closed in lines])


@pytest.mark.exhaustive
@given(
    lines=lines_drawn,
    gap=st.sampled_from(["jump", "pendulum"]),
    order=st.sampled_from(["loop", "pendulum"]),
    route=st.sampled_from(["given", "shortest"]),
    share=st.sampled_from([0.0, 0.5]),
    pace=st.sampled_from(["speed", "frequency", "capped"]),
)
@settings(max_examples=40, deadline=None)
def test_every_sample_lies_on_a_contour_and_no_step_along_it_is_longer_than_the_pace_allows(
    lines, gap, order, route, share, pace
):
    strategy = SamplingStrategy(
        pace=Pace(kind=pace, frequency=30.0),
        order=Order(kind=order, route=route),
        gap=Gap(kind=gap),
        dwell=Dwell(share=share),
    )
    contours = batch_of([lines])
    position, _, count = drawn(lines, strategy, 3000)
    assert distance_to(position, lines).max() < 2e-7
    way = contours.length()[0] * (2 if order == "pendulum" else 1)
    back = sum(np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p, c in lines if not c)
    way += back * (2 if order == "pendulum" else 1) if gap == "pendulum" else 0.0
    samples = 3000 / count.cycles
    longest = way / (1 - share) / samples
    jumps = (steps_of(position) > longest * (1 + 1e-3) + 1e-6).sum()
    ends = len(lines) * (2 if order == "pendulum" else 1)
    assert jumps <= ends * (count.cycles + 1)


@pytest.mark.exhaustive
@given(lines=lines_drawn, share=st.floats(0.05, 0.9))
@settings(max_examples=30, deadline=None)
def test_pauses_take_their_share_of_the_cycle(lines, share):
    strategy = SamplingStrategy(pace=Pace(kind="frequency", frequency=1.0), dwell=Dwell(share=share, angle=3.0))
    contours = batch_of([lines])
    position, _, _ = drawn(lines, strategy, 10_000)
    resting = np.count_nonzero(steps_of(position) == 0) / 10_000
    opens = any(not closed for _, closed in lines)
    turned = resting > 0.01  # a closed line may have a corner of over 3 rad
    assert resting == pytest.approx(share if opens or turned else 0.0, abs=0.01 + 2 * len(contours.points) / 10_000)


@pytest.mark.parametrize("kind", ["step", "random"])
def test_other_orders_show_every_point_once_a_cycle(kind):
    strategy = SamplingStrategy(pace=Pace(kind="frequency", frequency=100.0, points=25), order=Order(kind=kind, step=7))
    position, _, _ = drawn([SQUARE], strategy, 100)
    places, times = np.unique(np.round(position, 6), axis=0, return_counts=True)
    assert len(places) == 25
    assert set(times) == {4}


def test_more_points_than_updates_leave_none_out():
    strategy = SamplingStrategy(pace=Pace(points=300), order=Order(kind="step", step=7))
    position, _, count = drawn([SQUARE], strategy, 300)
    assert len(np.unique(np.round(position, 7), axis=0)) == 300
    assert count.cycles == 1.0


def test_sections_are_drawn_one_after_the_other_without_a_jump():
    strategy = preset("stp", sections=Sections(count=16, speed=2.0), dwell=Dwell(share=0.8))
    position, _, count = drawn([SQUARE], strategy, 20_000)
    assert sum(count.jumps.values()) == 0
    assert distance_to(position, [SQUARE]).max() < 1e-7
    x, y = position[:, 0], position[:, 1]
    around = np.choose(
        np.argmax([-y, x, y, -x], axis=0), [0.02 + x, 0.06 + y, 0.1 - x, 0.14 - y]
    )  # arc length along the square, 0.16 m
    section = np.minimum(np.floor(around / 0.01).astype(int), 15)
    share = np.bincount(section, minlength=16) / len(section)
    near_corner = np.isin(np.arange(16), [0, 3, 4, 7, 8, 11, 12, 15])
    assert share[near_corner].sum() == pytest.approx(0.8, abs=0.03)  # turns are samples on a cut
    assert share[near_corner] == pytest.approx(np.full(8, 0.1), abs=0.006)
    assert share[~near_corner] == pytest.approx(np.full(8, 0.025), abs=0.006)
    assert np.median(steps_of(position)) * 10_000 == pytest.approx(2.0, rel=0.1)
    in_turn = section[np.flatnonzero(np.diff(section, prepend=-1))]
    assert np.unique(in_turn[:4]).size <= 4  # the first sections before the last ones
    assert (np.maximum.accumulate(section) - section).max() <= 1


def test_sections_stay_apart_where_a_gap_is_a_cut():
    lines = [([[0, 0, 0.2], [0.04, 0, 0.2]], False), ([[0, 0.03, 0.2], [0.04, 0.03, 0.2]], False)]
    strategy = preset("stp", sections=Sections(count=4), order=Order(route="given"))
    position, _, count = drawn(lines, strategy, 20_000)
    assert distance_to(position, lines).max() < 1e-7
    assert count.jumps["polyline"] == 1


@pytest.mark.parametrize("wave", ["sine", "square"])
def test_amplitude_is_modulated_between_its_depth_and_one(wave):
    strategy = SamplingStrategy(am=AmplitudeModulation(frequency=200.0, depth=0.75, wave=wave))
    _, intensity, count = drawn([SQUARE], strategy, 1000)
    assert intensity.min() == pytest.approx(0.25)
    assert intensity.max() == pytest.approx(1.0)
    assert intensity[0] == intensity.min()
    assert intensity[:950] == pytest.approx(intensity[50:], abs=1e-6)
    spectrum = np.abs(np.fft.rfft(intensity - intensity.mean()))
    assert int(np.argmax(spectrum)) == 20
    assert count.silent == 0


def test_modulation_goes_on_through_silence_and_new_poses():
    strategy = SamplingStrategy(am=AmplitudeModulation())
    sampler = Sampler(strategy)
    batch = batch_of([[SQUARE], [], [SQUARE]])
    parts = [sampler.draw(batch[i : i + 1], still(1)[0], 333).intensity for i in range(3)]
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * 200.0 * np.arange(999) / 10_000)
    assert parts[0] == pytest.approx(wave[:333], abs=1e-6)
    assert not parts[1].any()
    assert parts[2] == pytest.approx(wave[666:], abs=1e-6)
    assert sampler.count.silent == 333


@given(turn=st.floats(-3.0, 3.0))
@settings(max_examples=20, deadline=None)
def test_small_circles_lie_in_the_plane_of_the_palm(turn):
    strategy = SamplingStrategy(pace=Pace(kind="still"), lm=LateralModulation(radius=0.004, frequency=100.0))
    half = turn / 2
    pose = np.array([0, 0, 0.2, 0, np.sin(half), 0, np.cos(half)])  # about the array's y
    focus = Sampler(strategy).draw(batch_of([[SQUARE]]), pose, 100)
    off = focus.position - np.float32(square(0.04)[0])
    normal = np.array([0.0, 1.0, 0.0])  # of the palm, which this turn leaves alone
    assert np.linalg.norm(off, axis=1) == pytest.approx(np.full(100, 0.004), abs=1e-7)
    assert np.abs(off @ normal).max() < 1e-7
    angle = np.unwrap(
        np.arctan2(
            -(off[:, 0] * np.sin(turn) + off[:, 2] * np.cos(turn)), off[:, 0] * np.cos(turn) - off[:, 2] * np.sin(turn)
        )
    )
    assert np.diff(angle) == pytest.approx(np.full(99, 2 * np.pi / 100), abs=1e-4)


def test_several_foci_are_equally_spaced_on_the_loop():
    strategy = SamplingStrategy(foci=4)
    ring = circle(0.03, count=360)
    position, intensity, count = drawn([(ring, True)], strategy, 2000)
    assert position.shape == (2000, 4, 3)
    assert intensity.shape == (2000, 4)
    assert np.linalg.norm(position[..., :2].sum(axis=1), axis=1).max() < 1e-4
    one, _, alone = drawn([(ring, True)], SamplingStrategy(), 2000)
    assert position[:, 0] == pytest.approx(one, abs=1e-7)
    assert count.revisit_rate == pytest.approx(4 * alone.revisit_rate, rel=0.02)
    assert sum(count.jumps.values()) == 0


def test_still_points_stay_where_they_are():
    position, intensity, _ = drawn([SQUARE], preset("am-multi-focus", foci=8), 500)
    assert np.ptp(position, axis=0).max() == 0
    assert intensity[0].max() == 0
    assert intensity[25].min() == 1
    assert len(np.unique(np.round(position[0], 6), axis=0)) == 8


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "name",
    [
        "stm",
        "constant-frequency",
        "capped",
        "pendulum",
        "fast-return",
        "dtp",
        "stp",
        "am",
        "lm",
        "pressure",
        "multi-focus",
        "am-multi-focus",
        "step",
        "random",
    ],
)
def test_cycle_repeated_is_the_pose_that_stays(name):
    sampler = Sampler(preset(name))
    contours = batch_of([[SQUARE, L_SHAPE]])
    cycle = sampler.cycle(contours, still(1)[0], limit=20_000)
    assert sampler.count.samples == 0
    period = len(cycle.intensity)
    parts = [sampler.draw(contours, still(1)[0], count) for count in (3, period, 2 * period + 7)]
    long = np.concatenate([p.position for p in parts]), np.concatenate([p.intensity for p in parts])
    assert np.abs(long[0] - np.resize(cycle.position, long[0].shape)).max() < 1e-6
    assert np.abs(long[1] - np.resize(cycle.intensity, long[1].shape)).max() < 1e-6


def test_cycle_that_is_too_long_is_none():
    contours = batch_of([[SQUARE]])
    assert Sampler(SamplingStrategy()).cycle(contours, limit=229) is not None
    assert Sampler(SamplingStrategy()).cycle(contours, limit=228) is None
    odd = AmplitudeModulation(frequency=float(np.sqrt(2) * 100))
    assert Sampler(SamplingStrategy(am=odd)).cycle(contours) is None
    both = Sampler(SamplingStrategy(am=AmplitudeModulation(frequency=200.0))).cycle(contours)
    assert len(both.intensity) == 229 * 50
    slow, longest = (Pace(kind="frequency", frequency=10_000.0 / count) for count in (16_385, 16_384))
    assert Sampler(SamplingStrategy(pace=slow)).cycle(contours) is None  # it is made as it is played
    assert len(Sampler(SamplingStrategy(pace=longest)).cycle(contours).intensity) == 16_384


def test_a_pose_may_be_any_sequence_of_seven_numbers():
    here, there = (Sampler("lm").draw(batch_of([[SQUARE]]), pose, 50) for pose in (still(1)[0], still(1)[0].tolist()))
    assert (here.position == there.position).all()


def test_contours_of_several_poses_are_refused():
    two = batch_of([[SQUARE], [L_SHAPE]])
    for draw in (lambda: Sampler("stm").draw(two, still(1)[0], 10), lambda: Sampler("stm").cycle(two)):
        with pytest.raises(StrategyError, match="of one pose, not 2"):
            draw()
