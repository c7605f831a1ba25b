"""Focal points and counts depend on no buffer: any cutting of a motion into spans, batches and blocks gives the same.

The scene holds what a cut could divide: contours that are partly dark, pauses, a missing pose that fades, a silence.
"""

from dataclasses import replace
from itertools import cycle, pairwise

import numpy as np
import pytest
from contour_shapes import batch_of, circle, square, still
from hypothesis import given, settings
from hypothesis import strategies as st
from sampling_cases import Motion, drawn_in_spans, random_motion, random_strategy

from palpate.render.errors import StrategyError
from palpate.render.sampling.metrics import FocalPoints, dwell_map
from palpate.render.sampling.presets import PRESETS, preset
from palpate.render.sampling.sampler import Sampler, age_at, joined, sample_bounds, sample_contours, sample_motions
from palpate.render.sampling.strategy import Order, SamplingStrategy

TIME = np.array([0.0, 0.0137, 0.0211, 0.0412, 0.1537, 0.1612, 0.1701])  # the fourth lasts for more than a block
DURATION, HOLD = 0.1853, 0.0301
NOTHING = FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))


def scene():
    """Seven poses: rings with dark halves and pauses, a square, none, the square again, and rings elsewhere."""
    rings = [(circle(0.01, (x, 0, 0.2), 48), True) for x in (-0.015, 0.0, 0.018)]
    line = ([[-0.02, 0.03, 0.2], [0.0, 0.034, 0.2], [0.02, 0.03, 0.2]], False)
    ring = [(circle(0.02, (0.004, 0, 0.2), 48), True), line]
    batch = batch_of([rings, ring, [(square(0.03), True)], [*rings, line], [], [(square(0.03), True)], ring])
    dark = batch.points[:, 0] * batch.points[:, 1] < 1e-5  # opposite quarters: of a ring, its ends agree
    corner = np.abs(batch.points[:, 0]) > 0.0195
    batch = replace(batch, intensity=np.float32(~dark), dwell=np.float32(0.0007 * corner))
    pose = still(7)
    pose[:, 0] += 1e-3 * np.arange(7)
    return Motion(batch, pose, TIME, DURATION, HOLD)


def together(blocks):
    """Focal points of all blocks that have some."""
    return joined([block for block in blocks if len(block.position)] or [NOTHING])


def sampled(motion, strategy, span=1 << 20, cuts=(), device="cpu"):
    """Focal points and counts of a motion whose contours come in batches that are cut at these poses."""
    sampler = Sampler(strategy, device=device)
    batches = [motion.batch.select(a, b) for a, b in pairwise([0, *cuts, len(motion.time)])]
    rows = motion.pose, motion.time, motion.duration
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("palpate.render.sampling.sampler.SPAN_SAMPLES", span)
        blocks = list(sample_contours(batches, *rows, sampler, hold=motion.hold))
    return together(blocks), sampler.count


def drawn(motion, strategy, most):
    """The same by `draw`, in blocks of 1, 2 .. `most` samples, 1 again and so on; poses of no sample are drawn too."""
    sampler, rate, blocks, sizes = Sampler(strategy), strategy.update_rate, [], cycle(range(1, most + 1))
    for k, (first, stop) in enumerate(pairwise(sample_bounds(motion.time, motion.duration, rate).tolist())):
        own = motion.batch.select(k, k + 1)
        contours = own if own.polyline_count or k % 2 else None
        if k % 3 == 0:
            sampler.draw(contours, motion.pose[k], 0)  # a pose that is not drawn yet does not go on
        while True:
            count, age = min(next(sizes), stop - first), age_at(first, motion.time[k], rate)
            blocks.append(sampler.draw(contours, motion.pose[k], count, age=age, hold=motion.hold))
            first += count
            if first >= stop:
                break
    return together(blocks), sampler.count


def assert_same(found, expected):
    """Assert that focal points and every number of the counts, sums of lengths included, have the same bits."""
    assert found[0].position.shape == expected[0].position.shape
    assert (found[0].position == expected[0].position).all()
    assert (found[0].intensity == expected[0].intensity).all()
    assert found[1] == expected[1]


@pytest.mark.parametrize("foci", [1, 3])
def test_dwell_maps_of_any_blocks_have_the_same_bits(foci):
    """At 10,001 Hz, of which no sample's time is a binary fraction; times are whole numbers of samples."""
    motion = scene()
    focus, _ = sampled(motion, SamplingStrategy(foci=foci, update_rate=10_001.0))
    pose, bounds = motion.pose, sample_bounds(motion.time, motion.duration, 10_001.0)
    grid = {"width": 0.03, "length": 0.04}  # some is drawn beyond
    expected, shared = dwell_map([focus], pose, bounds, 10_001.0, **grid), foci * 10_001.0
    assert expected.outside > 0
    for time in (expected.time, expected.outside):
        assert (np.rint(time * shared) / shared == time).all()
    for block in (7, 100):
        cuts = range(block, len(focus.intensity), block)
        parts = zip(np.split(focus.position, cuts), np.split(focus.intensity, cuts), strict=True)
        found = dwell_map([FocalPoints(*part) for part in parts], pose, bounds, 10_001.0, **grid)
        assert (found.time == expected.time).all()
        assert (found.spread, found.outside, found.silent) == (expected.spread, expected.outside, expected.silent)


@pytest.mark.parametrize("name", PRESETS)
def test_spans_of_any_length_give_the_same_points_and_counts(name):
    motion, strategy = scene(), preset(name, fade=0.0097)
    expected = sampled(motion, strategy)
    assert expected[1].held > 0
    assert expected[1].silent > 0
    assert_same(sampled(motion, strategy, 97, [3]), expected)
    assert_same(sampled(motion, strategy, 413, [1, 6]), expected)
    assert_same(drawn(motion, strategy, 150), expected)


@pytest.mark.parametrize("name", PRESETS)
def test_whole_motions_in_one_call_and_spans_on_any_device_give_the_same(name, device):
    """Alone, and as one of three motions in a call; sines differ between devices by rounding, and so may lengths."""
    motion, strategy = scene(), preset(name, fade=0.0097)
    expected = sampled(motion, strategy)
    thrice = [motion.batch] * 3, np.tile(motion.pose, (3, 1)), np.tile(motion.time, 3), 7 * np.arange(4), [DURATION] * 3
    samples = sample_motions(*thrice, strategy, hold=np.full(3, HOLD), device=device)
    found = [(samples.focus(k), samples.counts[k]) for k in range(3)]
    for focus, count in [*found, sampled(motion, strategy, 413, device=device)]:
        if device == "cpu" or (strategy.lm is None and strategy.am is None):
            assert_same((focus, count), expected)
        assert np.abs(focus.position - expected[0].position).max() <= 1e-7
        assert np.abs(focus.intensity - expected[0].intensity).max() <= 1e-6
        assert (count.silent, count.held, count.jumps) == (expected[1].silent, expected[1].held, expected[1].jumps)


@pytest.mark.exhaustive
@pytest.mark.parametrize("continuity", ["nearest", "jump"])
@pytest.mark.parametrize("name", PRESETS)
def test_single_samples_and_random_cuts_give_the_same_points_and_counts(name, continuity):
    motion = replace(scene(), time=TIME + 1e-3 / 3 * np.arange(len(TIME)))
    strategy = preset(name, fade=0.0097, continuity=continuity)
    expected = sampled(motion, strategy)
    assert_same(drawn(motion, strategy, 1), expected)
    rng = np.random.default_rng(len(name))
    for span in (7, 100, 333, 1000):
        cuts = np.sort(rng.integers(0, len(motion.time) + 1, 3)).tolist()
        assert_same(sampled(motion, strategy, span, cuts), expected)


@pytest.mark.parametrize("name", ["step", "random", "lm", "am-multi-focus"])
def test_jumps_have_the_same_causes_wherever_a_span_begins(name):
    """A ring that is now here, now there: at a new pose the focal points jump because of it, or because of the order.

    That is found out from where they would be if nothing held, reordered or moved them.
    """
    batch = batch_of([[(circle(0.03, (0.003 * (k % 5), 0, 0.2), 80), True)] for k in range(40)])
    motion = Motion(batch, still(40), np.arange(40) / 90, 40 / 90, np.inf)
    expected = sampled(motion, preset(name))
    assert sum(expected[1].jumps.values()) + sum(expected[1].hops.values()) > 10
    assert_same(sampled(motion, preset(name), 111), expected)


def motions_of(least, most):
    """Motions that all have intensities or none, and pauses or none: as many as one call can take together."""

    def made(seeds, with_intensity, paused):
        rngs = map(np.random.default_rng, seeds)
        return [random_motion(rng, with_intensity=with_intensity, paused=paused) for rng in rngs]

    return st.builds(made, st.lists(st.integers(0, 10**6), min_size=least, max_size=most), st.booleans(), st.booleans())


motions = motions_of(1, 1).map(lambda made: made[0])
strategies = st.integers(0, 10**6).map(lambda seed: random_strategy(np.random.default_rng(seed)))


@settings(max_examples=2)
@given(motion=motions, strategy=strategies, span=st.integers(30, 300), share=st.floats(0, 1))
def test_a_motion_is_the_same_span_by_span_batch_by_batch_and_block_by_block(motion, strategy, span, share):
    expected = sampled(motion, strategy)
    assert_same(sampled(motion, strategy, span, [int(share * len(motion.time))]), expected)
    assert_same(drawn(motion, strategy, span), expected)


def assert_same_side_by_side(sides, strategy, data):
    """Assert that motions in one call are those that each is alone, wherever each is cut."""
    number = data.draw(st.integers(0, 4))
    ends = [int(sample_bounds(motion.time, motion.duration, strategy.update_rate)[-1]) for motion in sides]
    cuts = [sorted(data.draw(st.lists(st.integers(0, end), min_size=number, max_size=number))) for end in ends]
    focus, counts = drawn_in_spans(strategy, sides, cuts)
    for motion, *found in zip(sides, focus, counts, strict=True):
        (alone,), (count,) = drawn_in_spans(strategy, [motion], [[]])
        assert_same(found, (alone, count))


@settings(max_examples=8)
@given(sides=motions_of(1, 3), strategy=strategies, data=st.data())
def test_motions_side_by_side_may_each_be_cut_elsewhere(sides, strategy, data):
    assert_same_side_by_side(sides, strategy, data)


@pytest.mark.exhaustive
@settings(max_examples=300)
@given(sides=motions_of(1, 4), strategy=strategies, data=st.data())
def test_many_motions_side_by_side_may_each_be_cut_elsewhere(sides, strategy, data):
    assert_same_side_by_side(sides, strategy, data)


@pytest.mark.exhaustive
@settings(max_examples=40)
@given(motion=motions, strategy=strategies, span=st.integers(1, 300), share=st.floats(0, 1))
def test_many_motions_are_the_same_span_by_span_batch_by_batch_and_block_by_block(motion, strategy, span, share):
    expected = sampled(motion, strategy)
    assert_same(sampled(motion, strategy, span, [int(share * len(motion.time))]), expected)
    assert_same(drawn(motion, strategy, span), expected)


@pytest.mark.parametrize("kind", ["step", "random"])
@pytest.mark.parametrize("length", [0.056, 0.28])
def test_points_that_come_back_after_dark_ones_are_re_entries_wherever_a_span_begins(kind, length, monkeypatch):
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
    for span in (1 << 16, 70):
        monkeypatch.setattr("palpate.render.sampling.sampler.SPAN_SAMPLES", span)
        sampler = Sampler(preset(kind))
        list(sample_contours([batch], still(1), np.zeros(1), 30 * length / 7, sampler))
        count = sampler.count
        assert (count.jumps["re-entry"], count.hops["re-entry"]) == (len(way) - len(hops), len(hops))
        assert count.jump_lengths["re-entry"] == pytest.approx(way[way > 5e-3].sum(), rel=1e-5)
        assert count.hops_longest["re-entry"] == pytest.approx(hops.max(initial=0.0), abs=1e-7)


@pytest.mark.parametrize("span", [70, 1 << 16])
def test_a_pose_is_held_and_silent_for_exactly_the_samples_that_its_times_give(span):
    """A pose at 0.1 s, held for 0.2 s, that fades for 0.1 s: ages of whole samples, of which 0.1 + 0.2 is none.

    Samples 3001..4999 are older than `hold`, and from 4000 on nothing is left, at 10 kHz.
    """
    motion = Motion(batch_of([[(circle(0.03), True)]] * 2), still(2), np.array([0.0, 0.1]), 0.5, 0.2)
    strategy = SamplingStrategy(hold=0.2, fade=0.1)
    for focus, count in (sampled(motion, strategy, span), drawn(motion, strategy, span)):
        assert (count.held, count.silent) == (1999, 1000)
        expected = np.clip(1 - (np.arange(5000) - 3000) / 1000, 0, 1)
        assert (focus.intensity == expected.astype(np.float32)).all()


def test_blocks_are_as_long_as_asked_for_and_the_last_of_a_batch_is_what_is_left():
    motion = scene()
    rows = motion.pose, motion.time, motion.duration, Sampler("stm")
    batches = [motion.batch.select(0, 4), motion.batch.select(4, 7)]
    sizes = [len(block.position) for block in sample_contours(batches, *rows, block=500)]
    assert sizes == [500, 500, 500, 37, 316]


def passing(share):
    """Four short lines in a row, of which the middle ones change places beside the row."""
    x = (1 - share) * np.array([-0.06, -0.02, 0.02, 0.06]) + share * np.array([-0.06, 0.02, -0.02, 0.06])
    y = 0.02 * np.sin(np.pi * share) * np.array([0, 1, -1, 0])
    return [([[a, b, 0.2], [a, b + 1e-3, 0.2]], False) for a, b in zip(x, y, strict=True)]


@pytest.mark.parametrize("margin", [0.0, 0.2])
def test_another_route_is_taken_at_the_same_pose_wherever_a_span_begins(margin):
    """When it is searched for depends on the shortest route known, and so on all poses before."""
    batch = batch_of([passing(share) for share in np.linspace(0, 1, 60)])
    motion = Motion(batch, still(60), np.arange(60) / 90, 60 / 90, np.inf)
    strategy = SamplingStrategy(order=Order(margin=margin))
    expected = sampled(motion, strategy)
    assert_same(sampled(motion, strategy, 111), expected)
    assert_same(drawn(motion, strategy, 150), expected)


def test_a_pose_of_which_nothing_was_drawn_yet_is_new():
    """Although its contours are as many and as large as those of the pose before."""
    counts = []
    for sizes in ([100], [0, 100]):
        sampler, near, far = Sampler("stm"), batch_of([[RING]]), batch_of([[(RING[0] + [0.1, 0, 0], True)]])
        sampler.draw(near, still(1)[0], 50)
        for size in sizes:
            sampler.draw(far, still(1)[0], size)
        counts.append(sampler.count)
    assert counts[0] == counts[1]
    assert counts[0].jumps["pose"] == 1


RING, ARC = (circle(0.02, count=10), True), (circle(0.02, (0.05, 0, 0.2), 10, 2.0)[:4], False)
DOT = ([[0, 0, 0.2]] * 7, False)


@pytest.mark.parametrize(
    "after", [[RING], [ARC, RING], [(circle(0.02, count=3), True), (circle(0.03, count=9), True)], [DOT, RING, ARC]]
)
@pytest.mark.parametrize("before", [[RING, ARC], [ARC, RING, DOT]])
def test_contours_that_are_not_those_of_before_are_drawn_as_new_ones(before, after):
    """Although the caller says that the pose goes on: pieces of the span before would lie beyond these contours."""
    drawn = []
    for says_so in (0, 1):
        sampler = Sampler("stm")
        for k, lines in enumerate((before, after)):
            span = {"first": [150 * k], "count": [150], "time": [0.0], "hold": [np.inf]}
            batch = batch_of([lines]).to("cpu")
            span |= {"motion_start": [0, 1], "goes_on": [says_so * k]}
            position, intensity = sampler.take(batch, batch.struct, still(1), span)
        drawn.append((FocalPoints(position.numpy()[:150].copy(), intensity.numpy()[:150].copy()), sampler.count))
    assert_same(*drawn)


@pytest.mark.parametrize("lines", [1, 61, 62, 63, 64, 65, 100])
def test_one_polyline_more_is_another_shape_however_many_there_are(lines):
    first, more = (
        batch_of([[([[0.001 * k, 0, 0.2], [0.001 * k, 0.003, 0.2]], False) for k in range(count)]])
        for count in (lines, lines + 1)
    )
    sampler = Sampler(SamplingStrategy(continuity="jump", order=Order(route="given")))
    sampler.draw(first, still(1)[0], 7)
    np.testing.assert_array_equal(sampler.draw(more, still(1)[0], 1).position, more.points[:1])


def test_a_pose_that_other_contours_have_followed_is_drawn_as_a_new_one():
    ring = square(0.04)
    other_start = np.roll(ring, 2, axis=0)  # the same square from its opposite corner
    batch, between = batch_of([[(ring, True)]]), batch_of([[(other_start, True)]])
    sampler, pose = Sampler("stm"), still(1)
    sampler.draw(batch, pose[0], 100)
    (last,) = sample_contours([between], pose, np.zeros(1), 0.01, sampler)
    again = sampler.draw(batch, pose[0], 1)
    assert np.linalg.norm(again.position[0] - last.position[-1]) < 1.01 * sampler.strategy.step


def test_no_contours_behind_kept_ones_are_silent():
    batch, pose, sampler = batch_of([[(square(0.02), True)]]).to("cpu"), still(1)[0], Sampler("stm")
    sampler.draw_struct(batch.struct, 1, pose, 10, age=0.0, hold=np.inf)
    assert not sampler.draw(None, pose, 10).intensity.any()


def test_a_sampler_of_several_motions_draws_no_single_one():
    batch, pose = batch_of([[(square(0.02), True)]]), still(1)
    message = "motion_count must be 1 for what is drawn, but the sampler has 50 motions"
    with pytest.raises(StrategyError, match=message):
        Sampler("stm", motion_count=50).draw(batch, pose[0], 5)
    with pytest.raises(StrategyError, match=message):
        list(sample_contours([batch], pose, np.zeros(1), 0.3, Sampler("stm", motion_count=50)))
