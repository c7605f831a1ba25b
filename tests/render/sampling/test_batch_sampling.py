"""Focal points of many motions at once are those of the host's sampler, to the bit, and so are their counts."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import batch_of, square, still

from palpate.render import MeshObject, Palm, Scene, exploration, render
from palpate.render.contour_batch import join_batches
from palpate.render.errors import StrategyError
from palpate.render.hands.flat_hand import flat_hand
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler, joined, joined_batches, sample_contours, sample_motions
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

SAMPLE_EXACTLY = (
    "samples",
    "silent",
    "held",
    "jumps",
    "jump_lengths",
    "hops",
    "hops_longest",
    "drawn",
    "cycles",
    "absence_max",
    "revisits",
    "revisit_time",
)
BY_LENGTHS = ("jump_lengths", "hops_longest")


def by_host(batch, pose, time, duration, strategy, hold=None):
    """Focal points and counts of one motion by the host's sampler; no focal points where it has none."""
    sampler = Sampler(strategy)
    blocks = list(sample_contours([batch], pose, time, duration, sampler, hold=hold)) if len(time) else []
    return joined(blocks) if blocks else None, sampler.count


def assert_same(samples, batch, pose, time, start, duration, strategy, hold=None):
    """Assert that every motion is what the host draws; small circles are alike within rounding only."""
    circles = strategy.lm is not None
    for motion, (a, b) in enumerate(pairwise(np.asarray(start).tolist())):
        own = None if hold is None else float(hold[motion])
        focus, count = by_host(batch.select(a, b), pose[a:b], time[a:b], duration[motion], strategy, own)
        drawn, counted = samples.focus(motion), samples.counts[motion]
        assert len(drawn.intensity) == (0 if focus is None else len(focus.intensity))
        if focus is not None:
            assert drawn.position.shape == focus.position.shape
            assert np.abs(drawn.position - focus.position).max() <= (1e-7 if circles else 0.0)
            assert np.abs(drawn.intensity - focus.intensity).max() <= 0.0
        for name in SAMPLE_EXACTLY:
            expected = getattr(count, name)
            close = pytest.approx(expected, rel=1e-12, abs=1e-8) if circles and name in BY_LENGTHS else expected
            assert getattr(counted, name) == close, name
        assert counted.step_longest == pytest.approx(count.step_longest, abs=1e-9 if circles else 0.0)


def random_strategy(rng):
    kind = str(rng.choice(["speed", "frequency", "capped", "still"], p=[0.5, 0.2, 0.2, 0.1]))
    order, points = "loop", None
    if kind != "still":
        order = str(rng.choice(["loop", "pendulum", "step", "random"], p=[0.6, 0.2, 0.1, 0.1]))
        points = int(rng.choice([7, 40])) if order in ("step", "random") or rng.random() < 0.2 else None
    in_sections = kind == "frequency" and order == "loop" and points is None and rng.random() < 0.4
    sections = Sections(int(rng.choice([2, 5, 24])), float(rng.choice([0.5, 2.0, 20.0])))
    return SamplingStrategy(
        speed=float(rng.choice([2.0, 7.0, 14.0])),
        update_rate=float(rng.choice([1000.0, 10_000.0])),
        fade=float(rng.choice([0.0, 0.005, 0.02])),
        pace=Pace(kind, points=points, frequency=float(rng.choice([5.0, 70.0]))),
        order=Order(
            order, 3, int(rng.integers(5)), str(rng.choice(["shortest", "given"], p=[0.7, 0.3])), rng.choice([0.0, 0.2])
        ),
        gap=Gap(str(rng.choice(["jump", "return", "pendulum", "close"], p=[0.4, 0.2, 0.2, 0.2]))),
        am=AmplitudeModulation() if rng.random() < 0.15 else None,
        lm=LateralModulation() if rng.random() < 0.15 else None,
        foci=int(rng.choice([1, 2, 5], p=[0.6, 0.2, 0.2])),
        continuity=str(rng.choice(["nearest", "jump", "finish"], p=[0.5, 0.2, 0.3])),
        dwell=random_dwell(rng, kind),
        sections=sections if in_sections else None,
    )


def random_dwell(rng, pace):
    kinds = ["none", "share"] if pace == "frequency" else ["none", "none", "time", "share"]
    kind, angle = str(rng.choice(kinds)), float(rng.choice([0.3, 1.0, 2.5]))
    time, share = float(rng.choice([2e-4, 0.005, 0.1])), float(rng.choice([0.1, 0.8]))
    return Dwell(time if kind == "time" else 0.0, share if kind == "share" else 0.0, angle)


def with_pauses(rng, batch):
    """A batch with pauses at some points, which agree at seams."""
    dwell = rng.choice([0.0, 1e-4, 0.003, 0.02], size=batch.point_count, p=[0.7, 0.1, 0.1, 0.1])
    loop = np.flatnonzero(batch.polyline_closed)
    dwell[batch.polyline_start[loop + 1] - 1] = dwell[batch.polyline_start[loop]]
    return replace(batch, dwell=dwell.astype(np.float32))


def random_motions(rng, pose_count):
    """Poses, times, offsets of motions, when each ends, and when its poses fade; some motions have no pose."""
    start = [0, *np.sort(rng.integers(0, pose_count + 1, rng.integers(0, 4))).tolist(), pose_count]
    time, duration = np.zeros(pose_count), []
    for a, b in pairwise(start):
        interval = rng.choice([0.011, 1e-4, 0.03, 0.15], size=b - a, p=[0.7, 0.1, 0.15, 0.05])
        time[a:b] = np.cumsum(interval) - interval + (0.013 if rng.random() < 0.2 else 0.0)
        duration.append(0.011 + (time[b - 1] if b > a else 0.0))
    pose = rng.normal(size=(pose_count, 7))
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    hold = rng.choice([0.005, 0.05, np.inf], size=len(duration)) if rng.random() < 0.5 else None
    return pose.astype(np.float32), time, np.array(start), np.array(duration), hold


@pytest.mark.exhaustive(after=8)
@pytest.mark.parametrize("seed", range(48))
def test_random_motions_are_what_the_host_draws(seed, device):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    line_most = int(rng.choice([1, 2, 3, 4, 6, 10]))
    batch = random_strokes(rng, count, line_most=line_most, with_intensity=bool(rng.random() < 0.4))
    if rng.random() < 0.25:
        batch = with_pauses(rng, batch)
    pose, time, start, duration, hold = random_motions(rng, count)
    strategy = random_strategy(rng)
    samples = sample_motions(batch, pose, time, start, duration, strategy, hold=hold, device=device)
    assert_same(samples, batch, pose, time, start, duration, strategy, hold)


def explored(name, contours, seed=0, duration=1.2):
    """Contours of an exploration, and its motion."""
    motion = exploration(name, duration=duration, rate=90.0, seed=seed)
    return Scene.of(MeshObject.load(name), Palm(), contours).contours(motion.pose, 0, "cpu")[0].numpy(), motion


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("name", "contours"), [("tube", "oc"), ("tube", "cc"), ("cube", "cc"), ("dog", "oc")])
def test_explorations_are_what_the_host_draws(name, contours, device):
    batch, motion = explored(name, contours)
    start, duration = np.array([0, len(motion)]), np.array([motion.duration])
    finished = SamplingStrategy(speed=0.5, continuity="finish", dwell=Dwell(time=0.01), gap=Gap("return"))
    for strategy in (SamplingStrategy(), preset("stp", continuity="finish", foci=2), preset("dtp"), finished):
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
def test_routes_through_many_polylines_are_the_hosts(line_most, device):
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


@pytest.mark.parametrize(("bare", "on_device"), [(0, True), (1, False), (2, True)])
def test_a_batch_without_intensity_among_others_that_have_it_has_all_of_it(bare, on_device, device):
    """Such as an empty one, which a stage of a user's leaves as it is."""
    whole = render("cube", "palm", exploration("cube", duration=0.3, rate=90.0), "cc")
    parts = [whole.select(k, k + 9) for k in (0, 9, 18)]
    levels = [np.full(part.point_count, 0.25, np.float32) for part in parts]
    parts = [
        part if k == bare else replace(part, intensity=level, dwell=0 * level)
        for k, (part, level) in enumerate(zip(parts, levels, strict=True))
    ]
    joined = joined_batches([part.to(device) for part in parts] if on_device else parts).numpy()
    levels[bare] = np.ones(parts[bare].point_count, np.float32)
    np.testing.assert_array_equal(joined.intensity, np.concatenate(levels))
    np.testing.assert_array_equal(joined.dwell, np.zeros(joined.point_count, np.float32))
    np.testing.assert_array_equal(joined.points, whole.select(0, 27).points)


def test_polylines_that_lie_on_each_other_are_recognised_as_the_host_does(device):
    """The whole outline on each of 15 patches in one plane: rounding must not decide which copy is which."""
    mesh = MeshObject.load("dog")
    motion = exploration(mesh.bounds, 2.0, rate=40.0, seed=3, model="around")
    batch, _ = Scene.of(mesh, flat_hand(), "whole").contours(motion.pose, 0, device)
    batch, start, duration = batch.numpy(), np.array([0, len(motion)]), np.array([2.0])
    assert np.diff(batch.pose_start).max() >= 15
    samples = sample_motions(batch, motion.pose, motion.time, start, duration, SamplingStrategy(), device=device)
    assert_same(samples, batch, motion.pose, motion.time, start, duration, SamplingStrategy())
