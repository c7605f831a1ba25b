"""Explorations over an array, made on a device: the poses of `exploration`, bit for bit, in any company."""

import numpy as np
import pytest

from palpate.datasets import exploration, explorer_habits
from palpate.datasets.motions.explorer_habits import SIDES
from palpate.datasets.motions.over_array import FACING, WORKSPACE
from palpate.kernels.motions.over_array import place_explorers, trials_of

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
WIDE = ((-0.3, -0.2, 0.06), (0.2, 0.35, 0.5))


def trial(explorer=1, seed=1, stop=900, *, first=0, rate=90.0, facing=float(FACING), workspace=WORKSPACE):
    habits = explorer_habits(explorer)
    return {
        "explorer": explorer, "seed": seed, "first": first, "stop": stop, "rate": rate, "facing": facing,
        "yaw": habits.yaw, "pitch": habits.pitch, "roll": habits.roll, "speed": habits.speed,
        "pause_share": habits.pause_share, "side": SIDES.index(habits.side), "workspace": np.array(workspace),
    }  # fmt: skip


def poses_of(trials, device):
    return place_explorers(trials_of(trials), device=device).numpy()


def explored(one):
    names = ("explorer", "seed", "rate", "facing", "workspace")
    motion = exploration(BOUNDS, one["stop"] / one["rate"], **{name: one[name] for name in names})
    return motion.pose[one["first"] : one["stop"]]


def test_every_bit_is_that_of_the_model(device):
    trials = [trial(k, 7 * k + 1, 2700, facing=(1.047, 0.3, 1.5)[k % 3]) for k in range(1, 13)]
    trials += [trial(2**63 - 1, 2**63 - 1, 500, workspace=WIDE), trial(3, 0, 4000, first=3990, rate=1000.0)]
    trials += [trial(4, 5, 40, rate=0.37), trial(5, 5, 1), trial(6, 6, 50_000, first=49_000)]
    np.testing.assert_array_equal(poses_of(trials, device), np.concatenate([explored(one) for one in trials]))


@pytest.mark.exhaustive
def test_every_bit_of_a_million_poses(device):
    trials = [trial(k, k, 27_000, facing=(1.047, 0.1, 1.5)[k % 3]) for k in range(40)]
    np.testing.assert_array_equal(poses_of(trials, device), np.concatenate([explored(one) for one in trials]))


def test_no_motion_and_no_pose_are_none(device):
    assert poses_of([], device).shape == (0, 7)
    assert poses_of([trial(stop=0), trial(stop=0)], device).shape == (0, 7)


@pytest.mark.parametrize("wrong", [{"rate": 0.0}, {"rate": np.nan}, {"first": 5, "stop": 4}, {"first": -1}])
def test_numbers_out_of_bounds_are_refused(wrong):
    with pytest.raises(ValueError, match=r"the rate must be above 0, and poses first\.\.stop"):
        place_explorers(trials_of([trial(**wrong)]), device="cpu")
