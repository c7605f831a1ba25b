"""Live poses are predicted and smoothed as worked out by hand, by SciPy's rotations and by SciPy's filters."""

import math
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import group_delay, sosfilt, sosfilt_zi
from scipy.spatial.transform import Rotation

from palpate.render.errors import PoseError, StrategyError
from palpate.render.live.sources.shaping import FILTER_RATE, PoseShaping, Prediction, Smoothing

sys.path.insert(0, str(Path(__file__).parents[4] / "benchmarks"))
from live_prediction import measure, recorded_clip

START = np.array([0.01, -0.02, 0.2])  # [m]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
AXES = [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, -0.48, 0.64)]


def irregular(count, rng, longest=0.02):
    """Times of a tracker whose frames come 4 ms to `longest` apart."""
    return np.cumsum(rng.uniform(0.004, longest, count))


def straight(times, velocity):
    """Poses of an upright hand that moves uniformly."""
    return [np.array([*(START + time * np.asarray(velocity)), *UPRIGHT]) for time in times]


def turning(times, speed, tilt):
    """Poses of a hand that turns uniformly about a fixed axis, from an orientation that is not upright."""
    turn = Rotation.from_rotvec(np.outer(times, speed)) * Rotation.from_rotvec(tilt)
    return [np.array([*START, *quaternion]) for quaternion in turn.as_quat()]


def shaped_all(shaping, times, poses):
    return np.array([shaping.shaped(time, pose) for time, pose in zip(times, poses, strict=True)])


def angle_between(a, b):
    """Angle [rad] between the orientations of two poses."""
    return (Rotation.from_quat(a[3:]) * Rotation.from_quat(b[3:]).inv()).magnitude()


@pytest.mark.parametrize("damping", [0.0, 20.0, 300.0])
def test_uniform_movement_is_predicted_by_the_formula_at_irregular_times(damping, rng):
    horizon, velocity = 0.03, np.array([0.3, -0.5, 0.2])
    times = irregular(40, rng)
    shaped = shaped_all(PoseShaping(Prediction(horizon, damping)), times, straight(times, velocity))
    reach = (1 - math.exp(-damping * horizon)) / damping if damping else horizon
    np.testing.assert_allclose(shaped[1:, :3], START + np.outer(times[1:] + reach, velocity), atol=1e-12)
    np.testing.assert_array_equal(shaped[0], straight(times[:1], velocity)[0])
    np.testing.assert_array_equal(shaped[:, 3:], np.tile(UPRIGHT, (40, 1)))


def test_on_a_circle_the_error_is_that_worked_by_hand():
    """One step a apart on a circle, with a horizon of one step: 2 x - x' misses the next point by 2 r (1 - cos a)."""
    step, radius, turn = 0.02, 0.05, 0.3
    times = step * np.arange(12)
    ring = radius * np.column_stack([np.cos(turn * np.arange(13)), np.sin(turn * np.arange(13))])
    poses = [np.array([*point, 0.2, *UPRIGHT]) for point in ring]
    errors = {}
    for name, prediction in (("none", None), ("predicted", Prediction(step, 0.0))):
        shaped = shaped_all(PoseShaping(prediction), times, poses[:-1])
        errors[name] = np.linalg.norm(shaped[1:, :2] - ring[2:], axis=1)
    np.testing.assert_allclose(errors["none"], 2 * radius * math.sin(turn / 2), rtol=1e-12)
    np.testing.assert_allclose(errors["predicted"], 2 * radius * (1 - math.cos(turn)), rtol=1e-10)


@pytest.mark.parametrize("damping", [0.0, 20.0])
@pytest.mark.parametrize("axis", AXES)
def test_uniform_rotation_is_predicted_exactly_but_for_the_damping(axis, damping, rng):
    horizon, speed = 0.03, 6.0 * np.array(axis)
    times = irregular(40, rng)
    prediction = Prediction(horizon, damping)
    shaped = shaped_all(PoseShaping(prediction), times, turning(times, speed, [0.4, -1.0, 0.7]))
    later = turning(times + horizon, speed, [0.4, -1.0, 0.7])
    error = [angle_between(a, b) for a, b in zip(shaped[1:], later[1:], strict=True)]
    np.testing.assert_allclose(error, 6.0 * (horizon - prediction.reach(horizon)), atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(shaped[:, 3:], axis=1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(shaped[:, :3], np.tile(START, (40, 1)))


def test_the_velocity_is_that_of_the_last_25_ms():
    """A hand that stops is predicted to rest once its last 25 ms are those of a hand at rest."""
    times = 0.01 * np.arange(20)
    stopped = np.minimum(times, 0.1)
    poses = [np.array([0.5 * time, 0, 0.2, *UPRIGHT]) for time in stopped]
    moved = shaped_all(PoseShaping(Prediction(0.02, 0.0)), times, poses)[:, 0] - 0.5 * stopped
    assert (moved[1:12] > 1e-3).all()
    np.testing.assert_array_equal(moved[13:], 0.0)


@pytest.mark.parametrize(
    ("time", "change"),
    [
        (0.101, [0, 0, 0]),
        (0.25, [0, 0, 0]),
        (0.11, [0.03, 0, 0]),
        (0.05, [0, 0, 0]),
        (0.1, [0, 0, 0]),
        (0.11, "turned"),
    ],
    ids=["control", "a gap", "a jump", "the clock went back", "the same time", "a jump of the orientation"],
)
@pytest.mark.parametrize("smoothing", [None, Smoothing()], ids=["predicted", "smoothed, too"])
def test_after_a_gap_a_jump_or_a_clock_that_went_back_shaping_begins_anew(time, change, smoothing):
    shaping = PoseShaping(Prediction(0.02, 0.0), smoothing)
    times = 0.01 * np.arange(11)
    shaped_all(shaping, times, straight(times, [0.4, 0, 0]))
    pose = straight([0.1], [0.4, 0, 0])[0]
    if isinstance(change, str):
        pose[3:] = Rotation.from_rotvec([0, 0.3, 0]).as_quat()
    else:
        pose[:3] += change
    if time == 0.101:
        assert np.abs(shaping.shaped(time, pose) - pose).max() > 1e-3
        return
    np.testing.assert_allclose(shaping.shaped(time, pose), pose, atol=1e-15)
    np.testing.assert_allclose(shaping.shaped(time + 0.01, pose), pose, atol=1e-15)


def test_reset_forgets_all_poses():
    shaping = PoseShaping(Prediction(), Smoothing())
    times = irregular(10, np.random.default_rng(1))
    poses = straight(times, [0.4, 0.1, 0])
    first = shaped_all(shaping, times, poses)
    shaping.reset()
    np.testing.assert_array_equal(shaped_all(shaping, times, poses), first)


def test_a_fast_hand_is_predicted_no_further_than_5_cm_and_30_degrees():
    shaping = PoseShaping(Prediction(0.1, 0.0))
    times = 0.01 * np.arange(4)
    turn = Rotation.from_rotvec(np.outer(times, [0, 19.0, 0])).as_quat()
    poses = [np.array([1.9 * time, 0, 0.2, *q]) for time, q in zip(times, turn, strict=True)]
    shaped = shaped_all(shaping, times, poses)
    for pose, row in zip(poses[1:], shaped[1:], strict=True):
        np.testing.assert_allclose(row[:3] - pose[:3], [0.05, 0, 0], atol=1e-12)
        away = Rotation.from_quat(row[3:]) * Rotation.from_quat(pose[3:]).inv()
        np.testing.assert_allclose(away.as_rotvec(), [0, math.radians(30), 0], atol=1e-9)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    horizon=st.floats(0, 0.1),
    damping=st.floats(0, 1000),
    cutoff=st.none() | st.floats(1, 100),
    order=st.integers(1, 4),
    size=st.sampled_from([1e-4, 0.01, 0.1, 10.0]),
)
def test_no_pose_is_shaped_further_than_the_bounds_whatever_comes(seed, horizon, damping, cutoff, order, size):
    rng = np.random.default_rng(seed)
    shaping = PoseShaping(Prediction(horizon, damping), None if cutoff is None else Smoothing(cutoff, order))
    times = np.cumsum(rng.choice([-0.01, 1e-5, 0.001, 0.01, 0.09, 0.3], 20, p=[0.05, 0.15, 0.2, 0.4, 0.15, 0.05]))
    steps = Rotation.from_rotvec(rng.normal(scale=min(20 * size, 2.0), size=(20, 3)))
    place, turn = np.zeros(3), Rotation.identity()
    for time, step in zip(times, steps, strict=True):
        place, turn = place + rng.normal(scale=size, size=3), step * turn
        pose = np.array([*place, *(turn.as_quat() * rng.choice([-1.0, 1.0]))])
        row = shaping.shaped(float(time), pose)
        assert np.linalg.norm(row[:3] - pose[:3]) <= 0.05 + 1e-9
        assert angle_between(row, pose) <= math.radians(30) + 1e-9
        assert np.linalg.norm(row[3:]) == pytest.approx(1, abs=1e-9)


def test_a_quaternion_and_its_opposite_are_shaped_to_the_same_rotation(rng):
    times = irregular(60, rng)
    poses = turning(times, [2.0, 3.0, -1.0], [0.4, -1.0, 0.7])
    signs = rng.choice([-1, 1], 60)
    flipped = [np.array([*pose[:3], *(pose[3:] * sign)]) for pose, sign in zip(poses, signs, strict=True)]
    a, b = (shaped_all(PoseShaping(Prediction(), Smoothing()), times, rows) for rows in (poses, flipped))
    assert max(angle_between(*pair) for pair in zip(a, b, strict=True)) < 1e-7


@pytest.mark.parametrize(("order", "cutoff"), [(1, 15.0), (2, 3.0), (4, 100.0)])
def test_the_stated_delay_is_that_of_scipy_and_of_a_steady_movement(order, cutoff):
    smoothing = Smoothing(cutoff, order)
    pairs = [(section[:3], section[3:]) for section in smoothing.sections]
    samples = sum(group_delay(pair, w=[0.01 * cutoff], fs=FILTER_RATE)[1][0] for pair in pairs)
    assert smoothing.delay == pytest.approx(samples / FILTER_RATE, rel=1e-3)
    times = np.cumsum(np.tile([0.01, 0.005, 0.02, 0.0085], 40 if cutoff == 3.0 else 15))
    shaping = PoseShaping(smoothing=smoothing)
    poses = straight(times, [0.01, 0, 0])
    late = (poses[-1] - shaped_all(shaping, times, poses)[-1])[0] / 0.01
    assert late == pytest.approx(smoothing.delay, rel=0.01)


@pytest.mark.parametrize("order", [1, 4])
def test_smoothing_is_scipys_filter_run_on_the_line_between_poses(order, rng):
    smoothing = Smoothing(12.0, order)
    counts = rng.integers(8, 40, 30)
    times = np.cumsum(counts) / FILTER_RATE
    places = 0.001 * rng.normal(size=(30, 3))
    shaped = shaped_all(PoseShaping(smoothing=smoothing), times, [np.array([*place, *UPRIGHT]) for place in places])
    line = np.concatenate(
        [np.linspace(a, b, n + 1)[1:] for (a, b), n in zip(pairwise(places), counts[1:], strict=True)]
    )
    state = sosfilt_zi(smoothing.sections)[:, None] * places[0][None, :, None]
    expected, _ = sosfilt(smoothing.sections, line.T, zi=state)
    np.testing.assert_allclose(shaped[1:, :3], expected.T[np.cumsum(counts[1:]) - 1], atol=1e-14)


def test_prediction_reaches_over_the_delay_of_the_smoothing():
    """Of a steady movement the smoothed pose lags by the delay, so the two together are at the horizon."""
    times = 0.01 * np.arange(100)
    shaping = PoseShaping(Prediction(0.02, 0.0), Smoothing())
    shaped = shaped_all(shaping, times, straight(times, [0.3, 0, -0.1]))
    np.testing.assert_allclose(shaped[60:, :3], START + np.outer(times[60:] + 0.02, [0.3, 0, -0.1]), atol=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Prediction(horizon=0.2), r"prediction.horizon must lie in 0..0.1 s, not 0.2"),
        (lambda: Prediction(damping=-1.0), r"prediction.damping must lie in 0..1000 1/s, not -1"),
        (lambda: Smoothing(cutoff=0.5), r"smoothing.cutoff must lie in 1..100 Hz, not 0.5"),
    ],
)
def test_options_out_of_their_range_are_refused_with_value_and_bound(make, message):
    with pytest.raises(StrategyError, match=message):
        make()


@pytest.mark.parametrize(
    ("time", "pose", "message"),
    [
        (0.02, [0, 0, 0.2], r"pose must have shape \[7\].*, not \[3\]"),
        (0.02, "palm", r"pose must be seven numbers .*, not 'palm'"),
        (0.02, [0, 0, math.nan, *UPRIGHT], r"time and pose must be finite, not 0.02 s and \[0.0, 0.0, nan"),
        (math.inf, [0, 0, 0.2, *UPRIGHT], r"time and pose must be finite, not inf s"),
        (0.02, [0, 0, 0.2, 0, 0, 0, 0], r"quaternion norm 0; it must be 1 within 0.001"),
    ],
)
def test_a_refused_pose_changes_nothing(time, pose, message):
    shaping, other = (PoseShaping(Prediction(), Smoothing()) for _ in range(2))
    first = straight([0.0, 0.01], [0.4, 0, 0])
    for own in (shaping, other):
        shaped_all(own, [0.0, 0.01], first)
    with pytest.raises(PoseError, match=message):
        shaping.shaped(time, pose)
    later = straight([0.02], [0.4, 0, 0])[0]
    np.testing.assert_array_equal(shaping.shaped(0.02, later), other.shaped(0.02, later))


@pytest.mark.parametrize("name", ["HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards"])
def test_damped_prediction_is_nearer_to_recorded_palms_than_none(name, outside_data):
    """At a horizon of 20 ms and 90 poses a second, by the rms of positions and of orientations."""
    clip = recorded_clip(outside_data / "leap" / f"{name}.npz")
    shapings = PoseShaping(), PoseShaping(Prediction(0.02))
    none, damped = (measure([clip], shaping, 0.02, 90.0).figures for shaping in shapings)
    assert damped[0] < 0.8 * none[0]
    assert damped[2] < 0.95 * none[2]
