"""Prints on skin and metrics of files: forces by hand, places, refusals."""

import numpy as np
import pytest

from palpate.datasets.contour_file.reader import ContourFile
from palpate.render import (
    FocalPoints,
    HandMotion,
    Palm,
    Resonance,
    StrategyError,
    drive_focus,
    exploration,
    load_rig,
    pressure_at,
    pressure_metrics,
    radiation_pressure,
    render,
    static_pose,
)
from palpate.render.acoustics.averaged_frames import frames_of_average
from palpate.render.acoustics.drawn_frames import cycle_of, drawn_pose, longest_pose, pose_at
from palpate.render.acoustics.field_metrics import sampling_for
from palpate.render.acoustics.pressure import PressureSum, complex_drives
from palpate.render.acoustics.radiation import mean_square
from palpate.render.acoustics.sampled_places import sample_plane
from palpate.render.acoustics.skin_print import distance_to, points_along, print_on, unevenness
from palpate.render.acoustics.transducers import TransducerSet

RIG = load_rig("emulator")
X, Y = np.eye(3)[:2]
SQUARE = np.array([[0, 0, 0.2], [0.04, 0, 0.2], [0.04, 0.03, 0.2]])


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    batch = render("cube", Palm(), static_pose([0.0, 0.06, 0.2]), "oc")
    return batch.save(tmp_path_factory.mktemp("field") / "still.h5")


@pytest.fixture(scope="module")
def moving(tmp_path_factory):
    pose = np.tile(static_pose([0, 0.05, 0.2]).pose, (9, 1))
    pose[:, 1] += np.linspace(0, 0.02, 9)
    batch = render("cube", Palm(), HandMotion(time=np.arange(9) / 90, pose=pose), "cc")
    return batch.save(tmp_path_factory.mktemp("field") / "moving.h5")


def test_radiation_pressure_is_twice_the_energy_density_of_a_plane_wave():
    # |p| = 2000 Pa: <p^2> = 2e6 Pa^2, E = 2e6 / (1.204 * 343^2) = 14.12 Pa, twice that on a reflector
    assert radiation_pressure(np.array(2000j)) == pytest.approx(28.24, abs=0.01)
    with pytest.raises(StrategyError, match="air_density"):
        radiation_pressure(1.0, air_density=0.0)


def test_means_are_those_of_frames_one_by_one():
    transducers = TransducerSet("emulator")
    focus = np.float32([[0.02, 0, 0.2], [-0.02, 0.01, 0.2], [0, 0, 0.15]])
    drive = complex_drives(drive_focus(FocalPoints(focus, np.float32([1, 0.5, 1])), "emulator"), transducers)
    place = np.random.default_rng(1).uniform([-0.05, -0.05, 0.1], [0.05, 0.05, 0.3], (50, 3))
    mean, most = mean_square(PressureSum(transducers), place, drive)
    square = np.abs(drive @ transducers.waves(place).T) ** 2
    assert mean == pytest.approx(square.mean(axis=0), rel=1e-3)
    assert most == pytest.approx(square.max(axis=0), rel=1e-3)


def test_force_on_a_plane_is_what_passes_through_it():
    """The momentum of the beam: far in front of one focus, the force on a wide plane does not depend on its height."""
    transducers = TransducerSet("emulator")
    drive = complex_drives(
        drive_focus(FocalPoints(np.float32([[0, 0, 0.4]]), np.ones(1, np.float32)), "emulator"), transducers
    )
    force = []
    for height in (0.3, 0.4):
        plane = sample_plane(np.array([0, 0, height]), X, Y, (0.5, 0.5), 2e-3)
        force.append(print_on([plane], PressureSum(transducers), drive, pressure_at_1m=3.4).force)
    assert force[0] == pytest.approx(force[1], rel=0.02)


def test_a_print_has_the_radiation_pressure_of_its_field():
    plane = sample_plane(np.array([0, 0, 0.2]), X, Y, (0.04, 0.04), 5e-3)
    drive = drive_focus(FocalPoints(np.float32([[0, 0, 0.2]]), np.ones(1, np.float32)), "emulator")
    transducers = TransducerSet("emulator")
    printed = print_on([plane], PressureSum(transducers), complex_drives(drive, transducers), pressure_at_1m=3.4)
    pressure = pressure_at(plane.points, drive, pressure_at_1m=3.4)[0]
    assert printed.radiation[0].ravel() == pytest.approx(radiation_pressure(pressure), rel=1e-3)


def test_points_along_lines_stand_for_equal_lengths_and_distances_are_to_the_nearest():
    along = points_along([SQUARE], 1e-3)
    assert along.shape == (70, 3)
    assert along[:2, 0].tolist() == pytest.approx([0.0005, 0.0015])
    got = distance_to([SQUARE], np.array([[0.02, 0.01, 0.2], [0.05, 0.03, 0.2]]), 1e-4)
    assert got == pytest.approx([0.01, 0.01], rel=2e-3)
    assert np.isinf(distance_to([], SQUARE, 1e-3)).all()
    assert unevenness(np.array([1.0, 3.0])) == 0.5
    assert unevenness(np.zeros(0)) is None


def test_poses_are_found_by_time_and_drawn_for_a_cycle_a_pose_or_an_instant(moving, still):
    sampling = sampling_for(None, RIG)
    with ContourFile(moving) as file:
        assert pose_at(file, 0.0) == 0
        assert pose_at(file, 4.5 / 90) == 4
        with pytest.raises(StrategyError, match=r"at must lie in 0\.\.0\.1 s"):
            pose_at(file, 0.2)
        with pytest.raises(StrategyError, match=r"pose must lie in 0\.\.8"):
            drawn_pose(file, 9)
        assert 0 <= longest_pose(file) < 9
        drawn = drawn_pose(file, 4)
    length = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in drawn.polylines())
    assert len(cycle_of(drawn, sampling).intensity) == np.ceil(length / 7 * 10e3 - 1e-3)
    of_pose, lead = frames_of_average(moving, drawn, None, "pose", sampling, RIG)
    assert (len(of_pose.intensity), lead) in ((111, 0), (112, 0))
    late, lead = frames_of_average(moving, drawn, 0.05, "instant", sampling, RIG, Resonance())
    assert (len(late.intensity), lead) == (26, 25)
    whole = render("cube", Palm(), HandMotion.load(moving), "cc").sample("stm")
    assert late.position == pytest.approx(whole.position[475:501], abs=1e-6)
    with ContourFile(still) as file, pytest.raises(StrategyError, match="needs poses with times"):
        frames_of_average(still, drawn_pose(file, 0), None, "instant", sampling, RIG)


def test_metrics_of_a_still_pose_are_those_of_its_foci(still):
    found = pressure_metrics(still)
    assert found.poses == 1
    assert 2500 < found.focus_pressure_least < found.focus_pressure < 3700
    assert 0.003 < found.force < 0.03  # [N]
    assert 0.8 < found.share_on_contour < 1.0
    assert 0.01 < found.elsewhere < 0.3
    assert 0.93 < found.speed_factor < 0.99
    louder = pressure_metrics(still, pressure_at_1m=6.8)
    assert louder.focus_pressure == pytest.approx(2 * found.focus_pressure, rel=1e-6)
    assert louder.force == pytest.approx(4 * found.force, rel=1e-6)
    assert louder.share_on_contour == pytest.approx(found.share_on_contour, rel=1e-6)
    slower = pressure_metrics(still, resonance=Resonance(pole=300.0))
    assert slower.speed_factor < found.speed_factor - 0.05


def test_metrics_are_of_a_seeded_sample_of_poses_with_contours(tmp_path):
    path = render("tube", Palm(0.05, 0.05), exploration("tube", duration=2.0, rate=10.0), "oc").save(
        tmp_path / "tube.h5"
    )
    found, again, other = (pressure_metrics(path, poses=1, seed=seed) for seed in (1, 1, 2))
    assert found == again
    assert found.force != other.force
    assert found.poses == 1


def test_several_focal_points_have_less_pressure_each(still):
    assert pressure_metrics(still, sampling="multi-focus").focus_pressure < 0.8 * pressure_metrics(still).focus_pressure
