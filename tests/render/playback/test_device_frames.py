"""Frames packed on a device are those of the host's driver and codec."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from palpate.device import array_model, encode_frames
from palpate.device.codec import round_drives
from palpate.device.registry import kind_of
from palpate.render import Driver, DriveStrategy, FocalPoints
from palpate.render.errors import StrategyError
from palpate.render.playback.device_frames import PulsePacker, focus_on, levels_least

PLACE = np.array([0.02, -0.01, 0.05, 0.0, 0.17364818, 0.0, 0.98480775])


def points_of(rng, count=2000):
    points = np.column_stack([rng.uniform(-0.17, 0.17, (count, 2)), rng.uniform(0.03, 0.55, count)])
    intensity = rng.uniform(0, 1, count)
    intensity[:9] = [0, 1, 1.0000001, -1, 2, np.nan, 1e-9, 0.5, np.inf]
    return points.astype(np.float32), intensity.astype(np.float32)


@pytest.mark.parametrize("strategy", [DriveStrategy(), DriveStrategy(amplitude="force", level_max=0.7)])
@pytest.mark.parametrize("placed", [False, True])
def test_frames_are_those_of_the_host(placed, strategy, device, rng):
    model = array_model("pat16")
    model = model.placed(PLACE) if placed else model
    points, intensity = points_of(rng)
    drives = Driver(model, strategy).drive(FocalPoints(points, intensity))
    wanted = encode_frames(drives.delay, drives.amplitude, array=model).astype(int)
    packer = PulsePacker(model, strategy, device=device)
    arrays = wp.array(points, dtype=wp.vec3, device=device), wp.array(intensity, device=device)
    frame, refused = packer.pack(*arrays)
    found = frame.numpy().astype(int)
    assert refused == drives.refused > 0
    np.testing.assert_array_equal(found[:, 256:], wanted[:, 256:])
    np.testing.assert_array_equal(found[:, 0] & 0x80, 0x80)
    drawn = drives.amplitude > 0
    apart = (found[drawn, :256] - wanted[drawn, :256] + 64) % 128 - 64
    assert np.abs(apart).max() <= 1  # both are within 1e-4 turns of exact
    assert np.count_nonzero(apart) < 1e-3 * apart.size


def orbits(rng, foci, count=600):
    """Focal points that move as contours do, some out of reach, silent or none for a while."""
    time, phase = np.arange(count)[:, None] / count, rng.uniform(0, 6.28, foci)
    around = [0.05 * np.cos(9 * time + phase), 0.05 * np.sin(8 * time + phase), 0.2 + 0.04 * np.sin(5 * time + phase)]
    position = np.stack(around, axis=-1).astype(np.float32)
    intensity = np.clip(0.5 + 0.6 * np.sin(40 * time + phase), 0, 1).astype(np.float32)
    position[:2], position[50:60], position[200:210, 0] = 0, 9, np.nan
    intensity[300:320], intensity[400, -1] = 0, np.nan
    return position, intensity


@pytest.mark.parametrize(
    ("foci", "strategy"),
    [
        (2, DriveStrategy()),
        (3, DriveStrategy(solver="naive")),
        (4, DriveStrategy(solver="gs-pat", amplitude="force", level_max=0.7)),
        (8, DriveStrategy(solver="wgs", wgs_iterations=5)),
    ],
)
def test_frames_of_several_focal_points_are_those_of_the_host(foci, strategy, device, rng):
    """Also in blocks of other lengths; a GPU's solver rounds otherwise, but for jumps between equal solutions."""
    model, (position, intensity) = array_model("pat16").placed(PLACE), orbits(rng, foci)
    drives = Driver(model, strategy).drive(FocalPoints(position, intensity))
    wanted = encode_frames(drives.delay, drives.amplitude, array=model).astype(int)
    packer, parts, refused = PulsePacker(model, strategy, device=device), [], 0
    for rows in (slice(0, 250), slice(250, 251), slice(251, 600)):
        points = wp.array(position[rows], dtype=wp.vec3, device=device)
        packed = packer.pack(points, wp.array(intensity[rows], device=device))
        parts.append(packed.frame.numpy())
        refused += packed.refused
    found = np.concatenate(parts).astype(int)
    assert refused == drives.refused > 0
    np.testing.assert_array_equal(found[:, 256:], wanted[:, 256:])
    apart = np.abs((found[:, :256] - wanted[:, :256] + 64) % 128 - 64)
    if device == "cpu":
        assert apart.max() == 0
    assert np.mean(apart <= 1) > 0.99


@pytest.mark.parametrize("foci", [1, 4])
def test_rounded_frames_are_those_that_predictions_round_on_the_host(foci, device, rng):
    """Of a board with offsets and gains, which predictions leave out."""
    plain = array_model("pat16")
    order = rng.permutation(256)
    model = replace(plain, delay_offset=rng.random(256, np.float32), gain=plain.gain * 0.9, wire_order=order)
    position, intensity = orbits(rng, foci)
    focus = FocalPoints(position, intensity) if foci > 1 else FocalPoints(position[:, 0], intensity[:, 0])
    drives = Driver(model).drive(focus)
    delay, level = round_drives(drives.delay, drives.amplitude, array=model)
    found = PulsePacker(model, device=device).rounded(*focus_on(focus, device))
    np.testing.assert_allclose(found.level.numpy(), level, atol=1e-6)
    apart = np.abs((found.delay.numpy().astype(int) - delay + 128) % 256 - 128)[level > 0]
    assert found.refused == drives.refused
    assert np.mean(apart <= 2) > 0.99  # a step of the board is 2 / 256 turn
    assert np.mean(apart > 0) < (1e-3 if device == "cpu" or foci == 1 else 0.05)


def test_one_focal_point_of_several_is_focused_exactly(device, rng):
    points, intensity = points_of(rng, 100)
    arrays = wp.array(points, dtype=wp.vec3, device=device), wp.array(intensity, device=device)
    packer = PulsePacker("pat16", device=device)
    alone, listed = packer.pack(*arrays), packer.pack(*(own.reshape((100, 1)) for own in arrays))
    np.testing.assert_array_equal(listed.frame.numpy(), alone.frame.numpy())
    assert listed.refused == alone.refused


def test_shapes_that_are_none_are_refused():
    packer = PulsePacker("pat16", device="cpu")
    for shape, message in (((5, 9), r"\[frame, 1\.\.8\], not \(5, 9\)"), ((5, 2, 2), "must be")):
        with pytest.raises(StrategyError, match=message):
            packer.pack(wp.zeros(shape, dtype=wp.vec3, device="cpu"), wp.zeros(shape, dtype=wp.float32, device="cpu"))
    with pytest.raises(StrategyError, match=r"not \(5, 2\), \(5,\)"):
        packer.pack(wp.zeros((5, 2), dtype=wp.vec3, device="cpu"), wp.zeros(5, dtype=wp.float32, device="cpu"))
    with pytest.raises(StrategyError, match="must be vec3 and intensity float32, not vec3d, float32"):
        packer.pack(wp.zeros(2, dtype=wp.vec3d, device="cpu"), wp.ones(2, dtype=wp.float32, device="cpu"))


def test_least_levels_are_where_the_codecs_widths_change():
    model = array_model("pat16")
    least = levels_least(model, kind_of(model).layout)
    assert least.shape == (64,)
    for level, step in ((least, 0), (np.nextafter(least, np.float32(0)), -1)):
        frames = encode_frames(np.zeros((64, 256), np.float32), level, array=model)
        np.testing.assert_array_equal(frames[:, 300], np.arange(1, 65) + step)


def test_arrays_and_strategies_that_are_not_packed_are_refused():
    with pytest.raises(StrategyError, match="frames of array emulator are not packed on a device"):
        PulsePacker("emulator", device="cpu")
    with pytest.raises(StrategyError, match=r"slew 0\.01: frames that depend on those before"):
        PulsePacker("pat16", DriveStrategy(slew=0.01), device="cpu")
