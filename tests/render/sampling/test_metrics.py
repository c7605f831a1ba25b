"""Metrics of sampling: time on the skin, jumps by cause and length, draw frequency over all that was drawn."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.render import MeshObject, Palm, Scene, exploration
from palpate.render.errors import StrategyError
from palpate.render.sampling.metrics import FocalPoints, dwell_map, dwell_maps
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler, sample_bounds, sample_contours, sample_motions
from palpate.render.sampling.strategy import Order, SamplingStrategy

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


def test_skin_moves_with_the_hand():
    poses = np.tile(POSE, (2, 1))
    poses[1, 0] += 0.03
    focus = points_at(np.concatenate([np.tile(p[:3], (10, 1)) for p in poses]))
    found = dwell_map([focus], poses, np.array([0, 10, 20]), 1000.0)
    assert np.count_nonzero(found.time) == 1
    assert found.time.max() == pytest.approx(0.02)


@pytest.mark.parametrize(("width", "length", "cell"), [(0.085, 0.085, 1e-3), (0.07, 0.09, 4e-3), (0.0853, 0.1, 1e-3)])
@pytest.mark.parametrize("seed", range(5))
def test_map_of_exactly_the_palms_size_holds_the_palms_border(width, length, cell, seed):
    random = np.random.default_rng(seed)
    middle = np.array([0, 0, 0.2]) + random.uniform(-0.05, 0.05, 3)
    pose = np.concatenate([middle, Rotation.random(random_state=seed).as_quat()])
    u, v = random.uniform(-width / 2, width / 2, 2_000), random.uniform(-length / 2, length / 2, 2_000)
    u[:500], u[500:1_000], v[1_000:1_500], v[1_500:] = -width / 2, width / 2, -length / 2, length / 2
    places = Rotation.from_quat(pose[3:]).apply(np.stack([u, np.zeros(2_000), -v], axis=1)) + pose[:3]
    kept = pose.astype(np.float32).astype(float)  # as files keep it
    bounds = np.array([0, 2_000])
    found = dwell_map([points_at(places)], kept[None], bounds, 2_000.0, width=width, length=length, cell=cell)
    assert found.time.sum() == pytest.approx(1.0, abs=1e-12)
    assert found.outside == pytest.approx(0.0, abs=1e-12)
    assert found.across[[0, -1]] == pytest.approx([-width / 2, width / 2], abs=1e-12)
    assert found.along[[0, -1]] == pytest.approx([-length / 2, length / 2], abs=1e-12)
    assert np.diff(found.along).max() <= cell * (1 + 1e-9)
    assert found.time[1:-1, 1:-1].sum() == 0.0


def test_border_between_cells_is_of_the_upper_cell_however_a_place_is_rounded():
    edge = np.repeat(np.arange(-3, 4), 100) * 1e-3
    noise = np.random.default_rng(1).uniform(-5e-7, 5e-7, (700, 2))
    places = POSE[:3] + np.stack([edge + noise[:, 0], 1e-4 + 0 * edge, noise[:, 1]], axis=1)
    found = dwell_map([points_at(places)], POSE[None], np.array([0, 700]), 700.0, width=6e-3, length=6e-3)
    assert found.time[:, 3] == pytest.approx([1 / 7, 1 / 7, 1 / 7, 1 / 7, 1 / 7, 2 / 7])  # the last edge: last cell
    assert found.time.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["stm", "multi-focus"])
def test_maps_of_many_motions_are_those_of_each_motions_focal_points(name, device):
    strategy, motions = preset(name), [exploration("tube", duration=1.0, rate=90.0, seed=seed) for seed in range(2)]
    pose, time = (np.concatenate([getattr(motion, which) for motion in motions]) for which in ("pose", "time"))
    batch = Scene.of(MeshObject.load("tube"), Palm(), "cc").contours(pose, 0, device)[0]
    samples = sample_motions(batch, pose, time, np.cumsum([0, *map(len, motions)]), [1.0, 1.0], strategy)
    grid = {"width": 0.08, "length": 0.06, "cell": 2e-3}
    for k, found in enumerate(dwell_maps(samples, strategy.update_rate, **grid)):
        bounds = sample_bounds(motions[k].time, 1.0, strategy.update_rate)
        single = dwell_map([samples.focus(k)], motions[k].pose, bounds, strategy.update_rate, **grid)
        assert (found.time == single.time).all()
        assert single.time.any()
        assert (found.spread, found.outside, found.silent) == (single.spread, single.outside, single.silent)
        assert single.outside > 0


def test_beyond_the_border_is_outside():
    places = POSE[:3] + np.array([[3e-3 + 2e-6, 0, 0], [-3e-3 - 2e-6, 0, 0], [0, 3e-3 + 2e-6, 0], [0, 0, 0]])
    found = dwell_map([points_at(places)], POSE[None], np.array([0, 4]), 4.0, width=6e-3, length=6e-3)
    assert (found.outside, found.time[3, 3]) == (0.75, 0.25)


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


def test_a_step_out_of_silence_is_no_jump():
    lines = [([[-0.04, 0, 0.2], [0.03, 0, 0.2]], False), ([[-0.04, 0.05, 0.2], [0.03, 0.05, 0.2]], False)]
    batch = batch_of([lines])
    batch = type(batch)(**{**batch.__dict__, "intensity": np.array([0, 0, 1, 1], np.float32)})
    sampler = Sampler(SamplingStrategy(order=Order(route="given")))
    sampler.draw(batch[:1], still(1)[0], 1000)
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
