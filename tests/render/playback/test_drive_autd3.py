"""Phases and fields against an independent implementation: the vendor's own package for AUTD3, and its emulator."""

from dataclasses import replace

import numpy as np
import pytest
from drive_cases import random_foci, turned
from field_oracles import amplitude_error, pressure_of, wave_matrix

from palpate.device.registry import array_model
from palpate.render.playback.drive import Driver, DriveStrategy, drive_focus
from palpate.render.sampling.metrics import FocalPoints

pytest.importorskip("autd3", reason="autd3 is not installed: nothing to compare with")
pytest.importorskip("autd3_pattern", reason="autd3-pattern is not installed")
pytest.importorskip("autd3_pattern_holo", reason="autd3-pattern-holo is not installed")
pytest.importorskip("autd3_emulator", reason="autd3-emulator is not installed")
from autd3 import commands
from autd3_core import Autd3, Duration, Geometry, SamplingConfig, Velocity
from autd3_emulator import Emulator, Grid, RmsRecordOption
from autd3_pattern import PhaseBuffer, focus, wavelength
from autd3_pattern_holo import AmplitudeTarget, GspatOption, IntensityConstraint, Pa, gspat

SOUND_SPEED = 340.0  # [m/s]
WAVELENGTH = SOUND_SPEED / 40e3  # [m]
UNSMOOTHED = commands.SetSilencer(commands.FixedUpdateRate(65535, 65535))  # disable() still smooths long jumps (0.12.0)


@pytest.fixture(scope="module")
def geometry():
    return Geometry([Autd3()])


@pytest.fixture(scope="module")
def array(geometry):
    """An array whose transducers stand where theirs do."""
    position = np.asarray(geometry[0].positions(), np.float64) * 1e-3
    normal = np.tile(np.float32([0, 0, 1]), (len(position), 1))
    return replace(array_model("autd3"), position=position.astype(np.float32), normal=normal)


def monopoles(array, points):
    return wave_matrix(points, array.position, array.normal, wavelength=WAVELENGTH, radius=0.0)


def single_foci(array, rng, count):
    """Focal points above the array [m], the asymmetric one first."""
    spread = rng.uniform([-0.06, -0.05, 0.1], [0.06, 0.05, 0.3], (count - 1, 3))
    return (np.concatenate([[[0.03, -0.02, 0.2]], spread]) + array.position.mean(axis=0)).astype(np.float32)


def bytes_of(array, points):
    """Delays as AUTD3 takes them: uint8, shape [frame, transducer]."""
    focus_points = FocalPoints(points, np.ones(len(points), np.float32))
    model = replace(array, focal_zone=replace(array.focal_zone, lateral=1.0))
    return np.rint(drive_focus(focus_points, model, sound_speed=SOUND_SPEED).delay * 256).astype(np.uint16) & 255


def test_phases_of_a_focus_equal_theirs_within_one(geometry, array, rng):
    points = single_foci(array, rng, 100)
    apart = []
    for point, ours in zip(points, bytes_of(array, points), strict=True):
        theirs = geometry.phase_buffer()
        focus(geometry, point.astype(float) * 1e3, wavelength(Velocity.from_m_s(SOUND_SPEED)), theirs)
        apart.append(turned((ours - theirs.to_numpy()[0].astype(float)) / 256) * 256)
    assert np.max(apart) <= 1
    assert np.mean(np.array(apart) > 0) < 2e-3


def test_field_of_frames_played_by_their_emulator_has_our_shape(geometry, array, rng):
    points, divider = single_foci(array, rng, 5), 4
    frames = bytes_of(array, points).astype(np.uint8)
    pattern = commands.PatternStm(
        SamplingConfig(divider), [PhaseBuffer.from_array(f[None]) for f in frames], 255, commands.PatternStmOption()
    )

    def play(recorder):
        recorder.send(UNSMOOTHED)
        recorder.send(pattern)
        recorder.tick(Duration.from_millis(1))

    record = Emulator(geometry).record(play)
    phase = record.phase().to_numpy()
    np.testing.assert_array_equal(phase[:, : divider * 5], np.repeat(frames.T, divider, axis=1))
    middle = points[0].astype(float) * 1e3
    grid = Grid(*[(m - 10, m + 10) for m in middle[:2]], (middle[2] - 10, middle[2] + 10), 5.0, "xyz")
    recorded = record.sound_field(grid, RmsRecordOption(sound_speed=Velocity.from_m_s(SOUND_SPEED)))
    where = recorded.observe_points().to_numpy().astype(float) * 1e-3
    theirs = recorded.next(Duration.from_micros(25 * divider * 5)).to_numpy()[:, divider - 1 :: divider].T
    ours = np.abs(pressure_of(monopoles(array, where), frames / 256.0))
    constant = (theirs * ours).sum() / (ours * ours).sum()  # one for all frames
    assert np.abs(theirs - constant * ours).max() < 1e-3 * theirs.max()
    assert np.linalg.norm((where[theirs[0].argmax()] - points[0])[:2]) < 3e-3


@pytest.mark.parametrize(("solver", "median_most"), [("gs-pat", 0.04), ("gs-pat+wgs", 0.005)])
def test_four_foci_are_as_even_as_theirs(solver, median_most, geometry, array, rng, record_property):
    points = random_foci(rng, 60, 4) + array.position.mean(axis=0)
    waves = monopoles(array, points.astype(float))
    strategy = DriveStrategy(solver=solver, sound_speed=SOUND_SPEED, piston_radius=0.0)
    model = replace(array, focal_zone=replace(array.focal_zone, lateral=1.0))
    drives = Driver(model, strategy).drive(FocalPoints(points, np.ones((60, 4), np.float32)))
    ours = amplitude_error(waves, np.rint(drives.delay * 256) / 256, 1.0)
    uniform = GspatOption(constraint=IntensityConstraint.Uniform(255))
    theirs = []
    for frame in range(60):
        targets = [AmplitudeTarget(p.astype(float) * 1e3, 1300 * Pa) for p in points[frame]]
        phases, levels = geometry.phase_buffer(), geometry.intensity_buffer()
        gspat(geometry, targets, wavelength(Velocity.from_m_s(SOUND_SPEED)), uniform, phases, levels)
        theirs.append(amplitude_error(waves[frame], phases.to_numpy()[0] / 256.0, 1.0))
    record_property("amplitude_error_ours", float(np.median(ours)))
    record_property("amplitude_error_theirs", float(np.median(theirs)))
    assert np.median(ours) < median_most
    assert np.median(ours) < 1.1 * np.median(theirs)
