"""Focal points and counts of many motions at once are those of the sampler in NumPy, but for rounding."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import batch_of, square, still
from numpy_sampler.sampler import Sampler as NumpySampler
from numpy_sampler.sampling import sample_contours as numpy_contours
from sampling_cases import random_motion, random_motions, random_strategy, with_pauses, without_folds

from palpate.render import MeshObject, Palm, Scene, exploration, render
from palpate.render.contour_batch import join_batches
from palpate.render.errors import StrategyError
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.sampling.metrics import SamplingCount
from palpate.render.sampling.presets import PRESETS, preset
from palpate.render.sampling.sampler import joined, sample_motions
from palpate.render.sampling.strategy import (
    Dwell,
    Gap,
    Order,
    SamplingStrategy,
)

POSITION_TOLERANCE = 1e-7  # [m]: half a unit in the last place of a float32, 0.2 m from the origin, is 7e-9 m
BY_LENGTHS = ("jump_lengths", "step_longest", "hops_longest", "cycles", "absence_max", "revisit_time")


def by_numpy(batch, pose, time, duration, strategy, hold=None):
    """Focal points and counts of one motion by the sampler in NumPy; no focal points where it has none."""
    sampler = NumpySampler(strategy)
    blocks = list(numpy_contours([batch], pose, time, duration, sampler, hold=hold)) if len(time) else []
    return joined(blocks) if blocks else None, sampler.count


def assert_same(samples, batch, pose, time, start, duration, strategy, hold=None):
    """Assert that every motion is what the sampler in NumPy draws and counts, but for rounding."""
    for motion, (a, b) in enumerate(pairwise(np.asarray(start).tolist())):
        own = None if hold is None else float(hold[motion])
        focus, count = by_numpy(batch.select(a, b), pose[a:b], time[a:b], duration[motion], strategy, own)
        drawn, counted = samples.focus(motion), samples.counts[motion]
        assert len(drawn.intensity) == (0 if focus is None else len(focus.intensity))
        if focus is not None:
            assert drawn.position.shape == focus.position.shape
            assert np.abs(drawn.position - focus.position).max() <= POSITION_TOLERANCE
            assert np.abs(drawn.intensity - focus.intensity).max() <= 1e-6
        assert_counted(counted, count)


def assert_counted(found, expected):
    """Assert that two counts are equal, lengths and times but for rounding."""
    for field in fields(SamplingCount):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        close = pytest.approx(other, rel=1e-9, abs=1e-8) if field.name in BY_LENGTHS else other
        assert one == close, field.name


@pytest.mark.exhaustive(after=8)
@pytest.mark.parametrize("seed", range(160))
def test_random_motions_are_what_the_sampler_in_numpy_draws(seed, device):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    line_most = int(rng.choice([1, 2, 3, 4, 6, 10]))
    batch = random_strokes(rng, count, line_most=line_most, with_intensity=bool(rng.random() < 0.4))
    if rng.random() < 0.25:
        batch = with_pauses(rng, batch)
    pose, time, start, duration, hold = random_motions(rng, count)
    strategy = random_strategy(rng)
    batch = without_folds(batch, strategy)
    samples = sample_motions(batch, pose, time, start, duration, strategy, hold=hold, device=device)
    assert_same(samples, batch, pose, time, start, duration, strategy, hold)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_draws_hard_motions_as_the_sampler_in_numpy_does(name, device):
    """Several polylines that come and go, with intensities and pauses, silent and fading poses."""
    strategy, rng = preset(name), np.random.default_rng(7)
    for weighed, paused in ((False, False), (True, False), (True, True)):
        motion = random_motion(rng, with_intensity=weighed, paused=paused)
        batch, start = without_folds(motion.batch, strategy), [0, len(motion.time)]
        rows = batch, motion.pose, motion.time, start, [motion.duration], strategy
        assert_same(sample_motions(*rows, hold=np.array([motion.hold]), device=device), *rows, [motion.hold])


def explored(name, contours, seed=0, duration=1.2):
    """Contours of an exploration, and its motion."""
    motion = exploration(name, duration=duration, rate=90.0, seed=seed)
    return Scene.of(MeshObject.load(name), Palm(), contours).contours(motion.pose, 0, "cpu")[0].numpy(), motion


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "contours"), [("tube", "oc"), ("tube", "cc"), ("cube", "cc"), ("dog", "oc")])
def test_explorations_are_what_the_sampler_in_numpy_draws(name, contours, device):
    batch, motion = explored(name, contours)
    start, duration = np.array([0, len(motion)]), np.array([motion.duration])
    slow = SamplingStrategy(speed=0.5, continuity="jump", dwell=Dwell(time=0.01), gap=Gap("return"))
    for strategy in (SamplingStrategy(), preset("stp", foci=2), preset("dtp"), slow):
        samples = sample_motions(batch, motion.pose, motion.time, start, duration, strategy, device=device)
        assert_same(samples, batch, motion.pose, motion.time, start, duration, strategy)


def test_motions_may_be_cut_anywhere_among_batches_and_take_no_notice_of_each_other(device):
    parts = [explored("tube", "oc", seed) for seed in range(3)]
    whole = join_batches([batch for batch, _ in parts])
    pose, time = (np.concatenate([getattr(motion, name) for _, motion in parts]) for name in ("pose", "time"))
    start = np.cumsum([0, *[len(motion) for _, motion in parts]])
    duration = np.full(3, 1.2)
    cuts = [0, 1, 77, int(start[1]), 300, whole.pose_count]
    batches = [whole.select(a, b).to(device) for a, b in pairwise(cuts)]
    together = sample_motions(batches, pose, time, start, duration, SamplingStrategy())
    for k, (batch, motion) in enumerate(parts):
        alone = sample_motions(
            batch, motion.pose, motion.time, [0, len(motion)], [1.2], SamplingStrategy(), device=device
        )
        assert (together.focus(k).position == alone.focus(0).position).all()
        assert (together.focus(k).intensity == alone.focus(0).intensity).all()
        assert together.counts[k] == alone.counts[0]
    assert {str(batch.points.device) for batch in batches} == {str(together.position.device)}


@pytest.mark.exhaustive(after=2)
@pytest.mark.parametrize("line_most", [5, 33, 31, 130])
def test_routes_through_many_polylines_are_those_of_the_sampler_in_numpy(line_most, device):
    """Up to 4 places all orders are tried, up to 32 pieces the route is improved, and up to 128 it is searched for."""
    time, start, duration = np.arange(8) / 90, np.array([0, 8]), np.array([8 / 90])
    for seed, gap in enumerate(("jump", "pendulum", "close", "return")):
        batch = random_strokes(np.random.default_rng(seed), 8, line_most=line_most)
        strategy = SamplingStrategy(order=Order("pendulum" if seed % 2 else "loop", margin=0.0), gap=Gap(gap))
        samples = sample_motions(batch, still(8), time, start, duration, strategy, device=device)
        assert_same(samples, batch, still(8), time, start, duration, strategy)


def test_poses_may_be_on_a_device(device):
    batch, motion = explored("tube", "cc", duration=1.0)
    rows = motion.time, [0, len(motion)], [motion.duration], preset("lm")
    pose = wp.array(motion.pose.astype(np.float64), dtype=wp.transformd, device=device)
    there, here = (sample_motions(batch, which, *rows, device=device) for which in (pose, motion.pose))
    assert (there.position.numpy() == here.position.numpy()).all()
    assert there.counts == here.counts


def test_a_polyline_without_points_is_drawn_as_none(device):
    lines, rows = [(square(0.04), True)] * 3, (np.arange(3) / 90, [0, 3], [3 / 90], SamplingStrategy())
    for place in (0, 1, 3):
        batch = batch_of([[*lines[:place], (np.zeros((0, 3)), False), *lines[place:]]] * 2 + [lines[:1]])
        without = batch_of([lines] * 2 + [lines[:1]])
        one, other = (sample_motions(given, still(3), *rows, device=device) for given in (batch, without))
        np.testing.assert_array_equal(one.focus(0).position, other.focus(0).position)
        assert one.counts == other.counts


def test_no_motion_no_pose_and_poses_without_contours_are_drawn_as_silence(device):
    empty = batch_of([])
    nothing = sample_motions(empty, np.zeros((0, 7)), np.zeros(0), [0], [], SamplingStrategy(), device=device)
    assert (len(nothing.counts), nothing.position.shape) == (0, (0, 1))
    none = sample_motions(empty, np.zeros((0, 7)), np.zeros(0), [0, 0], [1.0], SamplingStrategy(), device=device)
    assert (none.counts[0].samples, len(none.focus(0).intensity)) == (0, 0)
    time = np.arange(3) / 90
    silent = sample_motions(batch_of([[]] * 3), still(3), time, [0, 3], [3 / 90], SamplingStrategy(), device=device)
    assert (silent.counts[0].silent, silent.counts[0].samples) == (334, 334)
    assert (silent.focus(0).position == np.float32([0, 0, 0.2])).all()
    assert silent.focus(0).intensity.max() == 0


def test_contours_that_cannot_be_sampled_are_refused_by_name_and_place(device):
    one = batch_of([[(square(0.04), True)]])
    several = batch_of([[(square(0.04), True)], [], [(square(0.04), True), (square(0.02), True)]])
    several.points[11, 1] = np.nan
    uneven = replace(one, intensity=np.linspace(0, 1, one.point_count, dtype=np.float32))
    for batch, poses, end, message in (
        (several, 3, 0.1, r"points\[11\] must be finite, not .*nan.* \(pose 2, polyline 2\)"),
        (uneven, 1, 0.1, "is closed"),
        (one, 2, 2.0, "of the same poses, not 1, 2, 2, 2"),
        (one, 1, 1e6, "too many for one call"),
    ):
        with pytest.raises(StrategyError, match=message):
            sample_motions(
                batch, still(poses), np.arange(poses) / 90, [0, poses], [end], SamplingStrategy(), device=device
            )


@pytest.mark.parametrize("bare", [0, 1, 2])
def test_a_batch_without_intensity_among_others_that_have_it_has_all_of_it(bare):
    """Such as an empty one, which a stage of a user's leaves as it is."""
    whole = render("cube", "palm", exploration("cube", duration=0.3, rate=90.0), "cc")
    parts = [whole.select(k, k + 9) for k in (0, 9, 18)]
    levels = [np.full(part.point_count, 0.25, np.float32) for part in parts]
    parts = [
        part if k == bare else replace(part, intensity=level, dwell=0 * level)
        for k, (part, level) in enumerate(zip(parts, levels, strict=True))
    ]
    joined = join_batches(parts)
    levels[bare] = np.ones(parts[bare].point_count, np.float32)
    np.testing.assert_array_equal(joined.intensity, np.concatenate(levels))
    np.testing.assert_array_equal(joined.dwell, np.zeros(joined.point_count, np.float32))
    np.testing.assert_array_equal(joined.points, whole.select(0, 27).points)


def test_polylines_that_lie_on_each_other_are_recognised_as_by_the_sampler_in_numpy(device):
    """The whole outline on each of 15 patches in one plane: rounding must not decide which copy is which."""
    mesh = MeshObject.load("dog")
    motion = exploration(mesh.bounds, 2.0, rate=40.0, seed=3, model="around")
    batch, _ = Scene.of(mesh, flat_hand(), "whole").contours(motion.pose, 0, device)
    batch, start, duration = batch.numpy(), np.array([0, len(motion)]), np.array([2.0])
    assert np.diff(batch.pose_start).max() >= 15
    samples = sample_motions(batch, motion.pose, motion.time, start, duration, SamplingStrategy(), device=device)
    assert_same(samples, batch, motion.pose, motion.time, start, duration, SamplingStrategy())
