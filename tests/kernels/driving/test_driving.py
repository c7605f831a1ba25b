"""Kernels of drives against float64 oracles: waves, focus, solvers, gauge, slew; values worked by hand."""

import numpy as np
import pytest
import warp as wp
from drive_cases import RADIUS, SOLVERS, WAVELENGTH, flat_array, random_foci, tilted_array, turned
from field_oracles import amplitude_error, limit_slew, lock_gauge, solve_frame, unit, wave_matrix
from scipy.special import j1

from palpate.kernels.driving import slew
from palpate.kernels.driving.solve import SIZES, solve_points
from palpate.kernels.driving.wave import piston_polynomial, transducers_on

ARRAYS = {"flat": flat_array, "tilted": tilted_array}


@pytest.mark.parametrize("ka", [0.0, 1.0, 3.3, 4.0])
def test_piston_polynomial_is_the_directivity_of_a_piston(ka):
    s = np.linspace(0, 1, 500)
    x = np.maximum(ka * np.sqrt(s), 1e-9)
    fitted = 1 + s[:, None] ** np.arange(1, 5) @ piston_polynomial(ka)
    assert np.abs(fitted - 2 * j1(x) / x).max() < 3e-5


def solved(device, array, points, target, solver):
    transducers = transducers_on(*array, wavelength=WAVELENGTH, radius=RADIUS, device=device)
    gs_pat, wgs = SOLVERS[solver]
    points = wp.array(points, dtype=wp.vec3, device=device)
    target = wp.array(target, dtype=wp.float32, device=device)
    return solve_points(points, target, transducers, gs_pat=gs_pat, wgs=wgs).numpy()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("name", ARRAYS)
def test_solvers_equal_their_oracles(name, size, solver, device, rng):
    array = ARRAYS[name]()
    count = 70 if size == 4 else 12  # more than one table of waves
    points, target = random_foci(rng, count, size), rng.uniform(0.5, 1, (count, size)).astype(np.float32)
    if size > 2:
        target[::5, -1] = 0  # a frame of fewer points
    delay = solved(device, array, points, target, solver)
    assert delay.min() >= 0
    assert delay.max() < 1
    apart, errors = [], []
    for frame, got in enumerate(delay):
        live = target[frame] > 0
        waves = wave_matrix(points[frame, live].astype(float), *array, wavelength=WAVELENGTH, radius=RADIUS)
        wanted = target[frame, live].astype(float)
        gs_pat, wgs = SOLVERS[solver]
        exact = solve_frame(waves, wanted, gs_pat=gs_pat, wgs=wgs)
        apart.append(turned(got - exact).max())
        errors.append(amplitude_error(waves, got, wanted) - amplitude_error(waves, exact, wanted))
    assert np.median(apart) < 2e-4  # turns; more where a transducer is hardly driven and its phase means little
    assert np.abs(errors).max() < 3e-3


def test_solvers_reach_what_is_published(device, rng):
    array, points = flat_array(), random_foci(rng, 150, 4)
    target = np.ones((150, 4), np.float32)
    waves = wave_matrix(points.astype(float), *array, wavelength=WAVELENGTH, radius=RADIUS)
    median = {}
    for solver in SOLVERS:
        quantised = np.rint(solved(device, array, points, target, solver) * 256) / 256
        median[solver] = np.median(amplitude_error(waves, quantised, target))
    assert median["naive"] < 0.25
    assert median["gs-pat"] < 0.045
    assert median["gs-pat+wgs"] < 0.005
    assert median["wgs"] < 0.002


def wandering(rng, frame_count=3500, jumps=(700, 1020, 1023, 1024, 1025, 3000)):
    """Delays [turns] that wander, jump by anything, and are turned as a whole at random, [frame, 37]."""
    delay = rng.normal(0, 0.002, (frame_count, 37)).cumsum(axis=0)
    for frame in jumps:
        delay[frame:] += rng.uniform(0, 1, 37)
    delay[2000:2100] += rng.uniform(0, 1, (100, 37))  # never caught up with
    return ((delay + rng.uniform(0, 1, (frame_count, 1))) % 1).astype(np.float32) % np.float32(1)


def test_gauge_follows_the_frame_before(device, rng):
    raw = wandering(rng)
    delay, before = (wp.array(a, dtype=wp.float32, device=device) for a in (raw, raw[0]))
    slew.lock_gauge(delay, before=before, turned=0.0)
    locked = delay.numpy()
    assert turned(locked - lock_gauge(raw)).max() < 1e-4
    phasor = np.exp(-2j * np.pi * locked.astype(float))
    along = (phasor[1:] * phasor[:-1].conj()).sum(axis=1)
    assert np.abs(np.angle(along)[np.abs(along) > 1]).max() < 1e-3
    changes = locked - raw  # every frame was turned as a whole
    assert np.abs(unit(np.exp(2j * np.pi * changes).sum(axis=1))[:, None] - np.exp(2j * np.pi * changes)).max() < 1e-4


def test_slew_is_limited_in_chunks_as_frame_by_frame(device, rng, monkeypatch):
    target, step = lock_gauge(wandering(rng)).astype(np.float32), 4 / 256
    wanted = limit_slew(target.astype(float), step, target[0])
    arguments = [wp.array(a, dtype=wp.float32, device=device) for a in (target, target[0])]
    delay = slew.limit_slew(arguments[0], before=arguments[1], step=step).numpy()
    assert turned(delay - wanted).max() < 1e-5
    steps = turned(np.diff(delay, axis=0))
    assert steps.max() < step + 1e-6
    assert steps.max() > 0.9 * step
    assert turned(delay - target)[1010:1020].max() == 0  # 310 frames after a jump it is taken exactly
    monkeypatch.setattr(slew, "CHUNK", 16)  # which jumps outlast
    np.testing.assert_array_equal(slew.limit_slew(arguments[0], before=arguments[1], step=step).numpy(), delay)
    short, changed = wp.empty_like(arguments[0]), wp.zeros(1, dtype=wp.int32, device=device)
    for mends in range(100):  # as CUDA does it, on any device
        changed.zero_()
        parts = -(-len(target) // 16)
        inputs = [*arguments, step, 16, min(mends, 1)]
        wp.launch(slew._limit_slew, (parts, 37), inputs, [short, changed], device=device, block_dim=slew.BLOCK)
        if mends and not changed.numpy()[0]:
            break
    np.testing.assert_array_equal(short.numpy(), delay)


def test_slew_goes_the_short_way_over_the_wrap(device):
    """Forwards, and backwards."""
    target = wp.array(np.float32([[0.98, 0.02], [0.02, 0.98], [0.02, 0.98]]), device=device)
    before = wp.array(np.float32([0.96, 0.04]), device=device)
    delay = slew.limit_slew(target, before=before, step=0.03).numpy()
    np.testing.assert_allclose(delay, [[0.98, 0.02], [0.01, 0.99], [0.02, 0.98]], atol=1e-6)
