"""Pauses that contours have of their own: each made once a passage, wherever a cycle begins."""

from dataclasses import replace

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still

from palpate.render import ContourBatch, Sampler, SamplingStrategy
from palpate.render.errors import StrategyError
from palpate.render.sampling.sampler import lay_each, sample_motions
from palpate.render.sampling.strategy import Dwell, Gap, Order, Pace

SIDE = 0.04
STRATEGY = SamplingStrategy()


def paused(poses, rests):
    """A batch with pauses [s] at points by number; a loop's first stands for its last too."""
    batch = batch_of(poses)
    dwell = np.zeros(batch.point_count, np.float32)
    for point, time in rests.items():
        dwell[point] = time
    for a, b, closed in zip(batch.polyline_start[:-1], batch.polyline_start[1:], batch.polyline_closed, strict=True):
        if closed:
            dwell[b - 1] = dwell[a]
    return replace(batch, dwell=dwell)


def rest_of(batch, strategy=STRATEGY):
    """Time of a cycle that the focal point rests at each vertex [s], and the cycle's length [s]."""
    room = lay_each(batch, strategy)
    cycle = room.cycles.numpy()[0]
    parameter, point = (nodes.numpy()[: cycle["count"]] for nodes in room.nodes)
    spent = np.where((np.diff(point, axis=0) == 0).all(axis=1), np.diff(parameter), 0.0)
    points = batch.points.astype(np.float64)
    near = [np.linalg.norm(point[:-1] - p, axis=1) < 1e-9 for p in points]
    return np.array([spent[there].sum() for there in near]), cycle["period"]


@pytest.mark.parametrize("point", [0, 2])
def test_a_loop_rests_at_its_vertex_once_a_cycle_also_at_its_seam(point):
    batch = paused([[(square(SIDE), True)]], {point: 0.01})
    rest, seconds = rest_of(batch)
    assert rest[point] == pytest.approx(0.01)
    assert np.count_nonzero(rest) == (2 if point == 0 else 1)  # the seam is listed twice
    assert seconds == pytest.approx(4 * SIDE / 7.0 + 0.01)


@pytest.mark.parametrize(
    ("strategy", "visits"),
    [
        (SamplingStrategy(), 1),
        (SamplingStrategy(gap=Gap(kind="return")), 1),
        (SamplingStrategy(gap=Gap(kind="close")), 1),
        (SamplingStrategy(gap=Gap(kind="pendulum")), 2),
        (SamplingStrategy(order=Order(kind="pendulum")), 2),
    ],
)
def test_an_open_contour_rests_at_its_ends_once_and_between_at_each_passage(strategy, visits):
    batch = paused([[(square(SIDE)[:3], False)]], {0: 0.01, 1: 0.02, 2: 0.03})
    rest, seconds = rest_of(batch, strategy)
    assert rest == pytest.approx([0.01, visits * 0.02, 0.03])
    assert seconds > rest.sum()


def test_the_order_of_several_contours_leaves_out_no_pause_and_adds_none(rng):
    for _ in range(20):
        lines = [(circle(0.006, rng.uniform(-0.03, 0.03, 3), 12), True) for _ in range(3)]
        lines += [(rng.uniform(-0.03, 0.03, (4, 3)), False) for _ in range(2)]
        rests = {int(k): 0.01 * (i + 1) for i, k in enumerate(rng.choice([0, 5, 13, 20, 26, 37, 39, 42, 46], 4, False))}
        batch = paused([lines], rests)
        rest, _ = rest_of(batch)
        for point, time in rests.items():
            assert rest[point] == pytest.approx(time)
        seams = [p for p in (0, 13, 26) if p in rests]
        assert np.count_nonzero(rest) == len(rests) + len(seams)


def test_pauses_add_to_those_of_the_strategy_and_zero_is_none():
    corners = SamplingStrategy(dwell=Dwell(time=0.005))
    rest, _ = rest_of(paused([[(square(SIDE), True)]], {1: 0.01}), corners)
    assert rest[:4] == pytest.approx([0.005, 0.015, 0.005, 0.005])
    none = paused([[(square(SIDE), True)]], {})
    rest, seconds = rest_of(none)
    assert not rest.any()
    assert seconds == pytest.approx(4 * SIDE / 7.0)


def test_focal_points_stand_still_for_the_pause_and_go_on_pose_after_pose():
    batch = paused([[(square(SIDE), True)]] * 8, {5 * k + 1: 0.02 for k in range(8)})
    sampler = Sampler(STRATEGY)
    shown = [sampler.draw(batch[k : k + 1], pose, 111) for k, pose in enumerate(still(8))]
    position = np.concatenate([focus.position for focus in shown])
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    still_at = np.flatnonzero(step == 0)
    runs = np.split(still_at, np.flatnonzero(np.diff(still_at) > 1) + 1)
    corner = square(SIDE)[1].astype(np.float32)
    cycle = np.ceil((4 * SIDE / 7.0 + 0.02) * 1e4)
    assert [abs(len(run) - 200) <= 2 for run in runs] == [True] * len(runs)
    assert len(runs) == 2
    assert np.allclose(position[still_at], corner)
    assert abs((runs[1][0] - runs[0][0]) - cycle) <= 1
    assert step.max() < 1e-3


def test_a_constant_frequency_scales_pauses_with_the_rest():
    pace = SamplingStrategy(pace=Pace(kind="frequency", frequency=20.0))
    batch = paused([[(square(SIDE), True)]], {1: 0.02})
    position = Sampler(pace).draw(batch[:1], still(1)[0], 500).position
    rests = np.count_nonzero(np.linalg.norm(np.diff(position, axis=0), axis=1) == 0)
    assert rests == pytest.approx(500 * 0.02 / (0.02 + 4 * SIDE / 7.0), abs=3)


def test_batches_keep_their_pauses_when_cut_and_joined():
    batch = paused([[(square(SIDE), True)]] * 2, {1: 0.02, 7: 0.03})
    assert batch.select(1, 2).dwell.tolist() == pytest.approx([0, 0, 0.03, 0, 0])
    assert ContourBatch.from_arrays(batch.arrays()).dwell is not None
    assert (batch.to("cpu").numpy().dwell == batch.dwell).all()


@pytest.mark.parametrize("name", ["intensity", "dwell"])
def test_a_seam_that_says_two_things_is_refused_and_one_that_agrees_is_kept(name):
    """A loop begun elsewhere passes its seam once: of two values there one would be lost."""
    batch = batch_of([[(square(SIDE), True), (square(SIDE)[:3], False)], [(square(SIDE), True)]])
    value = np.linspace(0.1, 0.9, batch.point_count).astype(np.float32)
    value[[4, 12]] = value[[0, 8]]
    agreeing = replace(batch, **{name: value})
    assert len(Sampler(STRATEGY).draw(agreeing[:1], still(1)[0], 5).position) == 5  # the open one may end as it likes
    value = value.copy()
    value[12] += 0.01
    with pytest.raises(StrategyError, match=rf"polyline 2 is closed, so {name} at its last point must be .* 0\.6333"):
        sample_motions(replace(batch, **{name: value}), still(2), np.zeros(2), [0, 1, 2], [0.1] * 2, STRATEGY)
    sampler = Sampler(STRATEGY)
    sampler.draw(replace(batch, **{name: value})[:1], still(1)[0], 5)  # the other pose is nothing to it
    assert sampler.count.drawn == 5
