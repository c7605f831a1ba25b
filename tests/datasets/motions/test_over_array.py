"""Explorations over an array: in one workspace, within the facing limit, smooth, as fast as people, strokes alone."""

import hashlib
import itertools
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate.datasets import exploration, explorer_habits
from palpate.datasets.errors import MotionError
from palpate.datasets.motions.exploration_options import check_options
from palpate.datasets.motions.facing import facing_angles
from palpate.datasets.motions.over_array import (
    FACING,
    WORKSPACE,
    ExplorerTrial,
    make_strokes,
    over_array_path,
    stroke_counts,
)
from palpate.datasets.shapes.built_in import shape_names
from palpate.render.terminal.wording import Wording

BOUNDS = np.array([[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]])
DATA = os.environ.get("PALPATE_TEST_DATA", "")
CLIPS = ("HandSplay-110fps", "grab", "rollAndPitchCropped", "test-paddle-rightwards")
GOLDEN = "4182e2785b8069445e161ccebccc54b36b319cf8d6324ec580c317e1998d4b08"
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
            path = check_options("over-array", explorer).path(BOUNDS, np.arange(20.0 * rate) / rate, 1, lambda *_: None)
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


def test_poses_are_what_they_were():
    """Of version 1 of the model; rounded to 1 um, as libraries may round sines in other ways."""
    pose = exploration(BOUNDS, duration=20.0, rate=90.0, seed=7, explorer=3).pose[::100].astype(float)
    assert hashlib.sha256(np.rint(pose * 1e6).astype("<i8").tobytes()).hexdigest() == GOLDEN


def test_a_stroke_is_made_without_those_before_it():
    space = np.array(WORKSPACE)
    trial = ExplorerTrial(4, 9, explorer_habits(4), space, FACING)
    visit = np.arange(3)
    numbers = [(v, s) for v, count in zip(visit, stroke_counts(trial, visit), strict=True) for s in range(count)]
    lasting = [make_strokes(trial, np.array([v]), np.array([s])) for v, s in numbers]
    begin = 0
    for before, own in itertools.pairwise(lasting):
        begin += int(before.moving[0] + before.pause[0])
        np.testing.assert_array_equal(before.goal.position, own.start.position)
        np.testing.assert_array_equal(before.goal.angles, own.start.angles)
        pose = over_array_path(trial, np.array([0.0, begin / 1e3]), lambda *_: None)[1]
        assert np.abs(pose[:3] - own.start.position[0]).max() < 1.3e-3  # sway
    together = make_strokes(trial, *np.array(numbers).T)
    for k, own in enumerate(lasting):
        assert (own.moving[0], own.pause[0]) == (together.moving[k], together.pause[k])
        np.testing.assert_array_equal(own.goal.position[0], together.goal.position[k])


def test_visits_enter_from_above_and_the_sides_mostly_the_preferred_one():
    for explorer in range(1, 9):
        habits, space = explorer_habits(explorer), np.array(WORKSPACE)
        trial = ExplorerTrial(explorer, 1, habits, space, FACING)
        place = make_strokes(trial, np.arange(400), np.zeros(400, int)).start.position
        sides = {
            "above": np.isclose(place[:, 2], space[1, 2], atol=2e-3),
            "front": np.isclose(place[:, 1], space[0, 1], atol=2e-3),
            "left": np.isclose(place[:, 0], space[0, 0], atol=2e-3),
            "right": np.isclose(place[:, 0], space[1, 0], atol=2e-3),
        }
        assert np.logical_or.reduce(list(sides.values())).all()
        assert max(sides, key=lambda side: sides[side].sum()) == habits.side
        assert min(own.mean() for own in sides.values()) > 0.1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"bounds": BOUNDS + np.array([0.5, 0, 0])},
            r"bounds: the object's box \(0.435 .* 0.265\) m does not meet the workspace \(-0.125",
        ),
        (
            {"model": "over-arrow"},
            r"model must be one of over-array, around, not 'over-arrow' \(did you mean 'over-array'",
        ),
        ({"explorer": -1}, "explorer must be an integer of 0 to 9223372036854775807, got -1"),
        ({"explorer": 1.5}, "explorer must be an integer"),
        ({"facing": 60}, "facing must lie in 0.0873..1.57 rad, not 60; 60 degrees are 1.047 rad"),
        ({"facing": float("nan")}, "facing must lie in"),
        ({"workspace": [0, 0, 0.1]}, r"workspace must have shape \[2, 3\], got \[3\]"),
        ({"workspace": [[0, 0, 0.1], [0.1, 0.1, 0.11]]}, "0.02 m apart at least along each axis"),
        ({"workspace": [[0, 0, 0.01], [0.1, 0.1, 0.2]]}, "workspace must begin at z = 0.06 m .* got 0.01 m"),
        ({"workspace": [[0, 0, 0.1], [100, 100, 110]]}, "workspace must be finite and within 2 m"),
        ({"model": "around", "explorer": 1}, "explorer is of the model over-array, not of around"),
        ({"model": "around", "facing": 1.0}, "facing is of the model over-array"),
    ],
)
def test_bad_options_are_refused_with_value_and_bound(change, said):
    arguments = {"bounds": BOUNDS, "duration": 1.0, **change}
    with pytest.raises(MotionError, match=said):
        exploration(arguments.pop("bounds"), **arguments)


def test_an_object_beside_the_workspace_is_told_the_options_that_join_them():
    """The box of BOUNDS half a metre aside, grown by the 60 mm that a palm of 85 mm reaches."""
    beside = BOUNDS + np.array([0.5, 0, 0])
    with pytest.raises(MotionError) as refused:
        exploration(beside, 1.0)
    options = Wording(["at", "workspace"])(str(refused.value))
    asked = (
        "--at 0 0 0.2 puts its middle over the array, --workspace 0.375 -0.125 0.075 0.625 0.125 0.325 the hand around"
    )
    assert asked in options
    workspace = [float(text) for text in asked.split("--workspace ")[1].split()[:6]]
    assert exploration(beside, 1.0, workspace=workspace).pose[:, 0].min() > 0.37
    with pytest.raises(MotionError, match=r"over the array$"):  # no workspace may be farther than 2 m
        exploration(BOUNDS + np.array([50.0, 0, 0]), 1.0)


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
