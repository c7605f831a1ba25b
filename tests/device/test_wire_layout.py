"""Levels and frames of boards as data: exact thresholds, off frames, what sounds."""

import pickle
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from drive_cases import ARRAYS_OF_PHASES

from palpate.device import ArrayKindError, Layout, Levels, linear_levels, pulse_levels
from palpate.device.registry import array_model, kind_of


@pytest.mark.parametrize("count", [1, 64, 100, 255])
def test_linear_levels_begin_half_way_between_two(count: int) -> None:
    levels = linear_levels(count)
    assert levels.count == count
    for level, least in enumerate(levels.least, 1):
        assert abs(Fraction(float(least)) - Fraction(2 * level - 1, 2 * count)) < Fraction(1, 10**7)
    near = np.random.default_rng(count).random(2000, np.float32)
    exact = [int((Fraction(float(a)) * count + Fraction(1, 2)) // 1) for a in near]
    assert np.count_nonzero(levels.nearest(near) != exact) <= 2  # where float32 rounds a threshold


def test_pulse_levels_are_worked_by_hand() -> None:
    # sin(pi / 128 * 31.5), sin(pi / 128 * 32) and 2 / pi asin: a half of 64 steps
    levels = pulse_levels(64)
    assert levels.least[31] == pytest.approx(0.69838, abs=1e-5)
    assert levels.amplitude[32] == pytest.approx(0.70711, abs=1e-5)
    assert levels.width[32] == 0.5
    assert levels.nearest([0.0, 0.5, 1.0]).tolist() == [0, 21, 64]  # asin(1/2) is a third of pi / 2


@pytest.mark.parametrize("levels", [linear_levels(255), linear_levels(100), pulse_levels(64)])
def test_no_threshold_is_so_near_to_a_float32s_border_that_a_library_could_round_it_otherwise(levels: Levels) -> None:
    # float64 values, whose last bits a library decides, are 2^-53 apart; the nearest border is 2^-40 away at least
    for k, least in enumerate(levels.least):
        if levels.count == 64:
            exact = np.sin(np.pi / 128 * (k + 0.5))
            border = (float(np.nextafter(least, np.float32(2))) + float(least)) / 2
            below = (float(np.nextafter(least, np.float32(-1))) + float(least)) / 2
            assert min(abs(exact - border), abs(exact - below)) > 2**-40
        else:
            assert least == np.float32((k + 0.5) / levels.count)


@pytest.mark.parametrize("name", ARRAYS_OF_PHASES)
def test_off_frames_do_not_sound_and_have_the_fixed_bits(name: str) -> None:
    model, layout = array_model(name), kind_of(array_model(name)).layout
    off = layout.off_frame(model.frame_bytes)
    assert not layout.emitting(off[None])[0]
    assert layout.width(off[None])[0] == 0
    fixed = layout.fixed_bits(model.frame_bytes)
    assert (off & fixed == fixed).all()
    loud = off.copy()
    loud[np.arange(model.frame_bytes)[layout.level_at or layout.delay_at][5]] = 1
    assert layout.emitting(loud[None])[0]


PULSES = {"turn": 128, "levels": pulse_levels(64), "is_pulse_start": True}
PLAIN = {"turn": 256, "delay_at": slice(0, 16), "levels": linear_levels(100), "level_at": slice(16, 32)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"turn": 257}, r"turn must lie in 1\.\.256 steps, not 257"),
        ({"turn": 256, "level_at": None}, r"turn must lie in 1\.\.255 steps, not 256"),
        ({"turn": 0}, r"turn must lie in 1\.\.256 steps, not 0"),
        ({"levels": linear_levels(256)}, "levels must be 1..255, .* not 256"),
        ({"levels": Levels(np.ones(3, np.float32), np.zeros(2, np.float32), np.ones(3, np.float32))}, "from 0 to 0"),
        ({"turn": 64, "levels": linear_levels(255), "is_pulse_start": True}, "at most turn = 64, not 255"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ArrayKindError, match=message):
        Layout(**PLAIN | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"delay_at": slice(0, 15)}, "delay_at is slice.*: 15 bytes of a frame of 33, in steps of 1, but 16 trans"),
        ({"level_at": slice(32, 16, -1)}, "level_at is slice.*: 16 bytes of a frame of 33, in steps of -1"),
        ({"level_at": slice(10, 26)}, "byte 10 of a frame has a delay and a level"),
        ({"fixed": {33: 1}}, r"fixed bits 0x1 of byte 33 must be of a byte of the frame, 0\.\.32,"),
        ({"fixed": {20: 0x80}}, "fixed bits 0x80 of byte 20 must be .* level.s bits 0xff"),
        ({**PULSES, "fixed": {3: 0x40}}, "fixed bits 0x40 of byte 3 must be .* bits 0x7f"),
    ],
)
def test_bytes_that_do_not_fit_are_refused_when_they_are_used(changes: dict[str, Any], message: str) -> None:
    layout = Layout(**PLAIN | changes)
    with pytest.raises(ArrayKindError, match=message):
        layout.bytes_of(33, 16)


def test_bytes_may_be_counted_from_the_end_and_delays_may_have_marks() -> None:
    layout = Layout(**PLAIN | PULSES | {"delay_at": slice(-32, -16), "level_at": slice(-16, None), "fixed": {1: 0x80}})
    assert layout.bytes_of(33, 16) == (range(1, 17), range(17, 33))


@pytest.mark.parametrize("name", ARRAYS_OF_PHASES)
def test_a_layout_goes_to_another_process(name: str) -> None:
    layout = kind_of(array_model(name)).layout
    sent = pickle.loads(pickle.dumps(layout))
    assert sent is not layout
    assert (sent, hash(sent)) == (layout, hash(layout))
    assert sent != replace(layout, fixed={5: 0}) != replace(layout, levels=linear_levels(3))
