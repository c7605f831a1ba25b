"""Explorations over an array, made on a device: the poses of the model, bit for bit, in any company."""

import numpy as np
import pytest
import warp as wp
from exploration_models import over_array as over_array_model

from palpate.kernels.motions.over_array import bell, place_explorers, trials_of, uniform, vec2ul
from palpate.kernels.patch import EXACT

wp.set_module_options(EXACT)

WORKSPACE = ((-0.125, -0.125, 0.135), (0.125, 0.125, 0.325))
WIDE = ((-0.3, -0.2, 0.06), (0.2, 0.35, 0.5))


def trial(explorer=1, seed=1, stop=900, *, first=0, rate=90.0, facing=np.pi / 3, workspace=WORKSPACE):
    """One of 140 persons, whose habits are within those of `explorer_habits`."""
    return {
        "explorer": explorer, "seed": seed, "first": first, "stop": stop, "rate": rate, "facing": facing,
        "yaw": 0.2 * (explorer % 7 - 3), "pitch": 0.1 * (explorer % 5 - 2), "roll": 0.07 * (explorer % 4 - 2),
        "speed": 0.07 + 0.03 * (explorer % 7), "pause_share": 0.2 + 0.1 * (explorer % 5), "side": explorer % 4,
        "workspace": np.array(workspace),
    }  # fmt: skip


def poses_of(trials, device):
    return place_explorers(trials_of(trials), device=device).numpy()


def modelled(trials):
    return np.concatenate([over_array_model.poses_of(one) for one in trials]).astype(np.float32)


def test_every_bit_is_that_of_the_model(device):
    trials = [trial(k, 7 * k + 1, 700, facing=(1.047, 0.3, 1.5)[k % 3]) for k in range(1, 7)]
    trials += [trial(2**63 - 1, 2**63 - 1, 500, workspace=WIDE), trial(3, 0, 4000, first=3990, rate=1000.0)]
    trials += [trial(4, 5, 40, rate=0.37), trial(5, 5, 1), trial(6, 6, 5_000, first=4_900)]
    np.testing.assert_array_equal(poses_of(trials, device), modelled(trials))


@pytest.mark.exhaustive
def test_every_bit_of_a_million_poses(device):
    trials = [trial(k, k, 27_000, facing=(1.047, 0.1, 1.5)[k % 3]) for k in range(40)]
    np.testing.assert_array_equal(poses_of(trials, device), modelled(trials))


def test_visits_enter_from_above_and_the_sides_mostly_the_preferred_one():
    for explorer in range(1, 5):
        own, (low, high) = trial(explorer), np.array(WORKSPACE)
        place = np.array([over_array_model.waypoint(own, visit, 0)[0] for visit in range(120)])
        ends = ((2, high), (1, low), (0, low), (0, high))  # above, front, left, right
        sides = np.array([np.isclose(place[:, axis], end[axis], atol=2e-3) for axis, end in ends])
        assert sides.any(axis=0).all()
        assert np.argmax(sides.sum(axis=1)) == own["side"]
        assert sides.mean(axis=1).min() > 0.08


@wp.kernel
def _draw(
    # In:
    keys: wp.array[vec2ul],
    counter: wp.array2d[wp.int64],
    # Out:
    four: wp.array[wp.vec4d],
    one: wp.array[wp.float64],
):
    """Four uniform numbers and one bell-shaped."""
    i = wp.tid()
    second = int(counter[i, 1])
    third = int(counter[i, 2])
    four[i] = uniform(keys[i], counter[i, 0], second, third, int(counter[i, 3]))
    one[i] = bell(keys[i], counter[i, 0], second, third)


def test_random_numbers_are_those_of_numpys_philox(device, rng):
    count = 150
    keys = rng.integers(0, 2**64, (count, 2), dtype=np.uint64)
    counter = np.column_stack([rng.integers(0, 2**62, count), rng.integers(0, 2**31, (count, 3))])
    counter[0] = 0
    four, one = wp.zeros(count, wp.vec4d, device=device), wp.zeros(count, wp.float64, device=device)
    inputs = [wp.array(keys, dtype=vec2ul, device=device), wp.array(counter, dtype=wp.int64, device=device)]
    wp.launch(_draw, count, inputs=inputs, outputs=[four, one], device=device)
    for key, words, numbers, number in zip(keys.tolist(), counter.tolist(), four.numpy(), one.numpy(), strict=True):
        own = {"explorer": key[0], "seed": key[1]}
        assert numbers.tolist() == over_array_model.uniform(own, *words)
        assert number == over_array_model.bell(own, *words[:3])


def test_bell_shaped_numbers_have_their_moments():
    own = np.array([over_array_model.bell({"explorer": 1, "seed": 2}, k, 4) for k in range(4000)])
    assert (abs(own).max(), own.mean(), own.std()) == pytest.approx((2.0, 0.0, 0.97), abs=0.04)


def test_no_motion_and_no_pose_are_none(device):
    assert poses_of([], device).shape == (0, 7)
    assert poses_of([trial(stop=0), trial(stop=0)], device).shape == (0, 7)


@pytest.mark.parametrize("wrong", [{"rate": 0.0}, {"rate": np.nan}, {"first": 5, "stop": 4}, {"first": -1}])
def test_numbers_out_of_bounds_are_refused(wrong):
    with pytest.raises(ValueError, match=r"the rate must be above 0, and poses first\.\.stop"):
        place_explorers(trials_of([trial(**wrong)]), device="cpu")
