"""Sums of waves against a float64 oracle with Bessel functions, closed forms, and two packages of others."""

import json
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from drive_cases import RADIUS, WAVELENGTH, flat_array, tilted_array
from field_oracles import wave_matrix

from palpate.kernels.acoustics.pressure_sum import pack_sources, sum_waves, write_waves

ARRAYS = {"flat": flat_array, "tilted": tilted_array}
PEERS = Path(__file__).parent


def points_above(count, rng):
    return rng.uniform([-0.1, -0.1, 0.03], [0.1, 0.1, 0.4], (count, 3)).astype(np.float32)


def summed(points, position, normal, drive, *, device, radius=RADIUS, wavelength=WAVELENGTH):
    sources = pack_sources(position, normal, drive, wavelength=wavelength, radius=radius, device=device)
    out = wp.empty(len(points), dtype=wp.vec2, device=device)
    sum_waves(wp.array(np.asarray(points, np.float32), dtype=wp.vec3, device=device), sources, out=out)
    return out.numpy().astype(float) @ [1, 1j]


@pytest.mark.parametrize("radius", [RADIUS, 0.0])
@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("focused", [True, False])
def test_sums_are_those_of_bessel_functions(name, radius, focused, device, rng):
    position, normal = ARRAYS[name]()
    points = points_above(1003, rng)
    turn = np.linalg.norm(position - points[7], axis=1) / WAVELENGTH if focused else rng.uniform(0, 1, len(position))
    drive = rng.uniform(0.2, 1, len(position)) * np.exp(2j * np.pi * turn)
    waves = wave_matrix(points.astype(float), position.astype(float), normal, wavelength=WAVELENGTH, radius=radius)
    wanted = waves @ drive
    got = summed(points, position, normal, drive, device=device, radius=radius)
    error = np.abs(got - wanted)
    assert (error / (np.abs(waves) @ np.abs(drive))).max() < 2e-5
    assert np.sqrt((error**2).mean() / (np.abs(wanted) ** 2).mean()) < 1e-4


@pytest.mark.parametrize("name", ARRAYS)
def test_single_waves_are_those_of_bessel_functions(name, device, rng):
    position, normal = ARRAYS[name]()
    count, points = len(position), points_above(33, rng)
    sources = pack_sources(position, normal, wavelength=WAVELENGTH, radius=RADIUS, device=device)
    out = wp.full((33, 2 * count + 3), 7.0, dtype=wp.float32, device=device)
    write_waves(wp.array(points, dtype=wp.vec3, device=device), sources, out=out)
    got = out.numpy().astype(float)
    assert (got[:, 2 * count :] == 7).all()  # what lies beyond is left
    wanted = wave_matrix(points.astype(float), position.astype(float), normal, wavelength=WAVELENGTH, radius=RADIUS)
    error = np.abs(got[:, :count] + 1j * got[:, count : 2 * count] - wanted)
    assert (error / np.abs(wanted)).max() < 2e-4  # at the edge of the main lobe waves are weak
    assert error.max() < 1e-4 * np.abs(wanted).max()


def test_what_a_piston_radiates_through_a_sphere_is_the_integral_of_its_directivity(device):
    k, radius = 2 * np.pi / WAVELENGTH, 4.5e-3
    cosine, weight = np.polynomial.legendre.leggauss(48)
    cosine, weight = (cosine + 1) / 2, weight / 2  # of the half-space before it
    turn = 2 * np.pi * np.arange(16) / 16
    sine = np.sqrt(1 - cosine**2)
    sphere = np.stack(
        [np.outer(sine, np.cos(turn)), np.outer(sine, np.sin(turn)), np.tile(cosine[:, None], 16)], axis=-1
    )
    got = summed(0.5 * sphere.reshape(-1, 3), np.zeros((1, 3)), [[0, 0, 1]], np.ones(1), device=device, radius=radius)
    power = 2 * np.pi * (np.abs(got.reshape(48, 16)) ** 2 * 0.5**2).mean(axis=1) @ weight
    # integral of (2 J1(x) / x)^2 over the half-space: 4 pi / (ka)^2 (1 - J1(2 ka) / ka), Kinsler & Frey
    from scipy.special import j1

    ka = k * radius
    assert power == pytest.approx(4 * np.pi / ka**2 * (1 - j1(2 * ka) / ka), rel=2e-5)


def grid_of_peers():
    axis = (np.arange(16) - 7.5) * 10.5e-3
    y, x = np.meshgrid(axis, axis, indexing="ij")
    position = np.stack([x.ravel(), y.ravel(), np.zeros(256)], axis=1)
    drive = np.exp(2j * np.pi * 40e3 / 343 * np.linalg.norm(position - [0.03, -0.02, 0.2], axis=1))
    return position, np.tile([0.0, 0.0, 1.0], (256, 1)), drive


def values_of(peer):
    rows = np.array(json.loads((PEERS / f"{peer}.json").read_text())["rows"])
    return rows[:, :3], rows[:, 3] + 1j * rows[:, 4]


def test_levitate_has_the_same_pressures(device):
    """levitate 3.0.0, float64, exact Bessel function: benchmarks/pressure_peers.py made the table."""
    points, wanted = values_of("levitate")
    position, normal, drive = grid_of_peers()
    got = summed(points, position, normal, drive, device=device, wavelength=343 / 40e3)
    assert abs(wanted[0]) > 1000  # the focus
    assert np.abs(got - wanted).max() < 1e-4 * np.abs(wanted).max()
    assert np.linalg.norm(got - wanted) < 1e-4 * np.linalg.norm(wanted)
    assert np.median(np.abs(got - wanted) / np.abs(wanted)) < 1e-4


def test_acoustools_has_the_same_pressures_by_its_own_series_of_the_directivity(device):
    """AcousTools 1.2.0 has 1 - x^2 / 8 + x^4 / 192 for 2 J1(x) / x, wrong by half at 90 degrees: with it, too."""
    points, wanted = values_of("acoustools")
    position, normal, drive = grid_of_peers()
    sources = pack_sources(position, normal, drive, wavelength=343 / 40e3, radius=0.0, device=device)
    square = (2 * np.pi * 40e3 / 343 * 4.5e-3) ** 2
    sources = sources._replace(directivity=wp.vec4(-square / 8, square**2 / 192, 0.0, 0.0))
    out = wp.empty(len(points), dtype=wp.vec2, device=device)
    sum_waves(wp.array(points.astype(np.float32), dtype=wp.vec3, device=device), sources, out=out)
    got = out.numpy().astype(float) @ [1, 1j]
    assert np.abs(got - wanted).max() < 1e-4 * np.abs(wanted).max()
    assert np.linalg.norm(got - wanted) < 1e-4 * np.linalg.norm(wanted)
