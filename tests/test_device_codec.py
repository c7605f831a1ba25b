"""Drives to wire bytes of the board `emulator`, and its array model."""

from __future__ import annotations

import hashlib
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.device import FrameError, UnknownArrayError, UpdateRateError, array_model, encode_frames, off_frame
from palpate.device.board import decode_frames, slot_position

RATES = st.integers(1, 255)


def decoded_by_position(frame: bytes) -> dict[tuple[float, float], tuple[float, float]]:
    """A decoder by the page docs/emulator.md alone, slot by slot: (x, y) [mm] -> delay [turns], level."""
    drive = {}
    for slot in range(256):
        column, step = divmod(slot, 16)
        y = 78.75 - 10.5 * step if column % 2 == 0 else -78.75 + 10.5 * step
        drive[78.75 - 10.5 * column, y] = frame[2 * slot] / 256, frame[2 * slot + 1] / 255
    return drive


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_each_transducer_gets_its_own_delay_and_level(seed: int, per_transducer: bool) -> None:
    rng = np.random.default_rng(seed)
    delay = rng.random((3, 256), np.float32)
    amplitude = rng.random((3, 256) if per_transducer else 3, np.float32)
    position = array_model("emulator").position * 1e3
    for row, frame in enumerate(encode_frames(delay, amplitude)):
        drive = decoded_by_position(frame.tobytes())
        for transducer, (x, y, _) in enumerate(position.tolist()):
            got_delay, got_level = drive[round(x, 2), round(y, 2)]
            error = got_delay - float(delay[row, transducer])
            assert abs(error - round(error)) <= 1 / 512 + 1e-7
            assert abs(got_level - float(np.broadcast_to(amplitude[row], 256)[transducer])) <= 1 / 510 + 1e-7


def test_board_model_decodes_a_focus_where_it_was_put() -> None:
    # Superposition by hand, from the board model's own wiring: a mistake of sign or order misses the point.
    wavelength = 343 / 40e3
    focus = np.array([0.030, -0.020, 0.200])
    away = np.linalg.norm(array_model("emulator").position - focus, axis=1)
    delay = np.mod(-away / wavelength, 1).astype(np.float32)
    turns, level = decode_frames(encode_frames(delay[None], [1.0]))

    def pressure(point: np.ndarray) -> float:
        r = np.linalg.norm(slot_position() - point, axis=1)
        return abs(np.sum(level[0] * np.exp(-2j * np.pi * (turns[0] + r / wavelength)) / r))

    best = np.sum(1 / np.linalg.norm(slot_position() - focus, axis=1))
    assert pressure(focus) > 0.99 * best
    for mirrored in ([-0.030, -0.020, 0.2], [0.030, 0.020, 0.2], [-0.020, 0.030, 0.2], [0.030, -0.020, 0.15]):
        assert pressure(np.array(mirrored)) < 0.5 * best


def test_wire_bytes_of_two_small_frames_are_these() -> None:
    delay = np.zeros((2, 256), np.float32)
    delay[0, 0], delay[0, 15], delay[0, 240], delay[0, 255] = 0.25, 0.5, 0.75, 0.998  # the corners -- +- -+ ++
    delay[1] = np.arange(256) / 256
    wire = encode_frames(delay, np.array([1.0, 0.5], np.float32))
    # slot 0 is the corner (+, +), 15 (+, -), 240 (-, -), 255 (-, +); 0.998 turns is nearest to 255 / 256
    assert [wire[0, 2 * slot] for slot in (0, 15, 240, 255)] == [255, 128, 64, 192]
    assert set(wire[0, 1::2]) == {255}
    assert bytes(wire[1, :36]) == bytes.fromhex(
        "ff80ef80df80cf80bf80af809f808f807f806f805f804f803f802f801f800f800e801e80"
    )
    assert hashlib.sha256(wire.tobytes()).hexdigest() == GOLDEN_SHA256


GOLDEN_SHA256 = "7b25fcedd579c0b8d5b24b48cfeb46aeabc662a8c06bcf889b063b3aa87c7846"


def test_a_delay_that_rounds_up_to_a_turn_is_zero() -> None:
    wire = encode_frames(np.full((1, 256), 0.9999, np.float32), [1])
    assert not wire[0, 0::2].any()
    assert np.array_equal(wire, encode_frames(np.ones((1, 256)), [1]))


def test_off_frame_is_zero_and_zero_amplitude_is_off() -> None:
    assert not off_frame().any()
    assert off_frame().shape == (512,)
    assert not encode_frames(np.random.default_rng(0).random((4, 256)), np.zeros(4))[:, 1::2].any()


def test_no_frames_encode_to_no_frames() -> None:
    assert encode_frames(np.zeros((0, 256)), np.zeros(0)).shape == (0, 512)


@pytest.mark.parametrize("frame_count", [1023, 1024, 1025, 2049])
def test_frames_are_encoded_each_on_its_own(frame_count: int) -> None:
    rng = np.random.default_rng(frame_count)
    delay, amplitude = rng.random((frame_count, 256)), rng.random(frame_count)
    last = encode_frames(delay[-1:], amplitude[-1:])
    assert np.array_equal(encode_frames(delay, amplitude)[-1:], last)


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
    with pytest.raises(FrameError, match=re.escape(message)):
        encode_frames(**drive)


@pytest.mark.parametrize(
    ("delay", "amplitude"), [((256,), (1,)), ((2, 255), (2,)), ((2, 256), (3,)), ((2, 256), ()), ((2, 256), (2, 1))]
)
def test_a_wrong_shape_is_refused_with_the_shape(delay: tuple[int, ...], amplitude: tuple[int, ...]) -> None:
    with pytest.raises(FrameError, match="shape"):
        encode_frames(np.zeros(delay), np.zeros(amplitude))


def test_an_unknown_array_is_refused_with_the_known_ones() -> None:
    for ask in (array_model, lambda name: off_frame(array=name)):
        with pytest.raises(UnknownArrayError, match="unknown array 'pat16'; known: emulator"):
            ask("pat16")


def test_the_array_is_centred_flat_and_faces_up() -> None:
    model = array_model("emulator")
    assert model.position.shape == (256, 3)
    assert sorted(set(np.round(model.position[:, 0] * 1e3, 2).tolist())) == [-78.75 + 10.5 * i for i in range(16)]
    assert np.allclose(model.position.mean(axis=0), 0, atol=1e-8)
    assert np.array_equal(model.normal, np.tile([0, 0, 1], (256, 1)))
    # stored in files, so it must stay
    assert model.identity() == "52f183542e18dc0645909b6d232f22dc4495970dfd39f7fd4e6929e9716b3aa4"


def test_wiring_of_the_board_model_covers_the_array() -> None:
    model = array_model("emulator").position
    assert np.allclose(np.sort(slot_position(), axis=0), np.sort(model, axis=0), atol=1e-7)


@given(RATES)
def test_each_divider_comes_back_from_its_update_rate(divider: int) -> None:
    model = array_model("emulator")
    assert model.divider(model.update_rate(divider)) == divider
    assert model.divider(float(f"{model.update_rate(divider):.8g}")) == divider


@pytest.mark.parametrize("rate", [7e3, 39e3, 41e3, 100.0, 0.0, -1e4, float("nan"), float("inf")])
def test_an_update_rate_that_the_board_does_not_have_is_refused(rate: float) -> None:
    with pytest.raises(UpdateRateError, match="update rate"):
        array_model("emulator").divider(rate)


def test_a_refused_update_rate_names_its_neighbours() -> None:
    with pytest.raises(UpdateRateError, match=r"nearest are 6666\.66667 and 8000 Hz"):
        array_model("emulator").divider(7e3)


def test_the_focal_zone_refuses_points_beside_it() -> None:
    zone = array_model("emulator").focal_zone
    points = np.array([[0, 0, 0.2], [0.2, 0, 0.2], [0, -0.2, 0.2], [0, 0, 0.01], [0, 0, 1], [np.nan, 0, 0.2]])
    assert zone.contains(points).tolist() == [True, False, False, False, False, False]
