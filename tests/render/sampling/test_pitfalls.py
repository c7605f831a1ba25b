"""What goes wrong along a path and in time, one test each: pitfalls 11 to 19 and 24 of the notes on haptics."""

import itertools

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler, laid_cycles, sample_bounds, sample_contours
from palpate.render.sampling.strategy import Dwell, Gap, Order, Pace, SamplingStrategy

RING = (circle(0.03), True)
LEFT, RIGHT = (circle(0.02, centre=(-0.03, 0, 0.2)), True), (circle(0.02, centre=(0.03, 0, 0.2)), True)


def sampled(poses, rate=90.0, strategy=None, duration=None):
    sampler = Sampler(strategy or SamplingStrategy())
    time = np.arange(len(poses)) / rate
    end = len(poses) / rate if duration is None else duration
    blocks = list(sample_contours([batch_of(poses)], still(len(poses)), time, end, sampler))
    return np.concatenate([b.position for b in blocks]).astype(float), sampler.count


def test_11_a_new_pose_does_not_restart_the_path():
    poses = [[(circle(0.03, turn=2.4 * i), True)] for i in range(90)]  # the first vertex is anywhere
    position, count = sampled(poses)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert steps.max() < 2 * 7e-4
    assert sum(count.jumps.values()) == 0
    angle = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
    assert (np.diff(angle) > 0).all()
    assert angle[-1] - angle[0] == pytest.approx(7.0 / 0.03, rel=0.01)  # as one contour would be drawn
    restarted = np.array([np.linalg.norm(circle(0.03, turn=2.4 * i)[0] - position[111 * i - 1]) for i in range(1, 80)])
    assert np.median(restarted) > 0.02  # what restarting would have jumped


@pytest.mark.parametrize("continuity", ["nearest", "jump"])
def test_12_contours_that_split_are_entered_by_policy_and_the_jump_is_counted(continuity):
    both = [LEFT, RIGHT]
    position, count = sampled([[RING], both], rate=50.0, strategy=SamplingStrategy(continuity=continuity))
    before, after = position[:200], position[200:]
    ring = np.abs(np.linalg.norm(after[:, :2], axis=1) - 0.03) < 1e-4
    assert np.abs(np.linalg.norm(before[:, :2], axis=1) - 0.03).max() < 1e-4
    assert ring.mean() < 0.1
    if continuity == "jump":
        start = Sampler(SamplingStrategy()).draw(batch_of([both]), still(1)[0], 1).position[0]
        assert after[0] == pytest.approx(start, abs=1e-7)
    if continuity == "nearest":
        contours = np.concatenate([LEFT[0], RIGHT[0]])
        assert np.linalg.norm(after[0] - before[-1]) <= np.linalg.norm(contours - before[-1], axis=1).min() + 7e-4
    assert count.jumps["pose"] == int(np.linalg.norm(np.diff(position, axis=0), axis=1)[199:270].max() > 5e-3)


def test_12_a_loop_that_disappears_while_it_is_drawn_is_left_at_once():
    sampler = Sampler(SamplingStrategy(order=Order(route="given")))
    batch = batch_of([[RIGHT, LEFT], [LEFT]])
    sampler.draw(batch[:1], still(1)[0], 50)  # 50 of 180 samples into the right loop
    assert sampler.draw(batch[1:], still(1)[0], 100).position[:, 0].max() < 0
    assert sampler.count.jumps["pose"] == 1


def jumps_of(lines, route, **kwargs):
    sampler = Sampler(SamplingStrategy(order=Order(route=route), **kwargs))
    contours = batch_of([lines])
    cycle = sampler.strategy.samples_a_cycle(float(contours.length()[0]))
    sampler.draw(contours, still(1)[0], 2 * cycle + 1)
    return sampler.count


def test_13_contours_are_ordered_and_turned_so_that_jumps_are_short():
    lines = [([[-0.04, y, 0.2], [0.04, y, 0.2]], False) for y in (-0.03, 0.03, -0.01, 0.01)]
    given_, shortest = jumps_of(lines, "given"), jumps_of(lines, "shortest")
    assert given_.jump_length == pytest.approx(2 * 4 * np.hypot(0.08, 0.04), rel=0.2)
    assert shortest.jump_length == pytest.approx(2 * (3 * 0.02 + 0.06), rel=0.05)


def test_13_loops_are_left_and_entered_where_they_are_nearest():
    lines = [
        (circle(0.02, centre=(-0.03, 0, 0.2), turn=2.0), True),
        (circle(0.02, centre=(0.03, 0, 0.2), turn=1.0), True),
    ]
    assert jumps_of(lines, "shortest").jump_length < 4 * 0.0215
    assert jumps_of(lines, "given").jump_length > 4 * 0.03


@given(rate=st.sampled_from([90.0, 120.0, 59.94]), update=st.sampled_from([40_000.0, 10_000.0, 40_000 / 3]))
@settings(max_examples=9, deadline=None)
def test_14_samples_a_pose_add_up_without_drift(rate, update):
    time = np.arange(500) / rate
    bounds = sample_bounds(time, 500 / rate, update)
    counts = np.diff(bounds)
    assert set(counts) <= {int(update / rate), int(update / rate) + 1}
    assert np.abs(bounds[:-1] - time * update).max() < 1
    poses = [[RING]] * 40
    position, count = sampled(poses, rate=rate, strategy=SamplingStrategy(update_rate=update))
    assert len(position) == count.samples == int(np.ceil(40 / rate * update - 1e-6))


def test_15_actual_revisit_rate_is_reported_beside_the_nominal_one():
    still_ring = [[(circle(0.0426), True)]] * 90  # 0.267 m: 38 ms, over three poses
    _, count = sampled(still_ring)
    assert count.draw_frequency(10_000.0) == pytest.approx(7.0 / 0.267, rel=0.01)
    assert count.revisit_rate == pytest.approx(7.0 / 0.267, rel=0.01)
    _, count = sampled([[LEFT], [RIGHT]] * 45)
    assert count.draw_frequency(10_000.0) == pytest.approx(7.0 / (2 * np.pi * 0.02), rel=0.01)
    assert count.revisit_rate < 0.95 * count.draw_frequency(10_000.0)
    assert count.jumps["pose"] == 89


@pytest.mark.parametrize(("radius", "lowest", "highest"), [(0.0016, 600, 700), (0.1, 11, 11.2)])
def test_16_short_contours_explode_the_draw_frequency_unless_it_is_capped(radius, lowest, highest):
    lines = [[(circle(radius, count=180), True)]]
    _, count = sampled(lines, duration=1.0)
    assert lowest <= count.draw_frequency(10_000.0) <= highest
    _, capped = sampled(lines, strategy=SamplingStrategy(pace=Pace(kind="capped")), duration=1.0)
    assert 60.0 <= capped.draw_frequency(10_000.0) <= 200.0
    assert capped.revisit_rate is None or 60.0 <= capped.revisit_rate <= 200.0


@given(length=st.floats(0.02, 0.5))
@settings(max_examples=8, deadline=None)
def test_17_seam_is_a_step_like_any_other_and_corners_are_cut_by_half_a_step_at_most(length):
    side = length / 4
    position, count = sampled([[(square(side), True)]], duration=0.5)
    cycle = SamplingStrategy().samples_a_cycle(length)
    assert np.abs(position[cycle:] - position[:-cycle]).max(initial=0) < 1e-9
    step = length / cycle
    around = position[: cycle + 1]
    along = np.abs(np.diff(around, axis=0)).sum(axis=1)  # sides are parallel to the axes
    assert along == pytest.approx(np.full(cycle, step), rel=1e-3)
    for corner in square(side):
        assert np.linalg.norm(around - corner, axis=1).min() <= step / 2 + 1e-6
    assert count.jumps["polyline"] == 0


def test_18_poses_without_contour_have_no_draw_frequency_and_do_not_enter_its_mean():
    assert np.isnan(SamplingStrategy().draw_frequency(np.zeros(2))).all()
    _, with_gaps = sampled([[RING], [], [RING], []] * 10)
    _, without = sampled([[RING]] * 20)
    assert with_gaps.draw_frequency(10_000.0) == pytest.approx(without.draw_frequency(10_000.0))
    assert with_gaps.drawn == with_gaps.samples - with_gaps.silent
    position, nothing = sampled([[], []])
    assert np.isfinite(position).all()
    assert nothing.samples == nothing.silent == len(position)
    assert nothing.draw_frequency(10_000.0) is nothing.revisit_rate is None


@pytest.mark.parametrize("update_rate", [40_000.0, 10_000.0])
def test_19_points_a_cycle_do_not_depend_on_the_update_rate(update_rate):
    strategy = SamplingStrategy(update_rate=update_rate, pace=Pace(kind="frequency", frequency=20.0, points=40))
    position, _ = sampled([[RING]], strategy=strategy, duration=0.1)
    assert len(np.unique(np.round(position, 7), axis=0)) == 40
    assert len(position) == update_rate / 10


def test_19_held_points_move_on_though_poses_come_faster_than_points():
    strategy = SamplingStrategy(pace=Pace(kind="frequency", frequency=5.0, points=8))  # 25 ms a point, 11 ms a pose
    position, _ = sampled([[RING]] * 90, strategy=strategy)
    assert len(np.unique(np.round(position, 6), axis=0)) == 8


@pytest.mark.parametrize("kind", ["step", "random"])
def test_19_no_point_is_left_out_of_another_order_by_new_poses(kind):
    strategy = SamplingStrategy(pace=Pace(kind="frequency", frequency=20.0, points=40), order=Order(kind=kind, step=7))
    still_one, _ = sampled([[RING]], strategy=strategy, duration=0.5)
    many, _ = sampled([[RING]] * 45, strategy=strategy)
    assert many == pytest.approx(still_one, abs=1e-7)


@pytest.mark.parametrize("gap", ["jump", "return"])
def test_24_seam_of_a_stored_cycle_is_no_jump_of_its_own(gap):
    lines = [([[-0.04, y, 0.2], [0.04, y, 0.2]], False) for y in (0.0, 0.03)]
    sampler = Sampler(SamplingStrategy(gap=Gap(kind=gap)))
    cycle = sampler.cycle(batch_of([lines]))
    steps = np.linalg.norm(np.diff(np.vstack([cycle.position, cycle.position[:1]]), axis=0), axis=1)
    assert np.count_nonzero(steps > 5e-3) == (2 if gap == "jump" else 0)


def moving_square(count, shift=1e-3):
    """Poses of a square that wanders and turns a little, its first vertex anywhere."""
    turns = 0.02 * np.arange(count)
    centres = shift * np.stack([np.cos(turns), np.sin(turns)], axis=1) * 10
    for i, (turn, (x, y)) in enumerate(zip(turns, centres, strict=True)):
        ring = circle(0.03, centre=(x, y, 0.2), count=4, turn=0.1 * turn)
        yield [(np.roll(ring, i % 4 if i % 30 == 0 else 0, axis=0), True)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["dtp", "stp"])
def test_slow_strategies_get_around_though_a_cycle_lasts_many_poses(name):
    poses = list(moving_square(360))
    position, count = sampled(poses, strategy=preset(name))
    centre = np.repeat(
        np.array([np.mean(p[0][0], axis=0) for p in poses]),
        np.diff(sample_bounds(np.arange(360) / 90, 4.0, 1e4)),
        axis=0,
    )
    off = position - centre
    angle = np.unwrap(np.arctan2(off[:, 1], off[:, 0]))
    assert (angle[-1] - angle[0]) / (2 * np.pi) == pytest.approx(2.0, abs=0.3)  # 4 s at 0.5 Hz
    assert sum(count.jumps.values()) == 0
    quarter = np.round((angle - 0.1) / (np.pi / 2)).astype(int)
    near = np.linalg.norm(off, axis=1) > (0.0295 if name == "dtp" else 0.024)
    assert near.mean() == pytest.approx(0.8, abs=0.12)  # of the time at corners
    runs = [len(list(group)) for _, group in itertools.groupby(quarter[near])]
    assert len(runs) >= 8


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("line", [[[0, 0, 0.2], [0.07, 0, 0.2]], [[0, 0, 0.2], [0.05, 0, 0.2], [0.05, 0.02, 0.2]]])
def test_pause_is_neither_cut_short_nor_begun_again_by_new_poses(line):
    strategy = SamplingStrategy(dwell=Dwell(time=0.05), gap=Gap(kind="pendulum"))
    still_one, _ = sampled([[(line, False)]], strategy=strategy, duration=1.0)
    many, _ = sampled([[(line, False)]] * 90, strategy=strategy, duration=1.0)
    assert np.abs(many - still_one).max() < 2e-5


@pytest.mark.parametrize(("samples", "shift", "rests"), [(830, -2e-3, True), (830, 2e-3, True), (1355, 2e-3, False)])
def test_corner_that_moves_over_the_focal_point_is_paused_at_once_and_only_once(samples, shift, rests):
    # 0.5 m/s along 40 mm, 50 ms at a bend of 40 degrees, then on: before it at sample 830, behind it at 1355
    bend = np.array([[0, 0, 0.2], [0.042, 0, 0.2], [0.08, 0.032, 0.2]])
    strategy = SamplingStrategy(speed=0.5, dwell=Dwell(time=0.05), gap=Gap(kind="pendulum"))
    sampler = Sampler(strategy)
    batch = batch_of([[(bend, False)], [(bend + np.array([shift, 0, 0]), False)]])
    before = sampler.draw(batch[:1], still(1)[0], samples).position
    assert np.linalg.norm(before[-1] - bend[1]) < 1.5e-3
    after = sampler.draw(batch[1:], still(1)[0], 700).position
    rested = np.count_nonzero(np.linalg.norm(np.diff(after, axis=0), axis=1) == 0)
    assert rested == pytest.approx(500 if rests else 0, abs=2)


@pytest.mark.parametrize(("x", "rests"), [(0.036, True), (0.03, False), (0.0, False)])
def test_rest_at_a_corner_that_is_gone_ends_unless_another_is_hardly_farther_than_the_contour(x, rests):
    """Half of a pause of 500 samples is over at the end of a line, when another line, 1 mm beside, takes its place."""
    lines = [[([[-0.04, y, 0.2], [end, y, 0.2]], False)] for y, end in ((1e-3, x), (0.0, 0.04))]
    sampler = Sampler(SamplingStrategy(dwell=Dwell(time=0.05), gap=Gap(kind="pendulum")))
    sampler.draw(batch_of(lines[:1]), still(1)[0], round((x + 0.04) / 7e-4) + 250)
    after = sampler.draw(batch_of(lines[1:]), still(1)[0], 300).position.astype(float)
    moves = np.flatnonzero(np.linalg.norm(np.diff(after, axis=0), axis=1))
    assert moves[0] == pytest.approx(250 if rests else 0, abs=2)  # for what is left
    assert after[0] == pytest.approx([0.04 if rests else x, 0, 0.2], abs=1e-6 if rests else 8e-4)


def test_sections_take_the_cycle_and_no_more():
    cycle = laid_cycles(batch_of([[RING, LEFT]]), preset("stp"))[0]
    assert cycle["period"] == pytest.approx(2.0, rel=1e-12)
