"""Drives as data and block by block: strategies, several focal points, several arrays, silence, gauge and slew."""

from dataclasses import replace

import numpy as np
import pytest
from drive_cases import RADIUS, WAVELENGTH, random_foci, turned
from field_oracles import pressure_of, wave_matrix

from palpate.device.registry import array_model
from palpate.kernels.driving.solve import solve_points
from palpate.render.errors import StrategyError
from palpate.render.playback import drive as drive_module
from palpate.render.playback.drive import Driver, DriveStrategy, drive_focus
from palpate.render.sampling.metrics import FocalPoints

EMULATOR = array_model("emulator")


def foci(position, intensity=1.0):
    position = np.asarray(position, np.float32)
    return FocalPoints(position, np.broadcast_to(np.float32(intensity), position.shape[:-1]).copy())


def circle(frame_count, *, speed=7.0, rate=10e3, radius=0.03, height=0.2):
    angle = np.arange(frame_count) * speed / rate / radius
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full(frame_count, height)])


def four_on_circle(frame_count):
    """Four points that go round, of unlike intensities, [frame, 4]."""
    angle = np.arange(frame_count)[:, None] * 7e-4 / 0.03 + np.arange(4) * np.pi / 2
    position = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), np.full(angle.shape, 0.2)], axis=-1)
    return FocalPoints(position.astype(np.float32), np.tile(np.float32([1, 0.8, 0.6, 0.9]), (frame_count, 1)))


def test_strategy_survives_json():
    for strategy in (DriveStrategy(), DriveStrategy("force", "wgs", None, 7, 4 / 256, 340.0, 0.5, 0.0)):
        assert DriveStrategy.from_json(strategy.to_json()) == strategy
    with pytest.raises(StrategyError, match="unknown field 'gain'; known: a"):
        DriveStrategy.from_json('{"gain": 1}')


def test_value_out_of_its_range_is_refused():
    for values, message in (
        ({"amplitude": "power"}, "amplitude must be one of pressure, force, not 'power'"),
        ({"solver": "lm"}, "solver must be one of naive, gs-pat, wgs, gs-pat\\+wgs, not 'lm'"),
        ({"sound_speed": 34300.0}, "sound_speed .*300..400 m/s .*34300"),
        ({"sound_speed": float("nan")}, "sound_speed .*300..400 m/s .*nan"),
        ({"slew": 0.0}, "slew must lie in 1e-06..0.5 turns a period, not 0.0"),
        ({"slew": "4/256"}, "slew must be a number in .*'4/256'"),
        ({"level_max": 1.5}, "level_max must lie in 0.001..1 of full amplitude, not 1.5"),
        ({"piston_radius": 0.01}, "piston_radius must lie in 0..0.0055 m, not 0.01"),
        ({"wgs_iterations": 0}, "wgs_iterations must lie in 1..1000, not 0"),
        ({"solver": "gs-pat", "wgs_iterations": 5}, "wgs_iterations is 5, but solver 'gs-pat' has no such"),
    ):
        with pytest.raises(StrategyError, match=message):
            DriveStrategy(**values)


def test_intensity_is_pressure_or_force_and_scaled_to_the_level():
    focus = foci([[0, 0, 0.2]] * 3, [0.0, 0.25, 1.0])
    assert Driver(EMULATOR).drive(focus).amplitude.tolist() == [0, 0.25, 1]
    assert Driver(EMULATOR, DriveStrategy(amplitude="force")).drive(focus).amplitude.tolist() == [0, 0.5, 1]
    assert Driver(EMULATOR, DriveStrategy(level_max=0.5)).drive(focus).amplitude.tolist() == [0, 0.125, 0.5]


@pytest.mark.parametrize("amplitude", ["pressure", "force"])
def test_pressures_at_several_points_are_in_the_ratio_of_their_intensities(amplitude, device, rng):
    points = random_foci(rng, 40, 3)
    intensity = rng.uniform(0.3, 0.9, (40, 3)).astype(np.float32)
    driver = Driver(EMULATOR, DriveStrategy(amplitude=amplitude, solver="wgs", wgs_iterations=40), device=device)
    drives = driver.drive(FocalPoints(points, intensity))
    wanted = np.sqrt(intensity) if amplitude == "force" else intensity
    assert drives.amplitude == pytest.approx(wanted.max(axis=1))
    waves = wave_matrix(points.astype(float), EMULATOR.position, EMULATOR.normal, wavelength=WAVELENGTH, radius=RADIUS)
    reached = np.abs(pressure_of(waves, drives.delay, drives.amplitude[:, None])) / wanted
    assert np.median(reached.std(axis=1) / reached.mean(axis=1)) < 5e-3
    single = np.abs(waves).sum(axis=2)
    assert (reached / single).mean() > 0.4  # of what each would have alone: about 1 / sqrt(3)
    driver.reset()
    half = driver.drive(FocalPoints(points, wanted**2 / 4 if amplitude == "force" else intensity / 2))
    assert half.amplitude == pytest.approx(drives.amplitude / 2)
    assert np.median(turned(half.delay - drives.delay)) < 1e-4


@pytest.mark.exhaustive
@pytest.mark.parametrize("block", [1, 3, 97, 600])
@pytest.mark.parametrize("several", [False, True])
def test_frames_are_the_same_in_blocks_of_any_size(several, block, device):
    focus = four_on_circle(600) if several else foci(circle(600))
    focus.position[100:130] = np.nan
    focus.position[300:, ...] += np.float32([0.03, 0.02, 0.01])
    focus.intensity[400:430] = 0
    strategy = DriveStrategy(slew=2 / 256)
    whole = Driver(EMULATOR, strategy, update_rate=10e3, device=device).drive(focus)
    driver = Driver(EMULATOR, strategy, update_rate=10e3, device=device)
    parts = [
        driver.drive(FocalPoints(focus.position[i : i + block], focus.intensity[i : i + block]))
        for i in range(0, 600, block)
    ]
    assert turned(np.concatenate([part.delay for part in parts]) - whole.delay).max() < 1e-6
    np.testing.assert_array_equal(np.concatenate([part.amplitude for part in parts]), whole.amplitude)
    assert sum(part.refused for part in parts) == whole.refused == 30 * (4 if several else 1)


def test_points_out_of_reach_among_several_are_silenced_alone(device):
    bad = [(np.nan, 0, 0.2), (np.inf, 0, 0.2), (0, 0, -0.1), (0.00525, 0.00525, 0), (1, 0, 0.2)]
    focus = four_on_circle(7)
    focus.position[:5, 1] = bad
    focus.intensity[5, :] = np.nan
    drives = Driver(EMULATOR, device=device).drive(focus)
    assert drives.refused == 5 + 4
    assert np.isfinite(drives.delay).all()
    assert drives.delay.min() >= 0
    assert drives.delay.max() <= 1
    assert drives.amplitude.tolist() == [1, 1, 1, 1, 1, 0, 1]
    others = [0, 2, 3]
    waves = wave_matrix(
        focus.position[:5, others].astype(float),
        EMULATOR.position,
        EMULATOR.normal,
        wavelength=WAVELENGTH,
        radius=RADIUS,
    )
    reached = np.abs(pressure_of(waves, drives.delay[:5])) / focus.intensity[:5, others]
    assert (reached.std(axis=1) / reached.mean(axis=1) < 0.05).all()


def test_points_out_of_reach_that_are_meant_to_be_silent_do_not_count_as_refused():
    drives = Driver(EMULATOR).drive(foci([[9, 9, 9], [9, 9, 9], [np.nan] * 3], [1, 0, 0]))
    assert drives.refused == 1
    assert drives.amplitude.tolist() == [0] * 3


def test_gauge_keeps_several_moving_points_from_turning_the_array(device):
    focus = four_on_circle(400)
    focus.intensity[200:250] = 0  # silent frames are solved for equal points
    drives = Driver(EMULATOR, DriveStrategy(solver="gs-pat"), device=device).drive(focus)
    along = np.exp(2j * np.pi * np.diff(drives.delay.astype(float), axis=0)).sum(axis=1)
    assert np.abs(np.angle(along)).max() < 1e-3
    changes = turned(np.diff(drives.delay, axis=0)).mean(axis=1)
    assert np.median(changes) < 0.03
    assert changes.max() < 0.1


def test_slew_follows_a_focus_and_stretches_its_jump(device):
    path = circle(400, rate=40e3)
    path[200:] -= [0.06, 0, 0]
    limited = Driver(EMULATOR, DriveStrategy(slew=4 / 256), update_rate=40e3, device=device).drive(foci(path))
    plain = Driver(EMULATOR).drive(foci(path))
    assert turned(np.diff(limited.delay, axis=0)).max() < 4 / 256 + 1e-6
    assert turned(np.diff(plain.delay, axis=0)).max() > 0.4
    apart = (limited.delay - plain.delay).astype(float)
    common = np.angle(np.exp(2j * np.pi * apart).sum(axis=1, keepdims=True)) / (2 * np.pi)  # the gauge, which is locked
    differs = turned(apart - common).max(axis=1) > 1e-5
    assert not differs[:200].any()  # 7 m/s is slower than the limit
    assert differs[200:210].all()
    assert not differs[300:].any()  # what is left of the limit beyond the motion catches up
    slow = Driver(EMULATOR, DriveStrategy(slew=4 / 256), update_rate=10e3, device=device).drive(foci(path))
    assert turned(np.diff(slow.delay, axis=0)).max() == pytest.approx(4 * 4 / 256, abs=1e-5)  # 4 periods a frame


@pytest.mark.parametrize("rate", [10e3, 40e3])
def test_slew_keeps_a_focus_that_rises_and_falls(rate, device):
    x, y, z = circle(600, rate=rate).T
    path = np.column_stack([x, z - 0.2, 0.2 + y])  # a ring that stands upright: 7 m/s to and from the array
    limited = Driver(EMULATOR, DriveStrategy(slew=4 / 256), update_rate=rate, device=device).drive(foci(path))
    plain = Driver(EMULATOR).drive(foci(path))
    assert turned(np.diff(plain.delay, axis=0)).max() > 4 / 256 * 40e3 / rate  # by the phase that all share
    waves = wave_matrix(path[:, None], EMULATOR.position, EMULATOR.normal, wavelength=WAVELENGTH, radius=RADIUS)
    reached = [np.abs(pressure_of(waves, drives.delay))[:, 0] for drives in (limited, plain)]
    assert (reached[0] / reached[1]).min() > 0.99


@pytest.mark.parametrize(("slew", "rate", "refused"), [(0.5, 40e3, True), (0.49, 40e3, False), (4 / 256, 1250.0, True)])
def test_slew_that_would_limit_nothing_is_refused(slew, rate, refused):
    if not refused:
        Driver(EMULATOR, DriveStrategy(slew=slew), update_rate=rate)
        return
    with pytest.raises(StrategyError, match=f"below {0.5 * rate / 40e3:g} turns a period at {rate:g} Hz, not {slew:g}"):
        Driver(EMULATOR, DriveStrategy(slew=slew), update_rate=rate)


@pytest.fixture
def solved_count(monkeypatch):
    """Frames that the solver is given, block after block."""
    counts = []

    def counted(points, *args, **kwargs):
        counts.append(points.shape[0])
        return solve_points(points, *args, **kwargs)

    monkeypatch.setattr(drive_module, "solve_points", counted)
    return counts


@pytest.mark.parametrize("amplitude", ["pressure", "force"])
def test_still_points_are_solved_once_however_they_are_modulated(amplitude, device, solved_count):
    focus = four_on_circle(1)
    wave = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(400) / 200)
    focus = FocalPoints(np.repeat(focus.position, 400, axis=0), (focus.intensity * wave[:, None]).astype(np.float32))
    assert focus.intensity[200].max() == 0  # a silent frame keeps the phases, too
    driver = Driver(EMULATOR, DriveStrategy(amplitude=amplitude), device=device)
    drives = driver.drive(FocalPoints(focus.position[1:], focus.intensity[1:]))
    assert solved_count == [1]
    assert (drives.delay == drives.delay[:1]).all()
    level = 1 if amplitude == "pressure" else 0.5
    assert drives.amplitude == pytest.approx(wave[1:] ** level, abs=1e-6)


def test_frames_that_are_not_solved_anew_are_the_same_as_if_they_were(device, solved_count):
    focus = four_on_circle(60)
    held = np.repeat(np.arange(0, 60, 3), 3)
    focus = FocalPoints(focus.position[held], focus.intensity[held])
    focus.intensity[30:, 1] *= 0.5  # the ratio changes though no point moves
    focus.intensity[31:, 1] *= 0.5
    whole = Driver(EMULATOR, device=device).drive(focus)
    assert solved_count == [20 + 1]
    driver = Driver(EMULATOR, device=device)
    single = [driver.drive(FocalPoints(focus.position[i : i + 1], focus.intensity[i : i + 1])) for i in range(60)]
    apart = np.abs(whole.delay - np.concatenate([drives.delay for drives in single]))
    # to the bit on the CPU; CUDA sums a frame's phases in another order where there are many frames
    assert np.minimum(apart, 1 - apart).max() <= (0 if device == "cpu" else 1e-4)  # [turns]


def facing():
    """One array on the floor, and one 0.4 m above it that looks down."""
    return [EMULATOR, EMULATOR.placed([0.01, 0, 0.4, 1, 0, 0, 0])]


def test_waves_of_several_arrays_arrive_together():
    arrays, point = facing(), np.array([[0.03, -0.02, 0.21]])
    driver = Driver(arrays)
    drives = driver.drive(foci(point))
    position = np.concatenate([array.position for array in arrays])
    normal = np.concatenate([array.normal for array in arrays])
    assert normal[256:, 2] == pytest.approx(-1)
    waves = wave_matrix(point[:, None], position, normal, wavelength=WAVELENGTH, radius=RADIUS)
    field = pressure_of(waves, drives.delay)[0, 0]
    assert field.real == pytest.approx(np.abs(waves).sum(), rel=1e-4)
    assert abs(field.imag) < 1e-3 * field.real
    below, above = driver.split(drives)
    assert below.delay.shape == above.delay.shape == (1, 256)
    np.testing.assert_array_equal(below.delay, drive_focus(foci(point), EMULATOR).delay)


def test_what_cannot_be_driven_is_refused():
    with pytest.raises(StrategyError, match=r"position must have 1\.\.8 focal points a frame, not 9"):
        Driver(EMULATOR).drive(foci(np.zeros((2, 9, 3))))
    with pytest.raises(StrategyError, match=r"not \(2, 4\), \(2, 3\)"):
        Driver(EMULATOR).drive(FocalPoints(np.zeros((2, 4, 3), np.float32), np.zeros((2, 3), np.float32)))
    with pytest.raises(StrategyError, match=r"at least one and of one carrier, not \[\]"):
        Driver([])
    with pytest.raises(StrategyError, match=r"one carrier, not \[25000.0, 40000.0\]"):
        Driver([EMULATOR, replace(EMULATOR, carrier=25e3)])
    with pytest.raises(StrategyError, match=r"slew 0.1 needs an update_rate in 0..40000 Hz, not None"):
        Driver(EMULATOR, DriveStrategy(slew=0.1))
