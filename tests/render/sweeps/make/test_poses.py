"""Poses of recipes: those made on a device are those on the host, alone and with others."""

from types import SimpleNamespace

import numpy as np
import pytest
import sweep_recipes
from sweep_recipes import random_motion, recipe_of, recorded

from palpate.datasets import HandMotion
from palpate.datasets.errors import MotionError
from palpate.datasets.recordings.alignment import Y_UP
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import write_sample
from palpate.render import MeshObject, exploration
from palpate.render.motions.explorations.explored import ExploredPoses, HostPoses, explored_rows
from palpate.render.sweeps.make.batch import PoseRange, poses_of
from palpate.render.sweeps.make.poses import RandomPoses, pose_count
from palpate.render.sweeps.make.rendering import recipe_cache

OPTIONS = {"duration": 3.0, "rate": 90.0, "model": "over-array"}


def explored(**options):
    return ExploredPoses.of(**{"bounds": MeshObject.load("cube").bounds, "seed": 1, **OPTIONS, **options})


def test_poses_of_explorations_are_made_together(device):
    ranges = [(explored(), 0, 270), (explored(seed=2, explorer=5), 100, 130), (explored(facing=0.4), 269, 270)]
    rows = explored_rows(ranges, device).numpy()
    np.testing.assert_array_equal(rows, np.concatenate([poses.motion.pose[a:b] for poses, a, b in ranges]))


def test_the_motion_is_that_of_exploration():
    poses = explored(seed=3)
    motion = exploration(MeshObject.load("cube").bounds, 3.0, rate=90.0, seed=3)
    assert poses.count == len(poses.motion) == 270
    np.testing.assert_array_equal(poses.motion.pose, motion.pose)
    np.testing.assert_array_equal(poses.motion.time, motion.time)
    np.testing.assert_array_equal(poses.rows(5, 9, "cpu").numpy(), motion.pose[5:9])


def test_what_exploration_refuses_is_refused_before_a_pose_is_made():
    with pytest.raises(MotionError, match="does not meet the workspace"):
        explored(bounds=[[5, 5, 5], [6, 6, 6]])
    with pytest.raises(MotionError, match="duration must be finite and greater than 0"):
        explored(duration=-1.0)


def test_random_poses_on_the_host_are_those_of_the_device(device):
    poses = RandomPoses(50, 3, 0.13, (0.0, 0.0, 0.2))
    np.testing.assert_array_equal(poses.rows(0, 50, device).numpy(), poses.motion.pose)


def rows_of(poses, device):
    """Poses of a batch of several renderings, a few of each."""
    chunks = [SimpleNamespace(rendering=SimpleNamespace(poses=own)) for own in poses]
    rows = poses_of([PoseRange(chunk, k, k + 10) for k, chunk in enumerate(chunks)], device)
    return rows if isinstance(rows, np.ndarray) else rows.numpy()


def test_a_batch_may_have_poses_of_every_kind(device):
    random = RandomPoses(50, 3, 0.13, (0.0, 0.0, 0.2))
    host = HostPoses(exploration(MeshObject.load("cube").bounds, 1.0, rate=90.0, model="around"))
    for kinds in ([explored(), random, explored(seed=2), host], [explored(), explored(seed=2)], [host, host], [random]):
        wanted = np.concatenate([own.motion.pose[k : k + 10] for k, own in enumerate(kinds)])
        np.testing.assert_array_equal(rows_of(kinds, device), wanted)


@pytest.mark.filterwarnings("ignore:the hand is nowhere in front")
def test_poses_are_counted_without_making_them(tmp_path):
    for name in ("a.h5", "a.csv"):
        HandMotion(None, np.tile(exploration("tube", 1.0, rate=90.0).pose[:1], (7, 1))).save(tmp_path / name)
    path = write_sample("openxr", tmp_path / "hand.json", frame_count=8)
    motions = [sweep_recipes.explored(duration, rate) for duration, rate in ((0.1, 30.0), (2.0, 90.0), (1.0, 7.3))]
    motions += [recorded(tmp_path / "a.h5"), recorded(tmp_path / "a.csv"), random_motion(10**9)]
    recipes = [recipe_of(motion=motion) for motion in motions]
    recipes += [recipe_of("tube", hand, recorded(path, rate=90.0)) for hand in ("palm", "planes")]
    counts = [pose_count(recipe) for recipe in recipes]
    assert counts[:6] == [3, 180, 8, 7, 7, 10**9]
    assert counts == [recipe_cache("cpu").rendering(recipe).poses.count for recipe in recipes]


def test_a_word_for_an_alignment_turns_a_recording_as_its_transform_does(tmp_path):
    path = write_sample("openxr", tmp_path / "hand.json", frame_count=4)
    recipe = recipe_of(motion=recorded(path) | {"alignment": {"source": "y-up", "name": "y-up"}})
    poses = recipe_cache("cpu").rendering(recipe).poses
    assert pose_count(recipe) == poses.count == 4
    np.testing.assert_array_equal(poses.rows(0, 4, "cpu"), load_recording(path, alignment=Y_UP).motion().pose)
