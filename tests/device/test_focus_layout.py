"""Frames of focal points as data: silence, what they may drive an array with, and how they fade."""

from __future__ import annotations

import math
import struct
from array import array
from dataclasses import replace

import numpy as np
import pytest

from palpate.device import (
    FocusLayout,
    FrameError,
    Limits,
    SafetyLimitError,
    array_model,
    encode_frames,
    off_frame,
)
from palpate.device.codec import duty, is_emitting, switched_count
from palpate.device.playing.limits import Guard

MODEL = array_model("stratos")


def frame(*points: tuple[float, float, float, float]) -> np.ndarray:
    """A frame of focal points (x, y, z, intensity), shape [16 * point]."""
    return np.frombuffer(b"".join(struct.pack("<4f", *point) for point in points), np.uint8)


def test_only_intensities_above_0_sound_wherever_the_points_are() -> None:
    frames = np.stack([frame((0, 0, 0.2, 0)), frame((9, -9, 0.2, 1e-30)), frame((0, 0, 0, 0)), frame((0, 0, 0.2, 1))])
    assert is_emitting(frames, array=MODEL).tolist() == [False, True, False, True]
    two = np.stack([frame((0, 0, 0.2, 0), (0, 0, 0.3, 0.5)), frame((0, 0, 0.2, 0), (0, 0, 0.3, 0))])
    assert is_emitting(two, array=MODEL.with_points(2)).tolist() == [True, False]
    off = off_frame(array=MODEL.with_points(3))
    assert (off.shape, off.any()) == ((48,), False)
    assert not is_emitting(off[None], array=MODEL.with_points(3)).any()


def test_duty_is_the_width_of_the_pulse_that_gives_the_pressure() -> None:
    # 2 / pi asin(a), by hand: asin(1/2) is pi / 6; asin(sqrt(1/2)) is pi / 4
    levels, widths = [0.0, 0.5, math.sqrt(0.5), 1.0], [0, 1 / 3, 1 / 2, 1]
    frames = np.stack([frame((0.01, 0, 0.2, level)) for level in levels])
    assert duty(frames, array=MODEL) == pytest.approx(widths, abs=1e-6)


def test_duty_of_several_points_is_that_of_their_sum_up_to_full_drive() -> None:
    place = (0.0, 0.0, 0.2)
    frames = np.stack(
        [
            frame((*place, 0.25), (*place, 0.25), (*place, 0), (*place, 0)),
            frame((*place, 0.5), (*place, 0.5), (*place, 0.5), (*place, 0.5)),
            frame((*place, 0), (*place, 0), (*place, 0), (*place, 0)),
        ]
    )
    assert duty(frames, array=MODEL.with_points(4)) == pytest.approx([1 / 3, 1, 0], abs=1e-6)


def test_no_frames_have_no_duty_and_other_frames_are_refused() -> None:
    none = np.zeros((0, 16), np.uint8)
    assert is_emitting(none, array=MODEL).shape == duty(none, array=MODEL).shape == (0,)
    with pytest.raises(FrameError, match=r"those of array stratos are uint8 of \[frame, 32\]"):
        duty(np.zeros((1, 16), np.uint8), array=MODEL.with_points(2))
    with pytest.raises(FrameError, match="array stratos takes focal points, not delays of transducers: `Driver` makes"):
        encode_frames(np.zeros((1, 256)), [1.0], array=MODEL)
    assert switched_count([0.2, 0.7], array=MODEL) == 0


def test_a_frame_fades_in_equal_steps_and_its_points_stay() -> None:
    points = [(0.01, -0.02, 0.2, 1.0), (0.03, 0.0, 0.3, 0.5)]
    steps = FocusLayout().faded(frame(*points).tobytes(), 256, 4)
    assert len(steps) == 4
    for number, step in enumerate(steps[:-1], 1):
        for (x, y, z, level), *found in zip(points, struct.iter_unpack("<4f", step), strict=True):
            assert found[0] == pytest.approx((x, y, z, level * (1 - number / 4)))
    assert steps[-1] == bytes(32)


def test_the_grid_is_the_published_one() -> None:
    # HandyBeam's tx_array_library.py (Ultraleap, 2019): 16 x 16 at 10.3 mm about the middle
    x, y, z = (MODEL.position.astype(np.float64) * 1e3).T
    axis = [round(-77.25 + 10.3 * k, 2) for k in range(16)]
    assert (np.round(x[:16], 2).tolist(), np.round(y[::16], 2).tolist()) == (axis, axis)
    assert not z.any()
    assert np.array_equal(MODEL.normal, np.tile([0, 0, 1], (256, 1)))
    assert (MODEL.carrier, MODEL.frame_clock, MODEL.usb, MODEL.baud, MODEL.embedded) == (40e3, 40e3, None, None, False)


def test_limits_of_duty_and_of_time_count_its_frames() -> None:
    second = np.tile(frame((0, 0, 0.2, 0.5)), 1000)  # at 1 kHz; duty 1/3
    free = Limits(duty_max=None, on_time_max=None)
    for limits, admitted in ((replace(free, duty_max=0.11, duty_window=10.0), 3), (replace(free, on_time_max=7.0), 7)):
        guard = Guard(limits, MODEL)
        (dose,) = guard.measure(array("B", second.tobytes()), 1000)
        assert (dose.first_on, dose.last_on) == (0, 999)
        assert dose.duty_sum == pytest.approx(1000 / 3, rel=1e-6)
        for count in range(admitted):
            guard.admit(dose, count * 10**9, 10**6)
        with pytest.raises(SafetyLimitError):  # 1.1 s at full drive of 10 s are 3.3 s at a third; 7 s
            guard.admit(dose, admitted * 10**9, 10**6)
