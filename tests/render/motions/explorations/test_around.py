"""The exploration around an object: smooth, as fast as a person, near it, from every side, a function of its seed."""

from functools import partial

import numpy as np
import pytest
from exploration_models import around as around_model
from scipy.spatial.transform import Rotation

from palpate import render

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
exploration = partial(render.exploration, model="around")


def speeds(motion):
    rotation = Rotation.from_quat(motion.pose[:, 3:])
    turn = (rotation[:-1].inv() * rotation[1:]).magnitude()
    return np.linalg.norm(np.diff(motion.pose[:, :3].astype(float), axis=0), axis=1) * motion.rate, turn * motion.rate


def test_exploration_lasts_as_long_as_asked_at_the_rate_asked():
    motion = exploration(BOUNDS, duration=30.0, rate=90.0, seed=1)
    assert (len(motion), motion.seed, motion.offset) == (2700, 1, 0.0)
    assert motion.duration == pytest.approx(30.0)
    assert motion.rate == pytest.approx(90.0)
    assert len(exploration(BOUNDS, duration=1e-3, seed=1)) == 1


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    "bounds",
    [
        BOUNDS,
        [[-0.4, -0.3, 0.1], [0.4, 0.3, 0.9]],
        [[0.1, 0.1, 0.2], [0.1, 0.1, 0.2]],
        [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]],
        [[-0.065, -0.01, 0.15], [0.065, 0.01, 0.25]],
    ],
    ids=["cube", "large", "point", "on the array", "thin"],
)
def test_exploration_stays_in_the_workspace_whatever_the_object(bounds):
    bounds = np.array(bounds)
    for seed in range(3):
        motion = exploration(bounds, duration=30.0, seed=seed)
        position = motion.pose[:, :3].astype(float)
        assert (position > bounds[0] - 0.06 - 1e-6).all()
        assert (position < bounds[1] + 0.06 + 1e-6).all()
        assert position[:, 2].min() > 0.06 - 1e-6
        assert speeds(motion)[0].max() < 1.0
        assert speeds(motion)[1].max() < 4.0


def test_the_model_around_makes_the_poses_that_it_always_made():
    """Those of the model as it was first written: as fast as a person, near the object, from every side."""
    motion = exploration(BOUNDS, duration=20.0, rate=90.0, seed=7)
    assert motion.pose == pytest.approx(around_model.exploration_path(BOUNDS, motion.time, 7), abs=1e-7)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("duration", "rate", "every"), [(60.0, 90.0, 1), (20.0, 180.0, 2), (200.0, 900.0, 10)])
def test_duration_and_rate_only_sample_the_path(duration, rate, every):
    short = exploration(BOUNDS, duration=20.0, rate=90.0, seed=5)
    other = exploration(BOUNDS, duration=duration, rate=rate, seed=5)
    assert np.array_equal(other.pose[::every][: len(short)], short.pose)
    assert np.array_equal(other.time[::every][: len(short)], short.time)
