"""Explorations over an array: in one workspace, within the facing limit, smooth, as fast as people."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.datasets.motions.facing import facing_angles
from palpate.datasets.shapes.built_in import shape_names
from palpate.render import exploration
from palpate.render.motions.explorations.options import WORKSPACE

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
DATA = os.environ.get("PALPATE_TEST_DATA", "")
CLIPS = ("HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards")
SMOOTHED = 5  # frames of a clip, whose tracker is noisy


def speeds(motion):
    """Linear and angular speeds [m/s, rad/s]."""
    rotation = Rotation.from_quat(motion.pose[:, 3:])
    turn = (rotation[:-1].inv() * rotation[1:]).magnitude()
    return np.linalg.norm(np.diff(motion.pose[:, :3].astype(float), axis=0), axis=1) * motion.rate, turn * motion.rate


@settings(max_examples=15, deadline=None)
@given(
    explorer=st.integers(0, 2**63 - 1),
    seed=st.integers(0, 2**63 - 1),
    facing=st.floats(0.1, np.pi / 2),
    low=st.tuples(*[st.floats(-0.2, 0.0)] * 2, st.floats(0.06, 0.2)),
    size=st.tuples(*[st.floats(0.03, 0.4)] * 3),
)
def test_every_pose_keeps_the_workspace_and_the_facing_limit(explorer, seed, facing, low, size):
    space = np.array([low, np.add(low, size)])
    motion = exploration(space, 8.0, seed=seed, explorer=explorer, facing=facing, workspace=space)
    assert (motion.pose[:, :3] >= space[0] - 1e-7).all()
    assert (motion.pose[:, :3] <= space[1] + 1e-7).all()
    assert facing_angles(motion.pose).max() <= facing + 1e-6
    assert np.linalg.norm(motion.pose[:, 3:], axis=1) == pytest.approx(np.ones(len(motion)), abs=1e-6)


def test_palms_move_and_turn_as_fast_as_people_and_no_faster():
    linear, angular = zip(*(speeds(exploration(BOUNDS, 60.0, explorer=k)) for k in range(1, 9)), strict=True)
    assert max(map(np.max, linear)) < 0.76
    assert max(map(np.max, angular)) < 4.0  # 3 of a stroke, and what the facing limit adds
    assert 0.05 < min(map(np.mean, linear)) < max(map(np.mean, linear)) < 0.3
    assert all(0.1 < np.mean(own < 0.03) < 0.6 for own in linear)  # of the time they nearly rest


def test_the_motion_is_smooth():
    """A step of the velocity is about acceleration x interval: a jump would not shrink with the interval."""
    for explorer in range(4):
        step = []
        for rate in (200.0, 800.0):
            path = exploration(BOUNDS, 20.0, rate=rate, explorer=explorer).pose.astype(float)
            step.append(np.abs(np.diff(np.diff(path, axis=0) * rate, axis=0)).max(axis=0))
        assert (step[1] < 0.4 * step[0]).all()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("duration", "rate", "every"), [(60.0, 90.0, 1), (20.0, 180.0, 2), (2000.0, 900.0, 10)])
def test_duration_and_rate_only_sample_the_path(duration, rate, every):
    short = exploration(BOUNDS, duration=20.0, rate=90.0, seed=5)
    other = exploration(BOUNDS, duration=duration, rate=rate, seed=5)
    assert np.array_equal(other.pose[::every][: len(short)], short.pose)


def test_seed_and_explorer_change_the_motion_and_the_object_does_not():
    motions = [exploration(name, 2.0, seed=2).pose for name in shape_names()]
    assert all(np.array_equal(pose, motions[0]) for pose in motions)
    others = [exploration("cube", 2.0, seed=seed, explorer=explorer).pose for seed, explorer in ((1, 1), (2, 2))]
    assert not any(np.array_equal(pose, motions[0]) for pose in others)


def test_a_motion_keeps_what_made_it_in_its_file(tmp_path):
    motion = exploration(BOUNDS, 0.5, explorer=6, seed=3, facing=0.8)
    made = {"model": "over-array", "version": 1, "duration": 0.5, "rate": 90.0, "seed": 3, "explorer": 6, "facing": 0.8}
    assert motion.provenance == made | {"workspace": np.array(WORKSPACE).tolist()}
    assert type(motion).load(motion.save(tmp_path / "own.h5")).provenance == motion.provenance
    assert exploration(BOUNDS, 0.5, model="around").provenance["model"] == "around"
    assert motion[0:3].provenance is None


def clip_figures(name):
    """Speeds, angular speeds, pitch, roll and yaw of a clip, smoothed [m/s, rad/s, rad]."""
    clip = np.load(Path(DATA) / "leap" / f"{name}.npz")
    ahead, down = clip["palm_direction"].astype(float), clip["palm_normal"].astype(float)
    side = np.cross(-down, -ahead)
    time, place = clip["t"], clip["palm_position"].astype(float)
    window = np.ones(SMOOTHED) / SMOOTHED
    smooth = np.stack([np.convolve(place[:, k], window, "valid") for k in range(3)], axis=1)
    speed = np.linalg.norm(np.diff(smooth, axis=0), axis=1) / np.diff(np.convolve(time, window, "valid"))
    axes = Rotation.from_matrix(np.stack([side, -down, -ahead], axis=2))
    turn = (axes[:-SMOOTHED].inv() * axes[SMOOTHED:]).magnitude() / (time[SMOOTHED:] - time[:-SMOOTHED])
    yaw = np.arctan2(-ahead[:, 0], -ahead[:, 2])
    return speed, turn, np.arcsin(ahead[:, 1]), np.arcsin(side[:, 1]), yaw


@pytest.mark.skipif(not DATA, reason="PALPATE_TEST_DATA names no folder with leap/*.npz")
def test_speeds_and_tilts_lie_within_those_of_recorded_hands():
    """The numbers of the tables in `over_array` and `explorer_habits`, too."""
    clips = [clip_figures(name) for name in CLIPS]
    moving = [own[0][own[0] > 0.03].mean() for own in clips]
    assert np.round(moving, 2).tolist() == [0.07, 0.11, 0.11, 0.30]
    assert [round(float(np.degrees(own[2].std())), 1) for own in clips[:2]] == [6.1, 6.0]
    assert [round(float(np.degrees(own[3].std())), 1) for own in clips[:2]] == [4.7, 4.4]
    fastest, turning = (max(own[k].max() for own in clips) for k in (0, 1))
    assert fastest == pytest.approx(0.87, abs=0.01)
    rests = [np.mean(own[0] < 0.03) for own in clips]
    pitches, rolls, yaws = (np.concatenate([own[k] for own in clips]) for k in (2, 3, 4))
    for explorer in range(1, 9):
        motion = exploration(BOUNDS, 60.0, explorer=explorer, facing=np.pi / 2)
        linear, angular = speeds(motion)
        assert linear.max() < fastest
        assert angular.max() < turning
        assert min(rests) < np.mean(linear < 0.03) < max(rests)
        matrix = Rotation.from_quat(motion.pose[:, 3:]).as_matrix()
        pitch, roll = np.arcsin(-matrix[:, 2, 2]), np.arcsin(matrix[:, 2, 0])
        yaw = np.arctan2(matrix[:, 0, 2], -matrix[:, 1, 2])
        assert pitches.min() - 0.02 < pitch.min() < pitch.max() < pitches.max()
        assert rolls.min() < roll.min() < roll.max() < rolls.max() + 0.1
        assert yaws.min() < yaw.min() < yaw.max() < yaws.max()
