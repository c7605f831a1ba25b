"""Focal points: constant speed, no drift, no restart at a new pose, jumps counted, silence where there is nothing."""

from dataclasses import replace

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling_oracle import drawn_slowly

from palpate.render.errors import PoseError
from palpate.render.sampling.sampler import Sampler, sample_contours
from palpate.render.sampling.strategy import Order, SamplingStrategy

GIVEN = Order(route="given")


def sampled(poses, time, duration, *, strategy=None, hand=None):
    sampler = Sampler(strategy or SamplingStrategy())
    hand = still(len(poses)) if hand is None else hand
    blocks = list(sample_contours([batch_of(poses)], hand, np.asarray(time, float), duration, sampler))
    return (
        np.concatenate([b.position for b in blocks]).astype(float),
        np.concatenate([b.intensity for b in blocks]),
        sampler.count,
    )


def steps_of(position):
    return np.linalg.norm(np.diff(position, axis=0), axis=1)


@pytest.mark.exhaustive
@given(
    radius=st.floats(0.01, 0.06),
    corners=st.integers(3, 20),
    shifts=st.lists(
        st.tuples(st.floats(-3e-3, 3e-3), st.floats(-3e-3, 3e-3), st.floats(-0.5, 0.5)), min_size=1, max_size=5
    ),
    speed=st.floats(2.0, 20.0),
    seed=st.integers(0, 99),
)
@settings(deadline=None, max_examples=40)
def test_default_strategy_draws_what_the_slow_way_draws(radius, corners, shifts, speed, seed):
    random = np.random.default_rng(seed)
    strategy = SamplingStrategy(speed=speed)
    poses = [circle(radius, centre=(x, y, 0.2), count=corners, turn=turn) for x, y, turn in shifts]
    counts = random.integers(5, 60, len(poses)).tolist()
    sampler = Sampler(strategy)
    drawn = [
        sampler.draw(batch_of([[(ring, True)]]), still(1)[0], count) for ring, count in zip(poses, counts, strict=True)
    ]
    slow = drawn_slowly(poses, counts, speed, strategy.update_rate, strategy.jump_threshold)
    assert np.concatenate([d.position for d in drawn]) == pytest.approx(slow, abs=2e-7)


def test_number_of_samples_a_cycle_is_rounded_up_and_needs_no_partial_step():
    strategy = SamplingStrategy()
    assert strategy.samples_a_cycle(0.28) == 400
    assert strategy.samples_a_cycle(0.2801) == 401
    ring = circle(0.0445727, count=1000)  # 400.09 steps around
    position, _, _ = sampled([[(ring, True)]], [0.0], 2.0)
    assert steps_of(position) == pytest.approx(np.full(len(position) - 1, 7e-4 * 400.09 / 401), rel=1e-3)
    assert np.abs(position[401:] - position[:-401]).max() == 0  # every cycle the same


def test_irregular_poses_are_drawn_from_when_they_come():
    time = np.array([0.0, 0.0101, 0.0102, 0.05])
    near, far = (circle(0.02), True), (circle(0.02, centre=(0.1, 0, 0.2)), True)
    position, _, _ = sampled([[near], [far], [near], [far]], time, 0.08)
    expected = np.searchsorted(time, np.arange(800) / 10_000.0 + 1e-9, side="right") - 1
    assert ((position[:, 0] > 0.05) == (expected % 2 == 1)).all()


def test_thin_contour_is_not_turned_around_by_its_other_side():
    strip = np.array([[-0.05, 0, 0.2], [0.05, 0, 0.2], [0.05, 0.002, 0.2], [-0.05, 0.002, 0.2]])
    poses = [[(strip + np.array([0, 0.0015 * (i % 2), 0]), True)] for i in range(40)]
    position, _, count = sampled(poses, np.arange(40) / 90.0, 40 / 90.0)
    direction = np.sign(np.diff(position[:, 0]))
    turns = np.count_nonzero(np.diff(direction[direction != 0]))
    cycles = 7.0 * 40 / 90.0 / 0.204
    assert turns <= 2 * cycles + 1
    assert sum(count.jumps.values()) == 0


def test_long_static_pose_is_drawn_in_order_even_where_contours_coincide():
    ring = circle(0.03, count=90)
    sampler = Sampler(SamplingStrategy(order=GIVEN))
    batch = batch_of([[(ring, True), (ring[::-1], True)]])  # the second lies on the first, the other way round
    blocks = list(sample_contours([batch], still(1), np.zeros(1), 10.0, sampler))
    assert len(blocks) > 3  # a long pose comes in several blocks
    position = np.concatenate([b.position for b in blocks])
    angle = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
    length = 90 * np.linalg.norm(ring[1] - ring[0])
    step = 2 * length / np.ceil(2 * length / 7e-4)
    lap = np.floor(step * np.arange(1, len(angle)) / length + 1e-9).astype(int)
    assert ((np.diff(angle) > 0) == (lap % 2 == 0)).mean() > 0.99  # all but the steps across the start
    assert sampler.count.jumps["pose"] == 0


def test_vanished_contour_is_silent_and_does_not_play_the_last_path():
    ring = [(circle(0.03), True)]
    position, intensity, count = sampled([ring, [], ring], [0.0, 0.1, 0.2], 0.3)
    assert (intensity[:1000] == 1).all()
    assert (intensity[1000:2000] == 0).all()
    assert (intensity[2000:] == 1).all()
    assert np.ptp(position[1000:2000], axis=0).max() == 0
    assert count.silent == 1000
    assert count.jumps["re-entry"] == 0  # it re-enters where it left


def test_after_a_silence_drawing_begins_at_the_nearest_point_itself():
    near, beside = [(square(0.04), True)], [(square(0.04, centre=(0.001, 0, 0.2)), True)]
    position, _, _ = sampled([near, [], beside], [0.0, 0.1, 0.2], 0.3)
    left, back = position[1999], position[2000]
    assert np.linalg.norm(back - left) <= 1e-3 + 1e-7
    along = np.abs(np.abs(back[:2] - [0.001, 0.0]).max() - 0.02)
    assert along < 1e-7
    assert back - left == pytest.approx(np.array([0.001, 0, 0]) * (abs(abs(left[0]) - 0.02) < 1e-7), abs=1e-7)


def test_missing_poses_are_held_and_then_faded_while_the_focal_point_moves_on():
    ring = [(circle(0.03, count=720), True)]
    time = [0.0, 0.01, 0.02, 0.3, 0.31]
    position, intensity, count = sampled([ring] * 5, time, 0.32)
    assert (intensity[:1201] == 1).all()
    assert (np.diff(intensity[1200:1400]) < 0).all()
    assert (intensity[1401:3000] == 0).all()
    assert (intensity[3000:] == 1).all()
    assert steps_of(position[:3000]).max() < 7.1e-4
    assert count.held == 1799


def test_pose_that_is_missing_for_long_stays_faded():
    ring = [(circle(0.03), True)]
    _, intensity, count = sampled([ring] * 4, [0.0, 0.01, 0.02, 4.0], 4.01)
    assert not intensity[1401:40_000].any()  # longer than any block
    assert intensity[40_000:].all()
    assert count.held == 40_000 - 1201


def test_intensity_is_linear_along_segments():
    batch = replace(batch_of([[([[0, 0, 0.2], [0.07, 0, 0.2]], False)]]), intensity=np.array([0.0, 1.0], np.float32))
    point, intensity = Sampler(SamplingStrategy()).draw(batch, still(1)[0], 100)
    assert intensity == pytest.approx(point[:, 0] / 0.07, abs=1e-6)


@pytest.mark.exhaustive
@given(
    radius=st.floats(0.005, 0.1),
    speed=st.floats(1.0, 20.0),
    divider=st.integers(1, 40),
    cuts=st.lists(st.floats(0.001, 0.4), min_size=0, max_size=6, unique=True),
)
def test_how_poses_are_cut_up_does_not_change_what_is_drawn(radius, speed, divider, cuts):
    strategy = SamplingStrategy(speed=speed, update_rate=40_000 / divider, hold=10)
    ring = [(circle(radius, count=48), True)]
    whole, _, _ = sampled([ring], [0.0], 0.5, strategy=strategy)
    time = np.array([0.0, *sorted(cuts)])
    cut, _, count = sampled([ring] * len(time), time, 0.5, strategy=strategy)
    assert np.abs(whole - cut).max() < 1e-6 + 1e-6 * len(time)
    assert sum(count.jumps.values()) == (0 if strategy.step < 2.4e-3 else sum(count.jumps.values()))


@pytest.mark.parametrize(("speed", "step", "jumps"), [(100.0, 19.9, 0), (100.0, 20.1, 1), (7.0, 4.9, 0), (7.0, 5.1, 1)])
def test_jump_is_a_step_longer_than_two_steps_and_five_millimetres(speed, step, jumps):
    strategy = SamplingStrategy(speed=speed)  # 10 mm a step at 100 m/s
    reach, gap = 20 * strategy.step, 1e-3 * step - strategy.step
    pieces = [([[0, 0, 0.2], [reach, 0, 0.2]], False), ([[reach + gap, 0, 0.2], [2 * reach + gap, 0, 0.2]], False)]
    sampler = Sampler(strategy)
    sampler.draw(batch_of([pieces]), still(1)[0], 30)  # over the gap, but not back from the end
    assert sampler.count.jumps["polyline"] == jumps


def test_hold_is_twice_the_median_interval_of_slow_poses():
    ring = [(circle(0.03), True)]
    time = [0.0, 0.2, 0.4, 0.6, 1.2, 1.4]
    _, intensity, _ = sampled([ring] * 6, time, 1.6)
    assert intensity[:10_000].min() == 1  # 0.6 + 2 x 0.2
    assert intensity[10_205:12_000].max() == 0


@pytest.mark.parametrize(
    ("given", "message"), [(1, "contours of 1 poses, fewer than the 2"), (3, "contours of more than 2 poses")]
)
def test_contours_of_fewer_or_more_poses_than_times_are_refused(given, message):
    batches = [batch_of([[(square(0.05), True)]])] * given
    with pytest.raises(PoseError, match=message):
        list(sample_contours(batches, still(2), np.array([0.0, 0.01]), 0.02, Sampler("stm")))
