"""Wire bytes of focal points on every kind of array: those that the codec encodes of the drives, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from drive_cases import ARRAYS_OF_PHASES
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.device import (
    ArrayKind,
    ArrayKindError,
    FrameError,
    Layout,
    array_model,
    encode_frames,
    flat_array,
    flat_grid,
    linear_levels,
    pulse_levels,
    register_array,
    remove_array,
)
from palpate.render import Driver, DriveStrategy, FocalPoints
from palpate.render.errors import StrategyError
from palpate.render.playback import drive as drive_module
from palpate.render.playback.drive import REST, Drives, round_drives

PLACE = np.array([0.02, -0.01, 0.05, 0.0, 0.17364818, 0.0, 0.98480775])
EACH_BOARD = pytest.mark.parametrize("name", ARRAYS_OF_PHASES)


def orbits(rng, foci, count=300):
    """Focal points that move as contours do, some out of reach, silent or none for a while."""
    time, phase = np.arange(count)[:, None] / count, rng.uniform(0, 6.28, foci)
    around = [0.05 * np.cos(9 * time + phase), 0.05 * np.sin(8 * time + phase), 0.2 + 0.04 * np.sin(5 * time + phase)]
    position = np.stack(around, axis=-1).astype(np.float32)
    intensity = np.clip(0.5 + 0.6 * np.sin(40 * time + phase), 0, 1).astype(np.float32)
    position[:2], position[50:60], position[200:210, 0] = 0, 9, np.nan
    intensity[150:170], intensity[250, -1] = 0, np.nan
    return FocalPoints(position, intensity)


def calibrated(name, rng):
    model = array_model(name)
    count = model.transducer_count
    order = rng.permutation(count) if name != "autd3" else model.wire_order
    return replace(model, delay_offset=rng.random(count, np.float32), gain=model.gain * 0.9, wire_order=order)


def bytes_of(driver, focus, cuts=()):
    parts = []
    for first, stop in zip([0, *cuts], [*cuts, len(focus.intensity)], strict=True):
        packed = driver.pack(FocalPoints(focus.position[first:stop], focus.intensity[first:stop]))
        parts.append([frames.numpy() for frames in packed.frames])
    return [np.concatenate(own) for own in zip(*parts, strict=True)]


@pytest.mark.parametrize("foci", [1, 3])
@pytest.mark.parametrize("slew", [None, 0.004])
@EACH_BOARD
def test_bytes_are_those_of_the_drives(name, slew, foci, rng, device):
    strategy = DriveStrategy(amplitude="force", level_max=0.9, slew=slew)
    model, focus = calibrated(name, rng).placed(PLACE), orbits(rng, foci)
    first, second = (Driver(model, strategy, update_rate=10e3, device=device) for _ in range(2))
    drives, (found,) = first.drive(focus), bytes_of(second, focus, cuts=(1, 120, 121))
    np.testing.assert_array_equal(found, encode_frames(drives.delay, drives.amplitude, array=model))
    assert drives.refused > 0
    assert np.count_nonzero(drives.amplitude) > 100


def test_several_arrays_have_their_own_bytes_of_one_drive(rng, device):
    arrays = [array_model("pat16"), array_model("emulator").placed([0, 0, 0.4, 1, 0, 0, 0]), array_model("autd3")]
    for foci in (1, 4):
        focus = orbits(rng, foci)
        driver = Driver(arrays, device=device)
        parts = driver.split(driver.drive(focus))
        driver.reset()
        found = bytes_of(driver, focus)
        for model, part, own in zip(arrays, parts, found, strict=True):
            np.testing.assert_array_equal(own, encode_frames(part.delay, part.amplitude, array=model))


@pytest.mark.parametrize("strategy", [DriveStrategy(), DriveStrategy(slew=0.01)])
def test_a_gpu_is_at_most_a_step_apart_but_where_solutions_are_as_good(strategy, rng, device):
    """On the CPU nothing is apart; a GPU's roots and sums round otherwise."""
    focus = orbits(rng, 4)
    host, own = (
        Driver("emulator", strategy, update_rate=10e3, device=place).pack(focus).frames[0].numpy().astype(int)
        for place in ("cpu", device)
    )
    np.testing.assert_array_equal(own[:, 1::2], host[:, 1::2])
    apart = np.abs((own[:, 0::2] - host[:, 0::2] + 128) % 256 - 128)
    assert np.mean(apart <= 1) > (0.99 if device != "cpu" else 1 - 1e-9)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), cuts=st.sets(st.integers(1, 59), max_size=6))
def test_bytes_do_not_depend_on_how_frames_are_cut(seed, cuts):
    rng = np.random.default_rng(seed)
    focus = FocalPoints(
        rng.uniform([-0.2, -0.2, 0], [0.2, 0.2, 0.6], (60, 3)).astype(np.float32),
        np.where(rng.random(60) < 0.3, 0, rng.uniform(0, 1.1, 60)).astype(np.float32),
    )
    whole, cut = bytes_of(Driver("pat16"), focus), bytes_of(Driver("pat16"), focus, sorted(cuts))
    np.testing.assert_array_equal(cut[0], whole[0])


def test_a_silent_frame_aims_where_the_last_focal_point_was(device):
    place, aside = [0.03, -0.02, 0.2], [0.0, 0.01, 0.3]
    focus = FocalPoints(np.float32([[9, 9, 9], place, [9, 9, 9], [np.nan, 0, 0], aside]), np.float32([1, 1, 1, 1, 0]))
    drives = Driver("emulator", device=device).drive(focus)
    aims = [REST, place, place, place, aside]
    wanted = Driver("emulator", device=device).drive(FocalPoints(np.float32(aims), np.ones(5, np.float32)))
    np.testing.assert_array_equal(drives.delay, wanted.delay)
    assert drives.amplitude.tolist() == [0, 1, 0, 0, 0]
    assert drives.refused == 3


ODD_LAYOUTS = {
    "counted from the end": {"turn": 255, "delay_at": slice(-26, -13), "level_at": slice(-13, None)},
    "interleaved": {
        "turn": 100,
        "delay_at": slice(1, 27, 2),
        "level_at": slice(2, 28, 2),
        "levels": linear_levels(255),
    },
    "pulses": {"turn": 77, "levels": pulse_levels(38), "is_pulse_start": True},
    "switched": {"turn": 77, "levels": linear_levels(1), "level_at": None},
}


@pytest.mark.parametrize("form", ODD_LAYOUTS)
def test_arrays_of_other_layouts_have_the_bytes_of_their_drives(form, rng, device):
    model = flat_array("odd", flat_grid(13, 1, 5e-3), rng.permutation(13), frame_bytes=28, fifo_frames=64)
    model = replace(model, delay_offset=rng.uniform(-2, 2, 13).astype(np.float32), gain=rng.random(13, np.float32))
    plain = {"turn": 64, "delay_at": slice(1, 14), "level_at": slice(14, 27), "levels": linear_levels(255)}
    layout = Layout(**plain | ODD_LAYOUTS[form], fixed={0: 0xA5})
    register_array(ArrayKind(name="odd", build=lambda: model, layout=layout, open_link=lambda *_: None))
    try:
        for foci, slew in ((1, None), (3, None), (1, 0.01)):
            strategy, focus = DriveStrategy(slew=slew), orbits(rng, foci)
            first, second = (Driver(model, strategy, update_rate=10e3, device=device) for _ in range(2))
            drives, (found,) = first.drive(focus), bytes_of(second, focus)
            np.testing.assert_array_equal(found, encode_frames(drives.delay, drives.amplitude, array=model))
    finally:
        remove_array("odd")


def test_arrays_that_are_none_are_refused(rng):
    model = array_model("emulator")
    for changes, message in (
        ({"wire_order": np.zeros(256, np.intp)}, "must have each of its transducers once"),
        ({"gain": np.full(256, np.nan, np.float32)}, "must be finite"),
        ({"frame_bytes": 500}, r"delay_at is slice\(0, 512, 2\): 250 bytes of a frame of 500"),
    ):
        with pytest.raises((StrategyError, ArrayKindError), match=message):
            Driver(replace(model, **changes)).pack(orbits(rng, 1))
    with pytest.raises(StrategyError, match="no device 'xyz' on this machine"):
        Driver("emulator", device="xyz")


def test_rounded_frames_are_for_arrays_of_the_same_levels_and_drives_in_bounds(rng):
    with pytest.raises(StrategyError, match="arrays emulator, sonicsurface have other steps of amplitude"):
        Driver(["emulator", "sonicsurface"]).rounded(orbits(rng, 1))
    model, ones = array_model("emulator"), np.ones(2, np.float32)
    for delay, amplitude, message in (
        (np.zeros((2, 255)), ones, r"must be \[frame, 256\] and \[frame\], not \(2, 255\), \(2,\)"),
        (np.zeros((2, 256)), np.ones(1), r"not \(2, 256\), \(1,\)"),
        (np.full((2, 256), np.nan), ones, r"delay\[0, 0\] is nan, outside 0..1 turns"),
        (np.zeros((2, 256)), 3 * ones, r"amplitude\[0\] is 3, outside 0..1 of full pressure"),
    ):
        with pytest.raises((StrategyError, FrameError), match=message):
            round_drives(Drives(delay, amplitude, 0), [model])


def test_a_point_in_reach_of_any_array_is_driven(device):
    arrays = [array_model("emulator"), array_model("emulator").placed([0.5, 0, 0, 0, 0, 0, 1])]
    place = np.float32([[0.0, 0, 0.2], [0.5, 0, 0.2], [0.25, 0, 0.2]])
    drives = Driver(arrays, device=device).drive(FocalPoints(place, np.ones(3, np.float32)))
    assert (drives.amplitude.tolist(), drives.refused) == ([1, 1, 0], 1)


@pytest.mark.parametrize("at_once", [drive_module.FRAMES_AT_ONCE, 7])
def test_frames_begin_from_rest_where_they_are_told_to(at_once, rng, device, monkeypatch):
    monkeypatch.setattr(drive_module, "FRAMES_AT_ONCE", at_once)
    focus, driver = orbits(rng, 1), Driver("pat16", device=device)
    points = wp.array(focus.position[:, 0], dtype=wp.vec3, device=device)
    level = wp.array(focus.intensity[:, 0], dtype=wp.float32, device=device)
    starts = np.array([0, 55, 160, 205])
    found = driver.pack(FocalPoints(points, level), rest_start=starts).frames[0].numpy()
    parts = []
    for first, stop in zip(starts, [*starts[1:], 300], strict=True):
        driver.reset()
        parts.append(driver.pack(FocalPoints(points[first:stop], level[first:stop])).frames[0].numpy())
    np.testing.assert_array_equal(found, np.concatenate(parts))
    for other in (Driver("pat16", DriveStrategy(slew=0.01), update_rate=10e3), Driver("pat16")):
        with pytest.raises(StrategyError, match="rest_start is for one focal point a frame without a slew limit"):
            other.pack(orbits(rng, 1 if other.strategy.slew else 2), rest_start=[3])


def steps_of(name, drives):
    """Drives in the steps of a board, in float64: the nearest delay in 1/256 turn, and the amplitude."""
    turns, levels = {"emulator": (256, 255), "pat16": (256, 64), "sonicsurface": (32, 1), "autd3": (256, 255)}[name]
    amplitude = drives.amplitude.astype(float)
    if name == "pat16":  # the nearest width of a pulse, whose start is in 1/128 turn
        width = np.rint(np.arcsin(amplitude) * 128 / np.pi)
        start = np.floor(128 * drives.delay.astype(float) + (64 - width[:, None]) / 2 + 0.5)
        return (2 * start - (64 - width[:, None])) % 256, np.sin(width * np.pi / 128)
    steps = np.floor(drives.delay.astype(float) * turns + 0.5) * (256 // turns)
    return steps % 256, np.floor(amplitude * levels + 0.5) / levels


@pytest.mark.parametrize("foci", [1, 4])
@EACH_BOARD
def test_rounded_frames_are_the_steps_of_the_board_without_its_calibration(name, foci, rng, device):
    model, focus = calibrated(name, rng), orbits(rng, foci)
    drives = Driver(model, device=device).drive(focus)
    delay, level = steps_of(name, drives)
    ways = [Driver(model, device=device).rounded(focus), round_drives(drives, [model], device=device)]
    for found in ways:
        np.testing.assert_allclose(found.amplitude.numpy(), level, atol=1e-6)
        apart = (found.delay.numpy() - delay + 128) % 256 - 128
        assert np.mean(apart[level > 0] != 0) < 1e-3  # where float32 rounds a half
        assert found.refused == drives.refused


def test_shapes_that_are_none_are_refused():
    driver = Driver("pat16")

    def zeros(*shape, kind=wp.float32):
        return wp.zeros(shape, dtype=kind, device="cpu")

    for place, level, message in (
        (zeros(5, 9, kind=wp.vec3), zeros(5, 9), "must have 1..8 focal points a frame, not 9"),
        (zeros(5, 2, 2, kind=wp.vec3), zeros(5, 2, 2), r"must be \[frame\] or \[frame, focus\], not \(5, 2, 2\)"),
        (zeros(5, 2, kind=wp.vec3), zeros(5), r"not \(5, 2\), \(5,\)"),
        (zeros(2, kind=wp.vec3d), zeros(2), "must be vec3 and intensity float32, not vec3d, float32"),
        (np.zeros((4, 2)), np.zeros(4), r"position must be \[frame, 3\] or \[frame, 1..8, 3\], not \(4, 2\)"),
        (np.zeros((4, 3)), np.zeros(5), r"not \(4,\), \(5,\)"),
    ):
        for use in (driver.pack, driver.drive, driver.rounded):
            with pytest.raises(StrategyError, match=message):
                use(FocalPoints(place, level))
