"""Metrics of sampling: time on the skin, jumps by cause and length, draw frequency over all that was drawn."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.render.errors import StrategyError
from palpate.render.sampling import (
    FocalPoints,
    Gap,
    Order,
    Path,
    Sampler,
    SamplingCount,
    SamplingStrategy,
    dwell_map,
    preset,
    sample_bounds,
    sample_contours,
)
from palpate.render.sampling_metrics import Probe, RevisitWatch

POSE = np.array([0.01, 0.02, 0.2, np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # palm down: u = x, v = -Z = y of the array


def points_at(places, intensity=1.0):
    position = np.asarray(places, np.float32)
    return FocalPoints(position, np.full(position.shape[:-1], intensity, np.float32))


def test_time_falls_into_the_cell_of_the_palm_that_the_point_is_on():
    u, v = 0.0108, -0.0233
    place = POSE[:3] + np.array([u, v, 0.0])
    found = dwell_map([points_at(np.tile(place, (500, 1)))], POSE[None], np.array([0, 500]), 10_000.0)
    i, j = np.unravel_index(np.argmax(found.time), found.time.shape)
    assert found.time[i, j] == pytest.approx(0.05)
    three = dwell_map([points_at(np.tile(place, (500, 3, 1)))], POSE[None], np.array([0, 500]), 10_000.0)
    assert three.time == pytest.approx(found.time)  # each of several foci has its share
    assert np.count_nonzero(found.time) == 1
    assert found.across[i] <= u < found.across[i + 1]
    assert found.along[j] <= v < found.along[j + 1]


@given(seed=st.integers(0, 99), foci=st.integers(1, 3))
@settings(max_examples=15, deadline=None)
def test_no_time_is_lost(seed, foci):
    random = np.random.default_rng(seed)
    shape = (400, 3) if foci == 1 else (400, foci, 3)
    focus = points_at(POSE[:3] + random.uniform(-0.08, 0.08, shape))
    focus.intensity[random.random(focus.intensity.shape) < 0.3] = 0.0
    blocks = [FocalPoints(focus.position[a:b], focus.intensity[a:b]) for a, b in ((0, 77), (77, 400))]
    found = dwell_map(blocks, POSE[None], np.array([0, 400]), 1000.0)
    assert found.time.sum() + found.outside + found.silent == pytest.approx(0.4)
    assert found.silent == pytest.approx(0.4 * np.mean(focus.intensity == 0))


@pytest.mark.parametrize("reach", [0.02, 0.0])  # passes again and again, or stays until it counts as not drawn again
@pytest.mark.parametrize("cut", [1, 7, 700, 5000])
def test_revisits_do_not_depend_on_how_samples_are_cut(cut, reach):
    angle = np.cumsum(np.random.default_rng(5).uniform(0.001, 0.03, 5000))  # no two rounds alike
    position = POSE[:3] + reach * np.stack([np.cos(angle), np.sin(angle), np.zeros(5000)], axis=1)
    counts = [SamplingCount(), SamplingCount()]
    RevisitWatch(counts[0], 1000.0).watch(position[:, None], POSE)
    watch = RevisitWatch(counts[1], 1000.0)
    for first in range(0, 5000, cut):
        watch.watch(position[first : first + cut, None], POSE)
    assert counts[1] == counts[0]
    if reach:
        assert counts[0].revisits == pytest.approx(angle[-1] / (2 * np.pi + 0.25), abs=1.5)  # 0.25: to leave it again
    else:
        assert (counts[0].revisits, counts[0].revisit_time) == (0, pytest.approx(4 * 1.001))


def test_distances_are_computed_about_once_a_sample(monkeypatch):
    looked = []
    watch = Probe.watch
    monkeypatch.setattr(Probe, "watch", lambda self, distance: looked.append(len(distance)) or watch(self, distance))
    angle = 2 * np.pi * np.arange(50_000) / 400
    position = POSE[:3] + 0.02 * np.stack([np.cos(angle), np.sin(angle), np.zeros(50_000)], axis=1)
    RevisitWatch(SamplingCount(), 10_000.0).watch(position[:, None], POSE)
    assert sum(looked) < 3 * 50_000


def test_skin_moves_with_the_hand():
    poses = np.tile(POSE, (2, 1))
    poses[1, 0] += 0.03
    focus = points_at(np.concatenate([np.tile(p[:3], (10, 1)) for p in poses]))
    found = dwell_map([focus], poses, np.array([0, 10, 20]), 1000.0)
    assert np.count_nonzero(found.time) == 1
    assert found.time.max() == pytest.approx(0.02)


def test_even_drawing_has_less_spread_than_pauses_at_corners():
    spread = {}
    for name in ("stm", "dtp"):
        sampler = Sampler(preset(name))
        blocks = sample_contours([batch_of([[(square(0.04), True)]])], still(1), np.zeros(1), 2.0, sampler)
        found = dwell_map(blocks, still(1), sample_bounds(np.zeros(1), 2.0, 10_000.0), 10_000.0, cell=0.005)
        spread[name] = found.spread
        assert found.time.sum() == pytest.approx(2.0, rel=0.03)  # dtp is silent at times
        assert found.mean * found.area == pytest.approx(found.time.sum())
    assert spread["stm"] < 0.5
    assert spread["dtp"] > 2.0


def test_empty_map_has_no_spread_and_impossible_grids_are_refused():
    found = dwell_map([], POSE[None], np.array([0, 0]), 1000.0)
    assert (found.spread, found.area, found.mean) == (0.0, 0.0, 0.0)
    with pytest.raises(StrategyError, match=r"cell must lie between 0 and the grid's 0.085 x 0.085 m, not 0"):
        dwell_map([], POSE[None], np.array([0, 0]), 1000.0, cell=0.0)
    with pytest.raises(StrategyError, match="focal points end at sample 3, the poses at sample 2"):
        dwell_map([points_at(np.zeros((3, 3)))], POSE[None], np.array([0, 2]), 1000.0)


def test_lengths_of_jumps_are_summed_by_cause():
    lines = [([[-0.04, y, 0.2], [0.04, y, 0.2]], False) for y in (-0.02, 0.02)]
    far = [(circle(0.02, centre=(0.2, 0, 0.2)), True)]
    sampler = Sampler(SamplingStrategy(order=Order(route="given")))
    batch = batch_of([lines, far, [], lines])
    blocks = sample_contours([batch], still(4), np.arange(4) * 0.1, 0.4, sampler)
    position = np.concatenate([b.position for b in blocks]).astype(float)
    count = sampler.count
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    assert count.jumps == {"polyline": count.jumps["polyline"], "order": 0, "pose": 1, "re-entry": 1}
    assert count.jump_lengths["pose"] == pytest.approx(steps[999], abs=1e-6)
    assert count.jump_lengths["re-entry"] == pytest.approx(steps[2999], abs=1e-6)
    assert count.jump_length == pytest.approx(steps[steps > 5e-3].sum(), abs=1e-5)
    assert sum(count.jumps.values()) == np.count_nonzero(steps > 5e-3)
    assert count.step_longest == pytest.approx(np.delete(steps, 2999).max(), abs=1e-6)


def test_a_fast_return_is_no_jump_though_its_steps_are_longer_than_those_of_the_contour():
    lines = [([[-0.04, 0, 0.2], [0.04, 0, 0.2]], False)]
    counts = {}
    for kind in ("return", "jump"):
        sampler = Sampler(SamplingStrategy(gap=Gap(kind=kind, speed=60.0)))  # 6 mm a sample
        sampler.draw(Path.of(batch_of([lines]), 0), still(1)[0], 1000)
        counts[kind] = sampler.count.jumps["polyline"]
        assert sampler.strategy.jump_threshold == pytest.approx(0.012 if kind == "return" else 5e-3)
    assert counts["return"] == 0
    assert counts["jump"] > 0


def test_a_step_out_of_silence_is_no_jump():
    lines = [([[-0.04, 0, 0.2], [0.03, 0, 0.2]], False), ([[-0.04, 0.05, 0.2], [0.03, 0.05, 0.2]], False)]
    batch = batch_of([lines])
    batch = type(batch)(**{**batch.__dict__, "intensity": np.array([0, 0, 1, 1], np.float32)})
    sampler = Sampler(SamplingStrategy(order=Order(route="given")))
    sampler.draw(Path.of(batch, 0), still(1)[0], 1000)
    assert sampler.count.silent == 500
    assert sampler.count.jumps["polyline"] == 0
    assert sampler.count.step_longest <= 7e-4 * (1 + 1e-9)


def test_jumps_of_every_focus_are_counted():
    lines = [([[-0.04, 0, 0.2], [0.04, 0, 0.2]], False)]
    one, three = (Sampler(SamplingStrategy(foci=n)) for n in (1, 3))
    for sampler in (one, three):
        for _ in sample_contours([batch_of([lines])], still(1), np.zeros(1), 1.0, sampler):
            pass
    assert three.count.jumps["polyline"] == pytest.approx(3 * one.count.jumps["polyline"], abs=3)


def test_mean_draw_frequency_weighs_poses_by_how_long_they_are_drawn():
    short, long = [(circle(0.01), True)], [(circle(0.04), True)]
    sampler = Sampler(SamplingStrategy())
    time = np.array([0.0, 0.3])
    for _ in sample_contours([batch_of([short, long])], still(2), time, 0.4, sampler):
        pass
    frequency = 10_000.0 / np.array(
        [sampler.strategy.samples_a_cycle(2 * 64 * r * np.sin(np.pi / 64)) for r in (0.01, 0.04)]
    )
    assert sampler.count.draw_frequency(10_000.0) == pytest.approx(0.75 * frequency[0] + 0.25 * frequency[1], rel=1e-6)
