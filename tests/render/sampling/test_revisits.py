"""Revisit rate: answers worked out by hand, all places watched the slow way, and what must change nothing."""

import math
from itertools import pairwise

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st
from revisit_oracle import visits_slowly
from scipy.spatial.transform import Rotation

from palpate.render.errors import StrategyError
from palpate.render.sampling import revisits
from palpate.render.sampling.metrics import FocalPoints
from palpate.render.sampling.revisits import RevisitWatch, revisit_rate
from palpate.render.sampling.sampler import Sampler, sample_bounds, sample_contours
from palpate.render.sampling.strategy import Order, SamplingStrategy

POSE = still(1)[0]  # palm down: hand frame X = x, Z = -y of the array
RATE = 10_000.0  # [Hz]
SIX = [(circle(0.008, centre=(x, y, 0.2)), True) for x in (-0.03, 0, 0.03) for y in (-0.015, 0.015)]
NESTED = [(square(0.06), True), (square(0.03), True)]


@pytest.fixture
def every_place(monkeypatch):
    """Watch every drawn place, not one in each interval: the answer is then exact."""
    monkeypatch.setattr(revisits, "PICK_INTERVAL", 1e-9)


def counted(points, drawn=None, cuts=(), pose=POSE, rate=RATE):
    """Visits and samples waited of focal points [sample, 3] or [sample, focus, 3], taken in blocks."""
    points = np.asarray(points, np.float32)
    points = points.reshape(len(points), -1, 3)
    intensity = np.ones(points.shape[:2]) if drawn is None else np.reshape(drawn, points.shape[:2])
    watch = RevisitWatch(1, SamplingStrategy(update_rate=rate), "cpu")
    for first, stop in pairwise([0, *cuts, len(points)]):
        part = points[first:stop], intensity[first:stop].astype(np.float32)
        watch.add(0, *part, np.asarray(pose, float)[None], np.array([stop - first]))
    (revisits,), (time,) = watch.totals()
    return revisits, round(time * rate)


def ring(samples, cycle, radius=0.03):
    """A circle around the palm's middle, [sample, 3]."""
    angle = 2 * np.pi * (np.arange(samples) % cycle) / cycle
    return POSE[:3] + radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(samples)], axis=1)


def sampled(lines, seconds, strategy=None):
    """Focal points of a static pose, and what the sampler counted."""
    sampler = Sampler(strategy or SamplingStrategy())
    blocks = list(sample_contours([batch_of([lines])], still(1), np.zeros(1), seconds, sampler))
    return FocalPoints(*(np.concatenate(part) for part in zip(*blocks, strict=True))), sampler.count


@pytest.mark.parametrize("cycle", [137, 200, 400, 503])
def test_still_circle_is_revisited_once_a_cycle(cycle):
    visits, waited = counted(ring(40_000, cycle))
    assert visits >= (40_000 - cycle) // 200
    assert waited == visits * cycle


# On a circle of 30 mm in 400 samples, chords of up to 10 samples are shorter than 5 mm: 2 x 30 mm x sin(pi k / 400).
REACH = 10
# So when drawing begins, the first 390 places have no visit before, and the last 10 of the cycle one at its beginning.
FIRST_CYCLE = (REACH, sum(range(400 - REACH, 400)))


@pytest.mark.exhaustive
def test_every_place_counts_from_its_second_visit_on(every_place):
    assert counted(ring(4_000, 400)) == (3_600 + FIRST_CYCLE[0], 3_600 * 400 + FIRST_CYCLE[1])


def seam_answer(lengths, reaches, speed=7.0):
    """Rate of loops that are drawn one after the other, farther than 5 mm from each other [Hz].

    A place at d <= 5 mm past a loop's start was passed once more at that loop's end: it waits for the other loops
    only; its mirror image, d before the end, waits for this loop only. Together they wait for a cycle, which two
    places elsewhere wait for each. So of each loop two stretches of 5 mm, as the crow flies, wait half a cycle.
    lengths: of the loops [m]; reaches: along each, to where it is 5 mm from its start [m].
    """
    cycle = sum(lengths) / speed
    return 1 / (cycle * (1 - sum(reaches) / sum(lengths)))


def reach_on_circle(radius):
    return 2 * radius * math.asin(5e-3 / (2 * radius))


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("lines", "answer", "nominal"),
    [
        (SIX, seam_answer([2 * np.pi * 0.008] * 6, [reach_on_circle(0.008)] * 6), 23.21),
        (NESTED, seam_answer([0.24, 0.12], [5e-3] * 2), 19.44),
        (
            [(circle(0.01, count=500), True), (circle(0.02, centre=(0.06, 0, 0.2), count=500), True)],
            seam_answer([2 * np.pi * r for r in (0.01, 0.02)], [reach_on_circle(r) for r in (0.01, 0.02)]),
            37.14,
        ),
    ],
    ids=["six circles", "a square in a square", "two circles of different length"],
)
def test_loops_drawn_in_turn_are_revisited_once_a_cycle_but_twice_at_their_seams(lines, answer, nominal):
    strategy = SamplingStrategy(update_rate=40_000.0, order=Order(route="given"))
    _, count = sampled(lines, 10.0, strategy)
    assert count.draw_frequency(40_000.0) == pytest.approx(nominal, rel=2e-3)
    assert count.revisit_rate == pytest.approx(answer, rel=0.01)
    assert answer / nominal < 1.12


@pytest.mark.exhaustive
@pytest.mark.parametrize("cycle", [200, 400, 1_000])
def test_picks_lock_onto_no_part_of_a_cycle_that_keeps_step_with_them(cycle, monkeypatch):
    speed = 6 * 2 * 64 * 0.008 * math.sin(math.pi / 64) / ((cycle - 0.5) / RATE)
    focus, count = sampled(SIX, 10.0, SamplingStrategy(speed=speed, order=Order(route="given")))
    assert count.draw_frequency(RATE) == pytest.approx(RATE / cycle)
    monkeypatch.setattr(revisits, "PICK_INTERVAL", 1e-9)
    last = FocalPoints(focus.position[-cycle - 12_000 :], focus.intensity[-cycle - 12_000 :])
    every = revisit_rate([last], POSE[None], np.array([0, cycle + 12_000]), RATE)
    assert count.revisit_rate == pytest.approx(every, rel=0.02)


def test_silent_side_takes_its_time_but_is_no_place():
    batch = batch_of([[(square(0.06), True)]])
    intensity = np.array([0, 1, 1, 1, 0], np.float32)  # rises along the first side, falls along the last
    batch = type(batch)(**{**batch.__dict__, "intensity": np.where(intensity > 0, 1, 0).astype(np.float32)})
    sampler = Sampler(SamplingStrategy(order=Order(route="given")))
    sampler.draw(batch[:1], POSE, 50_000)
    assert sampler.count.revisit_rate == pytest.approx(7.0 / 0.24, rel=2e-3)
    corner = ring(40_000, 400)
    lit = (np.arange(40_000) % 400) >= 100
    visits, waited = counted(corner, lit)
    assert visits > 100
    assert waited == visits * 400


@pytest.mark.exhaustive
@given(
    seed=st.integers(0, 9_999),
    foci=st.integers(1, 3),
    silent=st.sampled_from([0.0, 0.2, 0.7]),
    step=st.sampled_from([3e-4, 2e-3, 8e-3]),
)
@settings(max_examples=40, deadline=None)
def test_every_place_is_what_the_slow_way_counts(seed, foci, silent, step):
    random = np.random.default_rng(seed)
    samples, rate = 300, 80.0
    walk = np.cumsum(random.normal(0, step, (samples, foci, 3)), axis=0).astype(np.float32)
    walk[samples // 2 :] = walk[: samples - samples // 2]  # the same way again
    drawn = np.repeat(random.random((samples // 10, foci)) >= silent, 10, axis=0)
    drawn &= random.random(drawn.shape) >= silent / 4
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(revisits, "PICK_INTERVAL", 1e-9)
        patch.setattr(revisits, "COUNTED_AT_ONCE", 32)  # what is past is forgotten between the cuts
        found = counted(walk, drawn, cuts=[7, 110], pose=np.array([0, 0, 0, 0, 0, 0, 1.0]), rate=rate)
    assert found == visits_slowly(walk.astype(float).tolist(), drawn.tolist(), 80)


@given(cuts=st.lists(st.integers(1, 11_999), max_size=30, unique=True), seed=st.integers(0, 9))
@settings(max_examples=6)
def test_how_samples_are_cut_into_blocks_changes_nothing(cuts, seed):
    random = np.random.default_rng(seed)
    points = ring(12_000, 400) + np.cumsum(random.normal(0, 2e-5, (12_000, 3)), axis=0)
    lit = np.repeat(random.random(60) < 0.7, 200)
    whole = counted(points, lit)
    assert whole[0] > 10
    for limit in (1, 3000):  # samples that wait to be counted
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(revisits, "COUNTED_AT_ONCE", limit)
            assert counted(points, lit, sorted(cuts)) == whole


@pytest.mark.parametrize("seed", range(4))
def test_rigid_motion_of_hand_and_points_together_changes_nothing(seed):
    turn, shift = Rotation.random(random_state=seed), np.random.default_rng(seed).uniform(-0.1, 0.1, 3)
    random = np.random.default_rng(seed)
    points = ring(30_000, 389) + np.cumsum(random.normal(0, 2e-5, (30_000, 3)), axis=0)
    moved = np.concatenate([turn.apply(POSE[:3]) + shift, (turn * Rotation.from_quat(POSE[3:])).as_quat()])
    whole, again = counted(points), counted(turn.apply(points) + shift, pose=moved)
    assert again[0] == whole[0] > 100
    assert again[1] == pytest.approx(whole[1], rel=1e-3)  # float32 rounds positions: a nearest sample may be the next


def test_skin_is_the_hands():
    poses = np.tile(POSE, (90, 1))
    turns = Rotation.from_rotvec(np.outer(0.3 * np.arange(90), [0, 0, 1]))
    poses[:, :3] += np.stack([0.01 * np.arange(90), np.zeros(90), np.zeros(90)], axis=1)  # 0.9 m/s
    poses[:, 3:] = (turns * Rotation.from_quat(POSE[3:])).as_quat()
    bounds = sample_bounds(np.arange(90) / 90, 1.0, RATE)
    index = np.repeat(np.arange(90), np.diff(bounds))
    off = ring(10_000, 400) - POSE[:3]
    points = (turns[index].apply(off) + poses[index, :3]).astype(np.float32)
    focus = FocalPoints(points, np.ones(10_000, np.float32))
    assert revisit_rate([focus], poses, bounds, RATE) == pytest.approx(25.0)
    assert revisit_rate([focus], np.tile(POSE, (90, 1)), bounds, RATE) < 20.0
    with pytest.raises(StrategyError, match="focal points end at sample 10000, the poses at sample 9999"):
        revisit_rate([focus], poses, np.append(bounds[:-1], 9_999), RATE)


@pytest.mark.parametrize("foci", [1, 2])
def test_what_the_sampler_counts_is_in_its_focal_points_and_the_poses_alone(foci):
    poses = [[(circle(0.03, centre=(1e-3 * (i % 7), 0, 0.2)), True)] if i % 9 else [] for i in range(90)]
    time = np.arange(90) / 90
    sampler = Sampler(SamplingStrategy(foci=foci))
    blocks = list(sample_contours([batch_of(poses)], still(90), time, 1.0, sampler))
    bounds = sample_bounds(time, 1.0, RATE)
    assert sampler.count.revisits > 10
    nothing = FocalPoints(blocks[0].position[:0], blocks[0].intensity[:0])
    assert revisit_rate([nothing, *blocks], still(90), bounds, RATE) == sampler.count.revisit_rate
