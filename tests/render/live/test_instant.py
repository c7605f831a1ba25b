"""One pose at a time: the contours of `render` and the focal points of `sample_contours`, to the bit."""

import functools
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mesh_cases import MESHES, generic_poses

from palpate.datasets import HandMotion
from palpate.datasets.errors import MotionError
from palpate.datasets.motions.hand_motion import PALM_DOWN
from palpate.render import (
    MeshObject,
    Palm,
    closed_contour,
    exploration,
    flat_hand,
    load_strategy,
    open_contour,
    render,
)
from palpate.render.errors import MeshError, PoseError, StrategyError
from palpate.render.hands.plane_hand import HandPatch, PlaneHand
from palpate.render.intersection.named_inputs import motion_of
from palpate.render.live.instant import DRAWN_MOST, Instant, checked_pose
from palpate.render.sampling.sampler import Sampler, sample_bounds, sample_contours
from palpate.render.sampling.strategy import AmplitudeModulation, LateralModulation, SamplingStrategy

PALM = Palm(0.085, 0.06)
NEAR = np.array([0.0, 0.0, 0.2, *PALM_DOWN])
FAR = np.array([0.0, 0.0, 0.9, *PALM_DOWN])


@functools.cache
def thing_of(name):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # odd meshes are mended
        return MeshObject(*MESHES[name](), name=name)


@functools.cache
def motion_on(name):
    """Two seconds of a hasty hand: contours, their loss and their return."""
    motion = exploration(thing_of(name).bounds, duration=20.0, rate=9.0, seed=1)
    return HandMotion(motion.time / 10.0, motion.pose)


def assert_same_focus(one, two):
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b, strict=True)


def joined(blocks):
    return [np.concatenate(parts) for parts in zip(*blocks, strict=True)]


SAMPLINGS = {
    "default": SamplingStrategy(),
    "40 kHz": SamplingStrategy(update_rate=40_000.0),
    "three foci, modulated": SamplingStrategy(foci=3, am=AmplitudeModulation()),
    "circles, restarting": SamplingStrategy(lm=LateralModulation(), continuity="jump"),
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("sampling", SAMPLINGS.values(), ids=SAMPLINGS)
@pytest.mark.parametrize("name", ["tube", "dog"])
def test_focal_points_are_those_of_sample_contours_bit_for_bit(name, sampling):
    motion = motion_on(name)
    assert_as_sampled(thing_of(name), motion.pose, motion.time, 2.0, sampling)


@pytest.mark.parametrize("fade", [0.0, 0.02])
def test_irregular_and_missing_poses_are_held_and_faded_as_in_sample_contours(fade):
    motion = motion_on("tube")
    rng = np.random.default_rng(7)
    kept = np.sort(rng.choice(len(motion.pose), 60, replace=False))
    kept = kept[(motion.time[kept] < 0.9) | (motion.time[kept] > 1.45)]  # more than a block
    time = motion.time[kept] + rng.uniform(0, 0.01, len(kept))
    sampling = SamplingStrategy(update_rate=40_000, hold=0.05, fade=fade)
    count = assert_as_sampled(thing_of("tube"), motion.pose[kept], time - time[0], 2.0, sampling)
    assert count.held > 100


def assert_as_sampled(thing, pose, time, duration, sampling):
    """Instant and `sample_contours` agree in all bits and counts, from whatever time on the clock starts."""
    sampler = Sampler(sampling, revisits=False)
    batch = render(thing, PALM, pose, closed_contour())
    expected = joined(sample_contours([batch], pose, time, duration, sampler))
    instant = Instant(thing, PALM, closed_contour(), sampling, interval=float(np.median(np.diff(time))))
    until = np.append(time[1:], duration)
    blocks = [instant.draw(*args[:2], until=args[2]) for args in zip(pose, time, until, strict=True)]
    assert_same_focus(joined(blocks), expected)
    assert instant.sampler.count == sampler.count
    assert sampler.count.samples > sampler.count.silent > 0
    return sampler.count


@pytest.mark.parametrize("articulated", [False, True])
@pytest.mark.parametrize(("hand", "strategy"), [("planes", "cc"), ("planes", "pauses"), ("palm", "pauses")])
def test_stages_behind_kept_contours_give_the_focal_points_of_sample_contours(hand, strategy, articulated):
    """Contours of stages come in new arrays at each pose, with pauses and intensities that raw contours lack."""
    if hand == "palm" and articulated:
        pytest.skip("a palm has no patches that move")
    chosen = closed_contour() if strategy == "cc" else load_strategy("corner-pauses")
    whole, motion = flat_hand() if hand == "planes" else PALM, motion_on("tube")
    pose, time = motion.pose[20:50], motion.time[20:50] - motion.time[20]
    own = np.tile([patch.pose for patch in whole.patches], (30, 1, 1)) if articulated else None
    if articulated:
        own[:, 3, :3] += 0.004 * np.sin(np.arange(30))[:, None]  # a finger that moves
        whole = replace(whole, patch_pose=own)
    sampler = Sampler("stm", revisits=False)
    batch = render(thing_of("tube"), whole, pose, chosen)
    expected = joined(list(sample_contours([batch], pose, time, 0.4, sampler, hold=0.1)))
    instant = Instant(thing_of("tube"), whole, chosen, "stm")
    patches = [None] * 30 if own is None else own
    until = np.append(time[1:], 0.4)
    blocks = [instant.draw(p, t, until=u, patch_pose=q) for p, t, u, q in zip(pose, time, until, patches, strict=True)]
    assert_same_focus(joined(blocks), expected)
    assert instant.sampler.count == sampler.count
    assert sampler.count.drawn > 1000


@given(
    gaps=st.lists(st.floats(1e-4, 0.06), min_size=1, max_size=5),
    aheads=st.lists(st.floats(0.0, 0.03), min_size=5, max_size=5),
)
@settings(max_examples=5)
@example(gaps=[0.02, 0.005, 0.01], aheads=[0.0, 0.01, 0.0, 0.01])
def test_what_was_not_drawn_before_a_pose_is_drawn_from_the_one_before_it(gaps, aheads):
    """Poses come `gaps` [s] apart, each is drawn for `aheads` [s], and what is left then is drawn from it as well."""
    time = np.concatenate([[0.0], np.cumsum(gaps)])
    late, own = (Instant(thing_of("tube"), PALM, open_contour()) for _ in range(2))
    count = 0
    for i, now in enumerate(time):
        pose, until = motion_on("tube").pose[5 + i], now + aheads[i % len(aheads)]
        focus = late.draw(pose, now, until=until)
        count = max(count, sample_bounds(np.array([0.0]), until, 10_000.0)[1])
        before = [own.go_on(now)] if i else []
        assert_same_focus(focus, joined([*before, own.draw(pose, now, until=until)]))
        assert late.sampler.count.samples == own.sampler.count.samples == count


def test_going_on_holds_the_last_pose_and_then_fades():
    instant = Instant(thing_of("tube"), PALM, closed_contour(), SamplingStrategy(hold=0.1, fade=0.02))
    assert (instant.draw(NEAR, 5.0).intensity == 1).all()
    more = joined([instant.go_on(5.0 + 0.05 * k) for k in range(1, 5)])
    assert len(more[0]) == 2000 - 112
    assert more[1][1000 - 112] == 1
    assert (np.diff(more[1][1001 - 112 : 1200 - 112]) < 0).all()
    assert (more[1][1200 - 112 :] == 0).all()


BAD_POSES = {
    "infinite": NEAR * [1, 1, np.inf, 1, 1, 1, 1],
    "beyond float32": NEAR * [1, 1, 1e40, 1, 1, 1, 1],
    "norm": NEAR * [1, 1, 1, 1.0011, 1.0011, 1.0011, 1.0011],
}


def test_bad_poses_are_refused_as_by_render_and_change_nothing():
    instant, other = (Instant(thing_of("tube"), PALM, closed_contour()) for _ in range(2))
    for turn, (name, pose) in enumerate(BAD_POSES.items()):
        with pytest.raises(MotionError) as by_render:
            render(thing_of("tube"), PALM, pose[None], closed_contour())
        with pytest.raises(MotionError) as refused:
            instant.draw(pose, 0.5 * turn)
        assert str(refused.value) == str(by_render.value), name
        assert_same_focus(instant.draw(NEAR, turn), other.draw(NEAR, turn))
    for pose in (NEAR[:6], NEAR[None], ["a"] * 7, None, [[1, 2], 3]):
        with pytest.raises(PoseError, match="seven numbers"):
            instant.draw(pose, 100.0)


@given(error=st.floats(-1e-3, 1e-3), scale=st.sampled_from([1.0, 1e-3, 1e-4]), seed=st.integers(0, 1000))
def test_quaternions_are_normalised_as_by_render(error, scale, seed):
    pose = generic_poses(1, seed)[0].astype(np.float64)
    pose[3:] *= (1 + 0.999 * error * scale) / np.linalg.norm(pose[3:])
    np.testing.assert_array_equal(checked_pose(pose), motion_of(pose[None]).pose[0], strict=True)


def test_impossible_times_are_refused_and_change_nothing():
    instant, other = (Instant(thing_of("tube"), PALM, closed_contour()) for _ in range(2))
    assert_same_focus(instant.draw(NEAR, 1.0), other.draw(NEAR, 1.0))
    for time, until, message in (
        (1.0, None, r"time 1\.0 s is not after 1\.0 s"),
        (0.5, None, r"time 0\.5 s is not after 1\.0 s"),
        (np.nan, None, "nan"),
        (np.inf, None, "inf"),
        (2.0, 1.9, r"until 1\.9 s is before 2\.0 s"),
        (2.0, np.nan, "nan s is not finite"),
        (2.0, np.inf, "inf s is not finite"),
        (1.1 + 2 * DRAWN_MOST, None, r"more than 10 s after 1\.01"),
        (2.0, 1.1 + DRAWN_MOST, r"time 11\.1 s is more than 10 s"),
    ):
        with pytest.raises(MotionError, match=message):
            instant.draw(FAR, time, until=until)
    assert_same_focus(instant.draw(NEAR, 1.01), other.draw(NEAR, 1.01))


def test_impossible_intervals_and_closed_contours_of_an_open_mesh_are_refused_when_made():
    for interval in (0.0, -1.0, np.nan, 5.1):
        with pytest.raises(StrategyError, match=rf"0\.0001\.\.5 s, not {interval}"):
            Instant(thing_of("tube"), PALM, closed_contour(), interval=interval)
    with pytest.raises(MeshError, match="open edges"):
        Instant(thing_of("bowl"), PALM, closed_contour())


TWO_PALMS = PlaneHand((HandPatch("palm", 0.085, 0.085), HandPatch("over", 0.03, 0.1, (0.02, 0.015, -0.01, 0, 0, 0, 1))))


def test_patch_poses_that_are_refused_leave_what_was_not_drawn_yet_to_the_next_pose():
    rest = np.array([patch.pose for patch in TWO_PALMS.patches], np.float32)
    hand = replace(TWO_PALMS, patch_pose=rest[None])
    instant, other = (Instant(thing_of("tube"), hand, closed_contour()) for _ in range(2))
    for one in (instant, other):
        one.draw(NEAR, 0.0, until=0.01, patch_pose=rest)
    for wrong in (None, rest[:1], 2 * rest):
        with pytest.raises(PoseError):
            instant.draw(NEAR, 0.02, until=0.03, patch_pose=wrong)
    drawn, expected = (one.draw(NEAR, 0.03, until=0.04, patch_pose=rest) for one in (instant, other))
    assert len(drawn.position) == 300
    np.testing.assert_array_equal(drawn.position, expected.position)
