"""The field oracle beside values worked by hand; decoded bytes, propagated back, meet in phase at the asked point."""

import numpy as np
import pytest
from board_outputs import emulator_drives, emulator_slots
from drive_cases import RADIUS, WAVELENGTH, random_foci
from field_oracles import pressure_of, wave_matrix
from scipy.special import j1

from palpate.device.codec import encode_frames
from palpate.device.registry import array_model
from palpate.render.playback.drive import Driver, DriveStrategy, drive_focus
from palpate.render.sampling.metrics import FocalPoints

POINT = np.array([0.03, -0.02, 0.2])  # [m]
UP = np.array([[0.0, 0.0, 1.0]])


def field_of(drives, points, radius=RADIUS):
    """Complex pressure at points [point, 3] of the first frame, by way of the wire."""
    delay, level = emulator_drives(encode_frames(drives.delay[:1], drives.amplitude[:1], array="emulator"))
    normal = np.tile(UP, (256, 1))
    waves = wave_matrix(points, emulator_slots(), normal, wavelength=WAVELENGTH, radius=radius)
    return pressure_of(waves, delay[0], level[0]), np.abs(waves).sum(axis=-1)


def test_oracle_of_one_transducer_gives_values_worked_by_hand():
    # from (0, 0, 0): r = sqrt(0.0413) m = 0.2032240 m = 23.6995935 wavelengths, so exp(-2 pi j 0.6995935) / r;
    # x = k a sin = 3.2972984 x 0.1774176 = 0.5849987, and 2 J1(x) / x = 1 - x^2/8 + x^4/192 - ... = 0.9578277
    monopole = wave_matrix(POINT[None], np.zeros((1, 3)), UP, wavelength=WAVELENGTH, radius=0.0)[0, 0]
    piston = wave_matrix(POINT[None], np.zeros((1, 3)), UP, wavelength=WAVELENGTH, radius=RADIUS)[0, 0]
    assert monopole == pytest.approx(-1.5325209 + 4.6759443j, abs=1e-6)
    assert piston == pytest.approx(-1.4678910 + 4.4787490j, abs=1e-6)


@pytest.mark.parametrize("radius", [RADIUS, 0.0])
def test_decoded_bytes_meet_in_phase_at_an_asymmetric_point(radius):
    drives = drive_focus(FocalPoints(POINT[None].astype(np.float32), np.ones(1, np.float32)), array_model("emulator"))
    (field,), (bound,) = field_of(drives, POINT[None], radius)
    assert field.real / bound == pytest.approx(1.0, abs=2e-4)  # what 8 bits leave
    assert abs(field.imag) / bound < 1e-3
    mirrored, _ = field_of(drives, POINT[None] * [-1, 1, 1], radius)
    assert np.abs(mirrored[0]) < 0.2 * bound


def test_decoded_bytes_of_several_foci_have_the_asked_pressures():
    points = np.float32([[[0.03, -0.02, 0.2], [-0.03, 0.01, 0.18], [0.0, 0.035, 0.22]]])
    intensity = np.float32([[1.0, 0.5, 0.75]])
    drives = Driver(array_model("emulator")).drive(FocalPoints(points, intensity))
    field, _ = field_of(drives, points[0].astype(float))
    ratio = np.abs(field) / intensity[0]
    assert ratio / ratio.mean() == pytest.approx(np.ones(3), abs=0.02)
    elsewhere, _ = field_of(drives, points[0].astype(float) * [-1, -1, 1])
    assert np.abs(elsewhere).mean() < 0.3 * np.abs(field).mean()


# docs/guide/sampling.md: rms error of amplitudes by the number of points
DOCUMENTED = {
    "naive": [0.207, 0.181, 0.195, 0.212, 0.222, 0.227, 0.238],
    "gs-pat": [0.092, 0.037, 0.042, 0.048, 0.053, 0.059, 0.061],
    "gs-pat+wgs": [0.005, 0.014, 0.006, 0.008, 0.010, 0.012, 0.013],
    "wgs": [0.004, 0.010, 0.003, 0.005, 0.006, 0.007, 0.008],
}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("solver", DOCUMENTED)
@pytest.mark.parametrize("size", range(2, 9))
def test_amplitudes_of_several_points_are_as_even_as_documented(size, solver):
    points = random_foci(np.random.default_rng(3), 600, size)
    driver = Driver(array_model("emulator"), DriveStrategy(solver=solver))
    drives = driver.drive(FocalPoints(points, np.ones((600, size), np.float32)))
    delay, level = emulator_drives(encode_frames(drives.delay, drives.amplitude, array="emulator"))
    assert (level == level[0]).all()
    way = np.linalg.norm(points[:, :, None].astype(float) - emulator_slots(), axis=-1)
    sine = np.sqrt(1 - (points[:, :, None, 2] / way) ** 2)
    x = 2 * np.pi / WAVELENGTH * RADIUS * np.maximum(sine, 1e-9)
    field = (2 * j1(x) / x / way * np.exp(-2j * np.pi * (way / WAVELENGTH + delay[:, None]))).sum(axis=-1)
    amplitude = np.abs(field) / np.abs(field).mean(axis=1, keepdims=True)
    assert np.sqrt(((amplitude - 1) ** 2).mean()) == pytest.approx(DOCUMENTED[solver][size - 2], rel=0.1, abs=1e-3)
