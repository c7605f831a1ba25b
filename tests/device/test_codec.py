"""Drives to wire bytes of each board, read back by decoders that share no code with the codec."""

from __future__ import annotations

import hashlib
import re
from dataclasses import replace

import numpy as np
import pytest
from drive_cases import ARRAYS_OF_PHASES, turned
from hypothesis import given
from hypothesis import strategies as st
from wire_decoders import DECODERS, Drive

from palpate.device.array import ArrayModel
from palpate.device.boards.pat16.link import with_divider
from palpate.device.codec import duty, encode_frames, is_emitting, off_frame, switched_count
from palpate.device.errors import FrameError, UnknownArrayError, UpdateRateError
from palpate.device.registry import array_model

STEPS = {"emulator": 256, "pat16": 128, "sonicsurface": 32, "autd3": 256}
AMPLITUDE_ERROR = {"emulator": 1 / 510, "pat16": np.pi / 256, "sonicsurface": 0.5, "autd3": 1 / 510}
EACH_BOARD = pytest.mark.parametrize("name", ARRAYS_OF_PHASES)
WAVELENGTH = 343 / 40e3


def read(frame: np.ndarray, model: ArrayModel) -> tuple[np.ndarray, np.ndarray]:
    """Delay [turns] and amplitude of each transducer, by its place, in the model's order."""
    drive: Drive = DECODERS[model.name](frame.tobytes())
    places = [(round(x, 2), round(y, 2)) for x, y in (model.position[:, :2].astype(float) * 1e3).tolist()]
    delay, amplitude = zip(*[drive[place] for place in places], strict=True)
    return np.array(delay), np.array(amplitude)


def focus_delay(model: ArrayModel, focus: np.ndarray) -> np.ndarray:
    return np.mod(-np.linalg.norm(model.position - focus, axis=1) / WAVELENGTH, 1).astype(np.float32)


@EACH_BOARD
@pytest.mark.parametrize("is_calibrated", [False, True])
def test_each_transducer_gets_its_own_delay_and_amplitude_less_its_calibration(name: str, is_calibrated: bool) -> None:
    rng = np.random.default_rng(1)
    model = array_model(name)
    count = model.transducer_count
    offset, gain = np.zeros(count, np.float32), np.ones(count, np.float32)
    if is_calibrated:
        offset, gain = rng.uniform(-0.5, 0.5, count).astype(np.float32), rng.uniform(0.6, 1, count).astype(np.float32)
    model = replace(model, delay_offset=offset, gain=gain)
    delay, amplitude = rng.random((20, count), np.float32), rng.random((20, count), np.float32)
    for row, frame in enumerate(encode_frames(delay, amplitude, array=model)):
        on_wire, level = read(frame, model)
        emitted = on_wire + offset  # a transducer adds its own delay
        assert (turned(emitted - delay[row])[level > 0] <= 0.5 / STEPS[name] + 1e-6).all()
        assert (np.abs(level - amplitude[row] * gain) <= AMPLITUDE_ERROR[name] + 1e-6).all()


@EACH_BOARD
def test_a_focus_back_propagated_from_the_bytes_is_where_it_was_put(name: str) -> None:
    # Superposition by hand from the decoder's places: a mistake of sign, order or mirror misses the point.
    model = array_model(name)
    focus = np.array([0.030, -0.020, 0.200])
    drive = DECODERS[name](encode_frames(focus_delay(model, focus)[None], [1.0], array=model)[0].tobytes())
    place = np.array([[x / 1e3, y / 1e3, 0] for x, y in drive])
    delay, amplitude = np.array(list(drive.values())).T

    def pressure(point: np.ndarray) -> float:
        r = np.linalg.norm(place - point, axis=1)
        return abs(np.sum(amplitude * np.exp(-2j * np.pi * (delay + r / WAVELENGTH)) / r))

    best = np.sum(1 / np.linalg.norm(place - focus, axis=1))
    assert pressure(focus) > 0.99 * best
    for wrong in ([-0.030, -0.020, 0.2], [0.030, 0.020, 0.2], [-0.020, 0.030, 0.2], [0.030, -0.020, 0.15]):
        assert pressure(np.array(wrong)) < 0.5 * best


def test_bytes_worked_by_hand() -> None:
    corner = 240  # the transducer at (-78.75, +78.75)
    delay, amplitude = np.zeros((2, 256)), np.zeros((2, 256))
    delay[:, corner], amplitude[0, corner], amplitude[1, corner] = 0.25, 1, 0.5
    pat = encode_frames(delay, amplitude, array="pat16")
    # pin 249; a pulse of 64 of 128 steps from 32; asin(0.5) is a third of pi / 2: 21 steps, the start 21.5 later
    assert [pat[0, 249], pat[0, 256 + 249], pat[1, 249], pat[1, 256 + 249]] == [32, 64, 54, 21]
    assert (pat[0, 0], pat[0, 256]) == (0x80 | 32, 0)
    sonic = encode_frames(delay, amplitude, array="sonicsurface")
    # slot 7 * 8 + 4; a quarter of 32 steps; 0.5 is on
    assert [sonic[0, 0], sonic[0, 1 + 60], sonic[1, 1 + 60], sonic[0, 257]] == [0xFE, 8, 8, 0xFD]
    assert np.count_nonzero(sonic[0] == 32) == 255
    one = np.zeros((1, 249))
    one[0, 19] = 0.5  # (3, 1): places 1 and 2 of the second row are screws
    autd3 = encode_frames(one / 2, one, array="autd3")
    assert (np.flatnonzero(autd3[0]).tolist(), autd3[0, 19], autd3[0, 249 + 19]) == ([19, 268], 64, 128)


@pytest.mark.parametrize(
    ("name", "sha256"),
    [
        ("emulator", "4d22a69d652a18e9980e3d241f2a837b59243e3341eff4e00ffc66cfd0b6d363"),
        ("pat16", "8d89148171aa51ec7f803462a9349db64b812737eb3ec5eb6bac04746f796856"),
        ("sonicsurface", "c34b6932501d3c140d9cd75f306ba6fcaa9794e9c4d9d60d62b15b15520da1cc"),
        ("autd3", "362775ce46691ba4085b48f06c2630917c687be6e8e2be326d1ff854c4f4e2f0"),
    ],
)
def test_wire_bytes_of_a_small_set_are_these(name: str, sha256: str) -> None:
    count = array_model(name).transducer_count
    place = np.arange(count)
    delay = np.stack([place / 1000, (place * 7 % 100 + 0.3) / 100, np.full(count, 0.123)])
    amplitude = np.stack([np.full(count, 0.77), place / count, (place % 2).astype(float)])
    assert hashlib.sha256(encode_frames(delay, amplitude, array=name).tobytes()).hexdigest() == sha256


@EACH_BOARD
def test_a_delay_that_rounds_up_to_a_turn_is_zero(name: str) -> None:
    count = array_model(name).transducer_count
    zero = encode_frames(np.zeros((1, count)), [1], array=name)
    for turns in (1.0, 0.9999):
        assert np.array_equal(encode_frames(np.full((1, count), turns), [1], array=name), zero)


@EACH_BOARD
def test_off_is_off(name: str) -> None:
    model = array_model(name)
    off = off_frame(array=name)
    assert off.shape == (model.frame_bytes,)
    silenced = encode_frames(np.random.default_rng(0).random((4, model.transducer_count)), np.zeros(4), array=name)
    for frames in (off[None], silenced):
        assert not is_emitting(frames, array=name).any()
        assert not duty(frames, array=name).any()
        assert not any(read(frame, model)[1].any() for frame in frames)


@EACH_BOARD
def test_duty_is_the_width_of_the_pulses(name: str) -> None:
    count = array_model(name).transducer_count
    frames = encode_frames(np.zeros((3, count)), np.array([0, 0.5, 1]), array=name)
    half = 1 if name == "sonicsurface" else 1 / 3  # asin(0.5) = pi / 6
    assert duty(frames, array=name) == pytest.approx([0, half, 1], abs=0.006)
    assert is_emitting(frames, array=name).tolist() == [False, True, True]


def test_amplitudes_that_can_only_be_switched_are_counted() -> None:
    amplitude = [0, 0.2, 0.5, 0.9, 1]
    assert switched_count(amplitude, array="sonicsurface") == 3
    assert switched_count(amplitude, array="pat16") == 0


@given(divider=st.integers(1, 255), seed=st.integers(0, 1000))
def test_a_divider_rides_on_a_frame_of_a_pat16_and_changes_nothing_else(divider: int, seed: int) -> None:
    frames = encode_frames(np.random.default_rng(seed).random((2, 256)), [1, 0.3], array="pat16")
    marked = with_divider(frames, divider)
    mark = marked >> 7
    assert (mark[:, 26:34] @ (1 << np.arange(8)) == divider).all()
    assert (mark[:, 34] == 1).all()
    assert np.array_equal(marked & 0x7F, frames & 0x7F)
    rest = np.r_[0:26, 35:512]
    assert np.array_equal(marked[:, rest], frames[:, rest])
    assert np.array_equal(with_divider(marked, 255 - divider or 1), with_divider(frames, 255 - divider or 1))


def test_a_divider_that_a_pat16_lacks_is_refused() -> None:
    for divider in (0, 256, -1):
        with pytest.raises(UpdateRateError, match=re.escape(f"divider {divider} is outside 1..255")):
            with_divider(off_frame(array="pat16"), divider)


@EACH_BOARD
def test_frames_are_encoded_each_on_its_own(name: str) -> None:
    rng = np.random.default_rng(3)
    delay, amplitude = rng.random((513, array_model(name).transducer_count), np.float32), rng.random(513, np.float32)
    frames = encode_frames(delay, amplitude, array=name)
    for k in (0, 255, 256, 257, 511, 512):  # about the borders of the chunks in which they are made
        own = slice(k, k + 1)
        assert np.array_equal(encode_frames(delay[own], amplitude[own], array=name), frames[own]), k
        assert duty(frames, array=name)[k] == duty(frames[own], array=name)[0], k


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("delay", np.nan, "delay[1, 7] is nan, outside 0..1 turns"),
        ("delay", -0.25, "delay[1, 7] is -0.25, outside 0..1 turns"),
        ("delay", 3.5, "delay[1, 7] is 3.5, outside 0..1 turns"),
        ("amplitude", np.nan, "amplitude[1] is nan, outside 0..1"),
        ("amplitude", 1.5, "amplitude[1] is 1.5, outside 0..1"),
        ("amplitude", -1e-3, "amplitude[1] is -0.001, outside 0..1"),
    ],
)
def test_a_value_out_of_range_is_refused_with_its_index(name: str, value: float, message: str) -> None:
    drive = {"delay": np.zeros((2, 256)), "amplitude": np.zeros(2)}
    drive[name][(1, 7)[: drive[name].ndim]] = value
    for board in ("emulator", "pat16", "sonicsurface"):
        with pytest.raises(FrameError, match=re.escape(message)):
            encode_frames(**drive, array=board)


def test_a_wrong_shape_is_refused_with_the_shape() -> None:
    pairs = [((256,), (1,)), ((2, 255), (2,)), ((2, 256), (3,)), ((2, 256), ()), ((2, 256), (2, 1))]
    for delay, amplitude in pairs:
        with pytest.raises(FrameError, match="shape"):
            encode_frames(np.zeros(delay), np.zeros(amplitude))
    for ask in (is_emitting, duty):
        with pytest.raises(FrameError, match=re.escape("uint8 of [frame, 258]")):
            ask(np.zeros((1, 512), np.uint8), array="sonicsurface")


def test_an_array_without_a_codec_is_refused() -> None:
    with pytest.raises(UnknownArrayError, match="known: emulator"):
        off_frame(array="pat17")
    with pytest.raises(UnknownArrayError, match="array 'mine' has no wire format"):
        off_frame(array=replace(array_model("pat16"), name="mine"))
