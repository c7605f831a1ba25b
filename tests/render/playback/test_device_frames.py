"""Frames packed on a device are those of the host's driver and codec."""

import numpy as np
import pytest
import warp as wp

from palpate.device import array_model, encode_frames
from palpate.device.registry import kind_of
from palpate.render import Driver, DriveStrategy, FocalPoints
from palpate.render.errors import StrategyError
from palpate.render.playback.device_frames import PulsePacker, levels_least

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
