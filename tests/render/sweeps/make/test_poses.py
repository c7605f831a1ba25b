"""Poses of recipes: they are counted without being made; those made on a device are those on the host."""

import numpy as np
import pytest
from sweep_recipes import explored, random_motion, recipe_of, recorded

from palpate.datasets import HandMotion
from palpate.datasets.recordings.sample import write_sample
from palpate.render import exploration
from palpate.render.sweeps.make.poses import RandomPoses, pose_count
from palpate.render.sweeps.make.rendering import recipe_cache


def test_random_poses_on_the_host_are_those_of_the_device(device):
    poses = RandomPoses(50, 3, 0.13, (0.0, 0.0, 0.2))
    np.testing.assert_array_equal(poses.rows(0, 50, device).numpy(), poses.motion.pose)


@pytest.mark.filterwarnings("ignore:the hand is nowhere in front")
def test_poses_are_counted_without_making_them(tmp_path):
    for name in ("a.h5", "a.csv"):
        HandMotion(None, np.tile(exploration("tube", 1.0, rate=90.0).pose[:1], (7, 1))).save(tmp_path / name)
    path = write_sample("openxr", tmp_path / "hand.json", frame_count=8)
    motions = [explored(duration, rate) for duration, rate in ((0.1, 30.0), (2.0, 90.0), (1.0, 7.3))]
    motions += [recorded(tmp_path / "a.h5"), recorded(tmp_path / "a.csv"), random_motion(10**9)]
    recipes = [recipe_of(motion=motion) for motion in motions]
    recipes += [recipe_of("tube", hand, recorded(path, rate=90.0)) for hand in ("palm", "planes")]
    counts = [pose_count(recipe) for recipe in recipes]
    assert counts[:6] == [3, 180, 8, 7, 7, 10**9]
    assert counts == [recipe_cache("cpu").rendering(recipe).poses.count for recipe in recipes]
