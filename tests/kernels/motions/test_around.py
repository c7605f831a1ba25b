"""Poses on splines: the float64 model's, rounded to float32, of motions in any company."""

import numpy as np
from exploration_models import around as around_model

from palpate.kernels.motions.around import place_on_splines

BOX = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
INTERVAL = around_model.INTERVAL


def controls(seeds, ends):
    """Control points of each seed up to a time [s]."""
    made = zip(seeds, ends, strict=True)
    return [around_model.control_points(BOX, np.random.default_rng(k), int(end / INTERVAL) + 4) for k, end in made]


def placed(control, rate, first, count, device):
    """Poses first..first + count of each motion."""
    position, quaternion = (np.concatenate(values) for values in zip(*control, strict=True))
    turn = np.concatenate([around_model.turns_between(quaternion), np.zeros((1, 3))])
    start = np.cumsum([0, *(len(own.position) for own in control)])
    ranges = list(zip(start.tolist(), rate, first, strict=False))
    bounds = np.cumsum([0, *count])
    return place_on_splines(position, quaternion, turn, ranges, bounds, interval=INTERVAL, device=device).numpy()


def test_poses_are_those_of_the_model_rounded_once(device):
    """A number may be rounded the other way only where it lies halfway, within 1e-14, between two of float32."""
    rate, first, count = np.array([90.0, 90.0, 7.3, 4e4]), np.array([0, 500, 3, 100]), [15_000, 2200, 150, 8_000]
    control = controls([1, 2, 3, 4], (first + count) / rate)
    pose = placed(control, rate, first, count, device)
    wanted = np.concatenate(
        [around_model.spline(control[k], (first[k] + np.arange(count[k])) / rate[k]) for k in range(4)]
    )
    assert (np.abs(pose - wanted) <= 0.5 * np.spacing(np.abs(wanted).astype(np.float32)) + 1e-14).all()
    assert np.count_nonzero(pose != wanted.astype(np.float32)) < 3


def test_a_hand_at_rest_stays_where_it_is(device):
    quaternion = np.tile([0.5, -0.5, 0.5, 0.5], (6, 1))
    still = around_model.Stroke(np.full((6, 3), 0.1), quaternion)
    pose = placed([still], np.array([10.0]), np.array([0]), [2], device)
    np.testing.assert_array_equal(pose, np.tile(np.float32([0.1, 0.1, 0.1, 0.5, -0.5, 0.5, 0.5]), (2, 1)))


def test_no_pose_is_none(device):
    assert len(placed(controls([1], [1.0]), np.array([90.0]), np.array([0]), [0], device)) == 0
