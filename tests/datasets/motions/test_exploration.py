"""The exploration around an object: smooth, as fast as a person, near it, from every side, a function of its seed."""

import re
import tracemalloc
from functools import partial

import around_oracle
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.datasets.bounded_file import LIMIT_VARIABLE
from palpate.datasets.errors import MotionError
from palpate.datasets.motions import hand_motion
from palpate.datasets.motions.exploration_options import EXPLORATION_MODELS
from palpate.render import MeshObject
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import load_motion

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
exploration = partial(hand_motion.exploration, model="around")


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
    assert motion.pose == pytest.approx(around_oracle.exploration_path(BOUNDS, motion.time, 7), abs=1e-7)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("duration", "rate", "every"), [(60.0, 90.0, 1), (20.0, 180.0, 2), (200.0, 900.0, 10)])
def test_duration_and_rate_only_sample_the_path(duration, rate, every):
    short = exploration(BOUNDS, duration=20.0, rate=90.0, seed=5)
    other = exploration(BOUNDS, duration=duration, rate=rate, seed=5)
    assert np.array_equal(other.pose[::every][: len(short)], short.pose)
    assert np.array_equal(other.time[::every][: len(short)], short.time)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"bounds": BOUNDS[::-1]}, r"minimum before maximum.*\]\]$"),
        (
            {"bounds": BOUNDS + np.array([0, 0, 199.8])},
            r"within 100 m.*; at=\(0, 0, 0.2\) puts its middle over the array",
        ),
        ({"bounds": BOUNDS * np.nan}, "bounds must be finite"),
        ({"bounds": BOUNDS[0]}, r"bounds must have shape \[2, 3\], got \[3\]"),
        (
            {"bounds": BOUNDS - [0, 0, 0.3]},
            r"z = -0.035 m leaves a hand no room 0.06 m above the array; at=\(0, 0, 0.2\) puts",
        ),
        ({"duration": 0.0}, "duration must be finite and greater than 0, got 0.0"),
        ({"duration": float("inf")}, "duration must be finite"),
        ({"rate": -90.0}, "rate must be finite and greater than 0, got -90.0"),
        ({"seed": -1}, "seed must be an integer of 0 to 9223372036854775807, got -1"),
        ({"seed": 1.5}, "seed must be an integer"),
    ],
)
def test_exploration_refuses_bad_arguments(change, said):
    arguments = {"bounds": BOUNDS, "duration": 1.0, "seed": 1, **change}
    with pytest.raises(MotionError, match=said):
        exploration(arguments.pop("bounds"), **arguments)


@pytest.mark.parametrize("model", EXPLORATION_MODELS)
@pytest.mark.parametrize(("duration", "rate"), [(1e7, 90.0), (1e8, 1e-3)])
def test_an_exploration_beyond_memory_is_refused_before_it_is_made(model, duration, rate, monkeypatch):
    """By its poses, or by the path that its duration takes."""
    exploration = partial(hand_motion.exploration, model=model)
    for path in ("exploration_path", "over_array_path"):
        monkeypatch.setattr(f"palpate.datasets.motions.exploration_options.{path}", pytest.fail)
    with pytest.raises(MotionError, match=r"\(duration .* s at rate .* Hz\) takes .* more than the 3000000000"):
        exploration(BOUNDS, duration=duration, rate=rate, seed=1)
    with pytest.raises(StrategyError, match="exploration: a motion of"):
        load_motion("exploration", MeshObject.load("cube"), {"duration": duration, "rate": rate, "model": model})


@pytest.mark.exhaustive
@pytest.mark.parametrize("model", EXPLORATION_MODELS)
@pytest.mark.parametrize(("duration", "rate"), [(30.0, 1e4), (3000.0, 1.0)])
def test_an_exploration_takes_no_more_memory_than_it_is_refused_for(model, duration, rate, monkeypatch):
    exploration = partial(hand_motion.exploration, model=model)
    tracemalloc.start()
    exploration(BOUNDS, duration=duration, rate=rate, seed=1)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    monkeypatch.setenv(LIMIT_VARIABLE, "1")
    with pytest.raises(MotionError, match=LIMIT_VARIABLE) as caught:
        exploration(BOUNDS, duration=duration, rate=rate, seed=1)
    told = int(re.search(r"takes (\d+) bytes", str(caught.value))[1])
    assert 0.5 * told < taken < 1.25 * told  # and a block of poses at once
