"""Focal points and counts depend on no buffer: any cutting of a motion into blocks, batches and ranges gives the same.

The scene holds what a cut could divide: contours that are partly dark, pauses, a missing pose that fades, a silence.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still

from palpate.render.sampling.metrics import FocalPoints, dwell_map
from palpate.render.sampling.presets import PRESETS, preset
from palpate.render.sampling.sampler import Sampler, joined, sample_bounds, sample_contours, sample_motions
from palpate.render.sampling.strategy import SamplingStrategy

TIME = np.array([0.0, 0.0137, 0.0211, 0.0412, 0.1537, 0.1612, 0.1701])  # the fourth lasts for more than a block
DURATION = 0.1853


def scene():
    """Seven poses: rings with dark halves and pauses, a square, none, the square again, and rings elsewhere."""
    rings = [(circle(0.01, (x, 0, 0.2), 48), True) for x in (-0.015, 0.0, 0.018)]
    line = ([[-0.02, 0.03, 0.2], [0.0, 0.034, 0.2], [0.02, 0.03, 0.2]], False)
    ring = [(circle(0.02, (0.004, 0, 0.2), 48), True), line]
    batch = batch_of([rings, ring, [(square(0.03), True)], [*rings, line], [], [(square(0.03), True)], ring])
    dark = batch.points[:, 0] * batch.points[:, 1] < 1e-5  # opposite quarters: of a ring, its ends agree
    corner = np.abs(batch.points[:, 0]) > 0.0195
    return replace(batch, intensity=np.float32(~dark), dwell=np.float32(0.0007 * corner))


def motion_of(batch, time=TIME):
    pose = still(len(time))
    pose[:, 0] += 1e-3 * np.arange(len(time))
    return batch, pose.astype(np.float32), time


def strategy_of(name, **changes):
    return preset(name, hold=0.0301, fade=0.0097, **changes)


def sampled(batches, pose, time, strategy, block=1024):
    sampler = Sampler(strategy)
    return joined(
        list(sample_contours(batches, pose, time, DURATION, sampler, block=block, hold=0.0301))
    ), sampler.count


@pytest.mark.parametrize("foci", [1, 3])
def test_dwell_maps_of_any_blocks_have_the_same_bits(foci):
    """At 10,001 Hz, of which no sample's time is a binary fraction; times are whole numbers of samples."""
    batch, pose, time = motion_of(scene())
    focus, _ = sampled([batch], pose, time, SamplingStrategy(foci=foci, update_rate=10_001.0))
    bounds = sample_bounds(time, DURATION, 10_001.0)
    expected = dwell_map([focus], pose, bounds, 10_001.0)
    assert (np.rint(expected.time * foci * 10_001) / (foci * 10_001.0) == expected.time).all()
    for block in (7, 100):
        cuts = range(block, len(focus.intensity), block)
        parts = zip(np.split(focus.position, cuts), np.split(focus.intensity, cuts), strict=True)
        found = dwell_map([FocalPoints(*part) for part in parts], pose, bounds, 10_001.0)
        assert (found.time == expected.time).all()
        assert (found.spread, found.outside, found.silent) == (expected.spread, expected.outside, expected.silent)


def assert_same(found, expected):
    assert (found[0].position == expected[0].position).all()
    assert (found[0].intensity == expected[0].intensity).all()
    assert found[1] == expected[1]  # every number of a SamplingCount, sums of lengths included


@pytest.mark.parametrize("name", PRESETS)
def test_blocks_of_any_size_give_the_same_points_and_counts(name):
    batch, pose, time = motion_of(scene())
    expected = sampled([batch], pose, time, strategy_of(name), 1 << 20)
    assert expected[1].held > 0
    assert expected[1].silent > 0
    for block in (1024, 97, 13):
        assert_same(sampled([batch], pose, time, strategy_of(name), block), expected)


@pytest.mark.exhaustive
@pytest.mark.parametrize("continuity", ["nearest", "jump", "finish"])
@pytest.mark.parametrize("name", PRESETS)
def test_single_samples_and_random_cuts_give_the_same_points_and_counts(name, continuity):
    batch, pose, time = motion_of(scene(), TIME + 1e-3 / 3 * np.arange(len(TIME)))
    strategy = strategy_of(name, continuity=continuity)
    expected = sampled([batch], pose, time, strategy, 1 << 20)
    for block in (1, 2, 7, 100, 333, 1000, 1024, 4096):
        assert_same(sampled([batch], pose, time, strategy, block), expected)
    rng = np.random.default_rng(len(name))
    for _ in range(4):
        cuts = [0, *np.sort(rng.integers(0, len(time) + 1, 3)).tolist(), len(time)]
        parts = [batch.select(a, b) for a, b in pairwise(cuts)]
        assert_same(sampled(parts, pose, time, strategy, int(rng.integers(1, 500))), expected)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", PRESETS)
def test_the_device_gives_the_same_points_and_counts_as_any_block(name, device):
    """Alone, and as one of three motions in a call; small circles differ by rounding, and so may lengths."""
    batch, pose, time = motion_of(scene())
    strategy = strategy_of(name)
    expected = sampled([batch], pose, time, strategy, 61)
    thrice = [batch] * 3, np.tile(pose, (3, 1)), np.tile(time, 3), 7 * np.arange(4), np.full(3, DURATION)
    samples = sample_motions(*thrice, strategy, hold=np.full(3, 0.0301), device=device)
    for motion in range(3):
        focus, count = samples.focus(motion), samples.counts[motion]
        if strategy.lm is None:
            assert_same((focus, count), expected)
        assert np.abs(focus.position - expected[0].position).max() <= 1e-7
        assert (focus.intensity == expected[0].intensity).all()
        assert (count.silent, count.held, count.jumps) == (expected[1].silent, expected[1].held, expected[1].jumps)


@pytest.mark.parametrize("kind", ["step", "random"])
@pytest.mark.parametrize("length", [0.056, 0.28])
def test_points_that_come_back_after_dark_ones_are_re_entries_wherever_a_block_begins(kind, length):
    """40 points a cycle on a ring of this length, of which those on one half are dark; 30 cycles at 7 m/s.

    So the count is that of an order of integers: each time that a bright point follows a dark one, except at the very
    first sample. The way is the chord between the two.
    """
    ring = circle(length / (160 * np.sin(np.pi / 80)), count=80)
    bright = np.arange(81) % 80 < 40.5
    batch = replace(batch_of([[(ring, True)]]), intensity=np.float32(bright))
    order = 3 * np.arange(40) % 40 if kind == "step" else np.random.default_rng(0).permutation(40)
    shown = 2 * np.tile(order, 30)
    back = np.flatnonzero(bright[shown[1:]] & ~bright[shown[:-1]])
    way = np.linalg.norm(ring[shown[back + 1]] - ring[shown[back]], axis=1)
    hops = way[(way > 2 * 7e-4) & (way <= 5e-3)]
    assert len(hops) + np.count_nonzero(way > 5e-3) == len(way) >= 30
    for block in (1024, 7):
        sampler = Sampler(preset(kind))
        list(sample_contours([batch], still(1), np.zeros(1), 30 * length / 7, sampler, block=block))
        count = sampler.count
        assert (count.jumps["re-entry"], count.hops["re-entry"]) == (len(way) - len(hops), len(hops))
        assert count.jump_lengths["re-entry"] == pytest.approx(way[way > 5e-3].sum(), rel=1e-5)
        assert count.hops_longest["re-entry"] == pytest.approx(hops.max(initial=0.0), abs=1e-7)


@pytest.mark.parametrize("block", [7, 100, 1024])
def test_a_pose_is_held_and_silent_for_exactly_the_samples_that_its_times_give(block):
    """A pose at 0.1 s, held for 0.2 s, that fades for 0.1 s: ages of whole samples, of which 0.1 + 0.2 is none.

    Samples 3001..4999 are older than `hold`, and from 4000 on nothing is left, at 10 kHz.
    """
    ring = [(circle(0.03), True)]
    sampler = Sampler(SamplingStrategy(hold=0.2, fade=0.1))
    time = np.array([0.0, 0.1])
    focus = joined(list(sample_contours([batch_of([ring] * 2)], still(2), time, 0.5, sampler, block=block, hold=0.2)))
    assert (sampler.count.held, sampler.count.silent) == (1999, 1000)
    expected = np.clip(1 - (np.arange(5000) - 3000) / 1000, 0, 1)
    assert (focus.intensity == expected.astype(np.float32)).all()
