"""Every benchmark case runs, small, and says what it should."""

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from batch_sampling import measure as measure_sampling
from explorers import CASES as EXPLORER_CASES
from explorers import measure as measure_explorers
from live_prediction import Clip, cells, cost, jitter
from live_prediction import measure as measure_prediction
from one_pose import CASES as POSE_CASES
from one_pose import measure as measure_pose
from one_pose import measure_file, row_of
from pressure import CASES as PRESSURE_CASES
from pressure import measure as measure_pressure
from pressure import random_points
from recording import THINGS
from recording import measure as measure_recording
from scaling import measure as measure_scaling
from solvers import SEVERAL, SINGLE, focal_points
from solvers import measure as measure_solvers
from transforms import PRESETS, measure_explorations, numbers_of
from transforms import compare as compare_numbers
from transforms import measure as measure_transforms
from wire_bytes import measure as measure_bytes

from palpate.render import MeshObject
from palpate.render.bench.cases import random_poses
from palpate.render.live.sources.shaping import PoseShaping, Prediction


def test_poses_are_the_same_every_time_and_uniform():
    poses = random_poses(4000)
    np.testing.assert_array_equal(poses, random_poses(4000))
    assert np.abs(poses[:, :3] - [0, 0, 0.2]).max() <= 0.065
    assert np.linalg.norm(poses[:, 3:], axis=1) == pytest.approx(np.ones(4000), abs=1e-6)
    assert np.abs(poses[:, 3:].mean(axis=0)).max() < 0.05


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("case", EXPLORER_CASES, ids=lambda case: case.label)
def test_explorers_case_measures_both_readings_of_r(case):
    found = measure_explorers(case, MeshObject.load("cube"), range(1, 3))
    assert (found.r >= found.r_open).all()
    assert (found.r_open > 1).all()
    assert (found.facing_share[:, 0] <= found.facing_share[:, 1]).all()
    if case.model == "over-array" and not case.pitch:
        assert (found.facing_share[:, 1] == 1).all()
        assert found.facing_share[:, 0].min() > 0.5
    assert (found.drawn_share > 0.2).all()
    assert (found.inside_share < 0.3).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", THINGS)
def test_recording_case_measures_what_it_writes(name, device, tmp_path):
    figures = measure_recording(name, [device], 3000, 1, tmp_path)
    assert figures["commits"] >= 2
    assert 100 < figures["bytes_per_pose"] < 1000
    assert min(figures[f"{side}_seconds"] for side in ("render", "record", "write", "raw")) > 0


@pytest.mark.exhaustive
def test_scaling_case_measures_workers_and_processes():
    figures = measure_scaling("cube", ["cpu", "cpu"], 2001, 1)
    assert figures["poses"] == 2000
    assert set(figures["seconds"]) == {"one", "together", "apart"}
    assert min(figures["seconds"].values()) > 0
    assert figures["speedup"] == figures["seconds"]["one"] / figures["seconds"]["together"]


def test_solver_cases_measure_phases_that_focus(device):
    for figure in measure_solvers(SINGLE, focal_points(50, 1)[:, 0], device, 1):
        assert figure.error is None or figure.error < 1, figure.case  # 1/256 turn
    for figure in measure_solvers(SEVERAL, focal_points(20, 4), device, 1):
        assert figure.error < 0.3, figure.case


def test_pressure_cases_measure_the_same_field(device):
    cases = PRESSURE_CASES if device == "cpu" else PRESSURE_CASES[:2]
    for figure in measure_pressure(cases, random_points(100), device, 1):
        assert figure.error < 1e-4, figure.case
        assert figure.nanoseconds_a_pair > 0


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("preset", PRESETS)
def test_transforms_case_measures_what_it_renders(preset, device):
    poses = random_poses(60)
    (figures,) = measure_transforms([preset], device, poses, chunk=25, rounds=1)
    assert figures["us"] > 0
    numbers = numbers_of(preset, device, poses)
    same = compare_numbers(numbers, numbers)
    assert (same["blocks"], same["blocks_of_equal_bits"], same["points_apart"], same["length_apart"]) == (1, 1, 0, 0.0)
    assert compare_numbers(numbers, numbers + np.array([0, 2, 0.5, 1])) == {
        "blocks": 1, "blocks_of_equal_bits": 0, "polylines_apart": 0, "points_apart": 2, "length_apart": 0.5
    }  # fmt: skip


@pytest.mark.exhaustive
def test_explorations_are_measured(device):
    assert measure_explorations(device, 3, rounds=1)["us"] > 0


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("case", POSE_CASES, ids=lambda case: case.label)
def test_one_pose_to_its_focal_points_is_measured(case):
    scheduler = os.sched_getscheduler(0)
    figures = measure_pose(case, 300, repeats=1)
    assert 0 < figures["hit"] < 1
    for name in ("wall_us", "cpu_us", "contours_us"):
        assert 0 < figures[name]["p50"] <= figures[name]["p99"] <= figures[name]["max"]
    assert figures["contours_us"]["p50"] < figures["wall_us"]["p50"]
    assert row_of(figures).count("|") == 8
    assert (os.sched_getscheduler(0), gc.isenabled()) == (scheduler, True)


def test_errors_of_prediction_are_measured():
    """A hand that moves at 0.5 m/s and turns at 2 rad/s: unpredicted, it errs by what it does in 20 ms."""
    time = np.arange(60) / 110
    turn = Rotation.from_rotvec(np.outer(2.0 * time, [0, 1, 0])).as_quat()
    clip = Clip(time, np.column_stack([0.5 * time, 0 * time, 0 * time + 0.2, turn]))
    assert np.diff(clip.thinned(60.0).time).mean() == pytest.approx(1 / 60, rel=0.05)
    none = measure_prediction([clip], PoseShaping(), 0.02, 90.0).figures
    assert none == pytest.approx((10.0, 10.0, np.degrees(0.04), np.degrees(0.04)))
    predicted = measure_prediction([clip], PoseShaping(Prediction(0.02, 0.0)), 0.02, 60.0)
    assert predicted.position[1:] == pytest.approx(0, abs=1e-9)  # of the first pose no velocity is known
    assert predicted.angle[1:] == pytest.approx(0, abs=1e-4)
    assert cells(predicted).count("mm") == 1
    assert jitter([clip], PoseShaping()) == pytest.approx((0, 0), abs=1e-4)
    median, most = cost([clip], PoseShaping())
    assert 0 < median <= most


def test_focal_points_of_a_file_are_measured_beside_its_contours():
    figures = measure_file(0.5, rounds=1)
    assert figures["focal_points"] == 5000
    assert 0 < figures["contours"] < figures["whole"]


@pytest.mark.exhaustive
def test_sampling_is_measured(device):
    assert measure_sampling("stm", device, 2, at_once=1)["us"] > 0


@pytest.mark.exhaustive
def test_bytes_of_the_whole_chain_do_not_depend_on_how_many_motions_are_made_at_once(device):
    one, two = (measure_bytes(device, 2, memory) for memory in (2**24, 2**28))
    assert (one["groups"], two["groups"]) == (2, 1)
    assert one["frames"] == two["frames"] == 600_000
    assert (one["sum"], one["refused"]) == (two["sum"], two["refused"])
    assert one["sum"] != 0
