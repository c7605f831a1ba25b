"""Drawing that stays: noise does not change the route, so no contour that stays is left undrawn for long.

How long a contour was not drawn is found here from the focal points and where the contours are, by distances alone.
"""

import itertools

import numpy as np
import pytest
from contour_shapes import batch_of, circle, still
from scipy.ndimage import uniform_filter1d

from palpate.datasets.motions.hand_motion import PALM_DOWN, HandMotion
from palpate.render import MeshObject, Palm, closed_contour, render
from palpate.render.errors import StrategyError
from palpate.render.sampling.sampler import Sampler, sample_bounds, sample_contours
from palpate.render.sampling.strategy import Order, Pace, SamplingStrategy

RATE, UPDATE = 90.0, 10_000.0
CENTRES = [np.array([x, y, 0.2]) for x in (-0.03, 0.0, 0.03) for y in (-0.015, 0.015)]
CYCLE = 6 * 2 * np.pi * 0.008 / 7.0  # [s] of six circles at 7 m/s


def drawn(poses, strategy=None, hand=None):
    sampler = Sampler(strategy or SamplingStrategy())
    hand = still(len(poses)) if hand is None else hand
    time = np.arange(len(poses)) / RATE
    blocks = list(sample_contours([batch_of(poses)], hand, time, len(poses) / RATE, sampler))
    return np.concatenate([b.position for b in blocks]).astype(float), sampler.count


def longest_gap(own, count):
    """Longest time for which one of `count` contours is not the one that a focal point is on [s]."""
    gaps = [np.diff(np.flatnonzero(np.concatenate([[True], own == k, [True]]))).max() - 1 for k in range(count)]
    return max(gaps) / UPDATE


def nearest_of(position, centres):
    """Number of the nearest centre to each focal point; centres: [m], shape [sample, contour, 3]."""
    return np.linalg.norm(position[:, None] - centres, axis=2).argmin(axis=1)


def noisy_circles(rng, noise, count=270, shift=None, extra=None):
    """Six circles of R 8 mm with noise at every pose; extra: a function of the pose's number that gives more lines."""
    shift = np.zeros((count, 3)) if shift is None else shift
    for i in range(count):
        lines = [(circle(0.008, c + shift[i], 48) + noise * rng.standard_normal((48, 3)), True) for c in CENTRES]
        yield lines + ([] if extra is None else extra(i))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("noise", "poses"), [(1e-7, 120), (0.0, 270), (1e-7, 270), (1e-6, 270), (1e-5, 270)])
def test_six_circles_are_each_drawn_again_within_a_cycle_and_a_half_whatever_the_noise(rng, noise, poses):
    position, count = drawn(list(noisy_circles(rng, noise, poses)))
    gap = longest_gap(nearest_of(position, np.array(CENTRES)[None]), 6)
    assert gap == pytest.approx(5 / 6 * CYCLE, abs=3e-4)  # the time of the five others
    assert gap < 1.5 * CYCLE
    assert count.absence_max == pytest.approx(gap, abs=1.1 / UPDATE)


@pytest.mark.exhaustive
@pytest.mark.parametrize("recording", ["HandSplay-110fps", "rollAndPitchCropped", "grab"])
def test_tremor_of_real_hands_leaves_no_contour_undrawn(outside_data, rng, recording):
    shift = tremor_of(outside_data, recording, 270)
    assert 1e-3 < np.abs(shift).max() < 2e-2
    position, count = drawn(list(noisy_circles(rng, 1e-7, shift=shift)))
    bounds = sample_bounds(np.arange(270) / RATE, 3.0, UPDATE)
    centres = np.repeat(np.array(CENTRES)[None] + shift[:, None], np.diff(bounds), axis=0)
    gap = longest_gap(nearest_of(position, centres), 6)
    assert gap < 1.5 * CYCLE
    assert count.absence_max == pytest.approx(gap, abs=1.1 / UPDATE)


def tremor_of(folder, recording, count):
    """What is quicker than 0.2 s in a palm's motion [m], repeated forth and back, shape [count, 3]."""
    file = np.load(folder / "leap" / f"{recording}.npz")
    one = file["hand_id"] == np.bincount(file["hand_id"] - file["hand_id"].min()).argmax() + file["hand_id"].min()
    time, palm = file["t"][one], file["palm_position"][one].astype(float)
    even = np.stack([np.interp(np.arange(time[0], time[-1], 1 / RATE), time, palm[:, k]) for k in range(3)], axis=1)
    quick = even - uniform_filter1d(even, 19, axis=0, mode="nearest")
    return np.resize(np.concatenate([quick, quick[::-1]]), (count, 3))


@pytest.mark.exhaustive
@pytest.mark.parametrize("recording", ["HandSplay-110fps", "rollAndPitchCropped", "grab"])
def test_a_tube_under_a_trembling_hand_is_drawn_as_under_a_still_one(outside_data, recording):
    """Palm across an upright tube: its own four sides, and the tube's inner wall, a circle of 40 mm around z."""
    tremor = tremor_of(outside_data, recording, 270)
    tremor *= 1e-4 / np.sqrt((tremor**2).mean())  # 0.1 mm, so that there are always these two
    gaps = []
    for shift in (np.zeros((270, 3)), tremor):
        poses = np.tile(np.array([0.0, 0, 0.2, *PALM_DOWN]), (270, 1))
        poses[:, :3] += shift
        motion = HandMotion(np.arange(270) / RATE, poses)
        batch = render(MeshObject.load("tube"), Palm(0.088, 0.088), motion, closed_contour())
        assert set(np.diff(batch.pose_start)) == {2}
        sampler = Sampler(SamplingStrategy())
        blocks = sample_contours([batch], motion.pose, motion.time, 3.0, sampler)
        position = np.concatenate([block.position for block in blocks]).astype(float)
        on_sides = np.linalg.norm(position[:, :2], axis=1) > 0.0405
        gap = longest_gap(on_sides.astype(int), 2)
        assert sampler.count.absence_max == pytest.approx(gap, abs=1.1 / UPDATE)
        assert gap < 1.5 * batch.length().max() / 7.0
        gaps.append(gap)
    assert gaps == pytest.approx([4 * 0.088 / 7.0] * 2, rel=0.01)  # as long as the sides take


@pytest.mark.exhaustive
@pytest.mark.parametrize(("stay_count", "flicker_count"), [(3, 4), (8, 10)])
def test_contours_that_stay_are_drawn_on_while_more_others_come_and_go(rng, stay_count, flicker_count):
    """Circles of 8 mm that stay, and more of 2 mm that are there at every second pose."""
    stay = [np.array([x, y, 0.2]) for x in (-0.045, -0.015, 0.015, 0.045) for y in (-0.015, 0.015)][:stay_count]
    others = [np.array([x, 0.05, 0.2]) for x in np.linspace(-0.06, 0.06, flicker_count)]

    def lines(centres, radius):
        return [(circle(radius, c, 48) + 1e-6 * rng.standard_normal((48, 3)), True) for c in centres]

    poses = [lines(stay, 0.008) + (lines(others, 0.002) if i % 2 else []) for i in range(270)]
    position, count = drawn(poses)
    longest = 2 * np.pi * (0.008 * stay_count + 0.002 * flicker_count) / 7.0
    assert longest_gap(nearest_of(position, np.array(stay + others)[None]), stay_count) < 1.5 * longest
    assert count.absence_max < 1.5 * longest


def test_what_is_drawn_does_not_depend_on_how_polylines_are_listed(rng):
    """A permutation of the lines, other starts of loops and open lines the other way round draw the same curve."""
    lines = [(circle(0.012, c, 240), True) for c in CENTRES[:3]]
    lines += [([[x, -0.04, 0.2], [x + 0.02, -0.045, 0.2]], False) for x in (-0.04, 0.0, 0.03)]

    def listed(i):
        if i == 0:
            return lines
        mixed = [
            (np.roll(p, rng.integers(len(p)), axis=0), True) if closed else (p[:: rng.choice([-1, 1])], False)
            for p, closed in lines
        ]
        return [mixed[k] for k in rng.permutation(len(mixed))]

    listed_once, once = drawn([lines] * 60)
    mixed, count = drawn([listed(i) for i in range(60)])
    assert np.abs(mixed - listed_once).max() < 1e-6
    assert count.absence_max == pytest.approx(once.absence_max, abs=1.1 / UPDATE)


def passing(share):
    """Four short lines in a row, of which the middle ones change places; they pass each other beside the row."""
    x = (1 - share) * np.array([-0.06, -0.02, 0.02, 0.06]) + share * np.array([-0.06, 0.02, -0.02, 0.06])
    y = 0.02 * np.sin(np.pi * share) * np.array([0, 1, -1, 0])
    return [([[a, b, 0.2], [a, b + 1e-3, 0.2]], False) for a, b in zip(x, y, strict=True)]


@pytest.mark.exhaustive
@pytest.mark.parametrize("margin", [0.0, 0.2, 1000.0])
def test_a_shorter_route_is_taken_once_it_is_shorter_by_the_margin(margin):
    """Against all orders and directions of the four lines, tried one by one."""
    sampler, ratios = Sampler(SamplingStrategy(order=Order(margin=margin))), []
    for share in np.linspace(0, 1, 60):
        lines = passing(share)
        sampler.draw(batch_of([lines]), still(1)[0], 1)
        best = np.inf
        for order in itertools.permutations(range(4)):
            for turned in itertools.product((1, -1), repeat=4):
                ends = [np.array(lines[i][0])[::t] for i, t in zip(order, turned, strict=True)]
                best = min(best, sum(np.linalg.norm(b[0] - a[1]) for a, b in itertools.pairwise([*ends, ends[0]])))
        drawn = sampler.room.state.piece.numpy()[:4]  # as the next pose keeps them
        ends = np.stack([drawn["start"], drawn["end"]], axis=1)
        own = sum(np.linalg.norm(b[0] - a[1]) for a, b in itertools.pairwise([*ends, ends[0]]))
        ratios.append((own - 5e-3) / best)
    if margin < 1000:
        # looked for anew where the jumps are longer than those of the shortest route that was found last
        assert max(ratios) <= (1 + margin) ** 2 + 0.15
    else:
        assert max(ratios) > 1.2


def test_a_contour_that_is_never_drawn_is_absent_for_as_long_as_it_is_there():
    """A still point draws the first circle only; the second is there for 20 of 45 poses."""
    second = (circle(0.01, (0.05, 0, 0.2)), True)
    first = (circle(0.01, (-0.05, 0, 0.2)), True)
    poses = [[first, second] if 10 <= i < 30 else [first] for i in range(45)]
    _, count = drawn(poses, SamplingStrategy(pace=Pace(kind="still")))
    assert count.absence_max == pytest.approx(20 / RATE, abs=1.1 / UPDATE)


def test_silence_is_no_absence():
    poses = [[(circle(0.02), True)] if i % 30 < 15 else [] for i in range(90)]
    _, count = drawn(poses)
    assert count.absence_max == 0.0


@pytest.mark.parametrize("span", [100, 3000])
def test_what_is_absent_until_a_fade_ends_does_not_depend_on_spans(span, monkeypatch):
    """Four circles, 75.4 mm each, at 1.5 m/s: the three others take 0.1508 s, the fade ends at 0.32 s."""
    lines = [(circle(0.012, (x, 0, 0.2), 360), True) for x in np.linspace(-0.06, 0.06, 4)]
    monkeypatch.setattr("palpate.render.sampling.sampler.SPAN_SAMPLES", span)
    sampler = Sampler(SamplingStrategy(speed=1.5))
    poses, time = batch_of([lines, lines]), np.array([0, 0.9])
    for _ in sample_contours([poses], still(2), time, 0.91, sampler, hold=0.3):
        pass
    assert sampler.count.absence_max == pytest.approx(3 * 2 * np.pi * 0.012 / 1.5, abs=2e-4)


def test_contours_elsewhere_are_not_taken_for_those_of_the_pose_before():
    """Two circles that change places by 0.1 m at every pose are new ones: each waits for 1 / 90 s at most."""
    left = [(circle(0.03, (-0.1, y, 0.2)), True) for y in (-0.04, 0.04)]
    right = [(circle(0.03, (0.1, y, 0.2)), True) for y in (-0.04, 0.04)]
    _, count = drawn([left, right] * 30)
    assert count.absence_max == pytest.approx(1 / RATE, abs=1.1 / UPDATE)


def test_a_margin_that_is_none_is_refused():
    with pytest.raises(StrategyError, match=r"order\.margin.*-0\.1"):
        Order(margin=-0.1)
