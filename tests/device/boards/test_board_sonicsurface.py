"""The model of the SonicSurface board, by bytes written by hand, and what the codec's bytes make it emit."""

from __future__ import annotations

import numpy as np
import pytest
from board_outputs import sonic_drives, sonic_slots
from drive_cases import turned

from palpate.device.boards.sonicsurface.model import BAUD, SonicBoard
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.registry import array_model

START, SWAP, CLOCKS_OFF, CLOCKS_ON, PRIMARY, SECONDARY = 0xFE, 0xFD, 0x96, 0x97, 0xC0, 0xC1
BYTE = 10e9 / BAUD  # [ns]
OFF = bytes([32]) * 256


def pattern(seed: int) -> bytes:
    return np.random.default_rng(seed).integers(0, 33, 256, np.uint8).tobytes()


def command(values: bytes) -> bytes:
    return bytes([START]) + values + bytes([SWAP])


def board_of(*, baud: float = BAUD, sender: float = BAUD, secondary: bool = False) -> SonicBoard:
    board = SonicBoard(VirtualClock(), record=1000, baud=baud, secondary=secondary)
    board.set_line(sender)
    return board


def pour(board: SonicBoard, data: bytes) -> None:
    """As a driver does: bytes wait until there is room. Then until all are sent."""
    left = memoryview(data)
    while left:
        left = left[board.accept(left) :]
        board.clock.sleep_until_ns(board.clock.now_ns() + round(30 * BYTE))  # before it runs dry
        assert board.bytes_garbled >= 0  # looking on changes nothing
    board.clock.sleep_until_ns(board.clock.now_ns() + round(130 * BYTE))


def test_a_swap_plays_what_came_since_the_start() -> None:
    board = board_of()
    pour(board, command(pattern(1)) + command(pattern(2)))
    assert board.played.tobytes() == pattern(1) + pattern(2)
    assert board.playing.tobytes() == pattern(2)
    assert (board.bytes_ignored, board.bytes_strange, board.bytes_garbled) == (0, 0, 0)


def test_from_power_up_all_places_emit_in_phase_until_two_off_frames_have_come() -> None:
    # PhaseLine.vhd: s_phaseCurrent and s_phasePrev begin at 0, which is on; a swap exchanges them.
    board = board_of()
    assert board.emitting
    assert np.ptp(board.playing) == 0
    pour(board, command(OFF))
    assert not board.emitting
    pour(board, bytes([SWAP]))
    assert board.emitting  # a single byte brings back what was there
    pour(board, command(OFF) * 2)
    assert not board.emitting
    pour(board, bytes([SWAP]))
    assert not board.emitting


def test_a_pattern_plays_from_its_swap_on_and_a_bare_swap_toggles_the_last_two() -> None:
    board = board_of()
    pour(board, command(OFF) + command(pattern(1))[:-1])
    assert (board.emitting, board.frames_played) == (False, 1)
    pour(board, bytes([SWAP]) + command(pattern(2)) + bytes([SWAP, SWAP]))
    assert board.played.tobytes() == OFF + pattern(1) + pattern(2) + pattern(1) + pattern(2)


def test_a_pattern_takes_258_bytes_of_ten_bits() -> None:
    board = board_of()
    pour(board, (command(pattern(1)) * 20))
    assert np.abs(board.played_ns - np.arange(1, 21) * 258 * BYTE).max() <= 1
    assert 1e9 / np.diff(board.played_ns).mean() == pytest.approx(88.2, abs=0.05)  # frames a second


def test_after_a_torn_pattern_the_next_start_begins_anew() -> None:
    board = board_of()
    pour(board, command(pattern(1))[:100] + command(pattern(2)))
    assert board.played.tobytes() == pattern(2)


def test_data_above_32_are_played_modulo_32() -> None:
    # Distribute.vhd passes 32 on as it is, and of every other value the lower five bits.
    board = board_of()
    pour(board, command(bytes([33, 255, 0xA1, 64, 32]) + bytes(251)))
    assert board.bytes_strange == 4
    assert board.playing.tolist() == [1, 31, 1, 0, 32] + [0] * 251


def test_data_without_a_start_fill_places_from_0_on_since_a_swap_zeroes_the_counter_too() -> None:
    board = board_of()
    pour(board, command(OFF) * 2 + bytes([5, 6, SWAP, 7, SWAP]))
    assert board.bytes_stray == 3
    assert board.played[-2:, :3].tolist() == [[5, 6, 32], [7, 32, 32]]
    pour(board, command(OFF)[:-1] + bytes([9, SWAP]))  # the 257th
    assert (board.bytes_stray, board.playing[:2].tolist()) == (4, [9, 32])


def test_switching_the_clocks_off_silences_without_a_change_of_pattern() -> None:
    board = board_of()
    pour(board, bytes([CLOCKS_OFF]))
    assert not board.emitting
    pour(board, bytes([CLOCKS_ON]))
    assert board.emitting


@pytest.mark.parametrize("secondary", [False, True])
def test_of_two_boards_on_a_line_the_selected_one_takes_data_and_both_swap(secondary: bool) -> None:
    # Distribute.vhd of `FPGA primary` and of `FPGA secondary`: both take data until one of the two is selected.
    board = board_of(secondary=secondary)
    own, other = (SECONDARY, PRIMARY) if secondary else (PRIMARY, SECONDARY)
    pour(board, command(pattern(1)))
    assert board.playing.tobytes() == pattern(1)
    pour(board, bytes([other]) + command(pattern(2)))
    assert board.playing.tobytes() == bytes(256)  # of the power-up, by the swap of the other's data
    assert board.bytes_ignored == 257
    pour(board, bytes([own]) + command(pattern(3)))
    assert board.playing.tobytes() == pattern(3)


@pytest.mark.parametrize(
    ("own", "sender", "readable"),
    [
        (BAUD, 230_400, True),
        (BAUD, 230_400 * 1.034, True),
        (BAUD, 230_400 * 1.036, False),
        (BAUD, 230_400 * 0.956, True),
        (BAUD, 230_400 * 0.954, False),
        (BAUD, 9600, False),
        (10.24e6 / 7, 1.5e6, True),
    ],
)
def test_a_sender_4_5_percent_slow_or_3_4_percent_fast_is_the_last_that_is_read(
    own: float, sender: float, readable: bool
) -> None:
    board = board_of(baud=own, sender=sender)
    data = command(pattern(1)) * 3
    pour(board, data)
    board.clock.advance(2.0)
    assert board.bytes_garbled == (0 if readable else len(data))
    assert (board.played.tobytes() == pattern(1) * 3) == readable


def test_what_there_is_no_room_for_is_not_taken_and_what_is_dropped_never_sent() -> None:
    board = board_of()
    data = command(pattern(1))
    assert board.accept(memoryview(data)) == 128
    assert (board.accept(memoryview(data)), board.queued, board.bytes_received) == (0, 128, 128)
    board.clock.sleep_until_ns(round(10.5 * BYTE))
    assert board.queued == 118
    board.drop_queued(20)
    assert (board.queued, board.bytes_received) == (20, 30)
    pour(board, data[30:])
    assert board.played.tobytes() == pattern(1)


def test_places_of_the_wiring_that_the_maker_lists() -> None:
    position = sonic_slots()
    # Read off the maker's list, whose z is -y.
    expected = {0: (-78.75, -78.75), 1: (-57.75, -78.75), 7: (-68.25, -78.75), 4: (-78.75, -68.25)}
    expected |= {64: (-36.75, -78.75), 8: (-78.75, -57.75), 65: (-15.75, -78.75), 63: (-68.25, 68.25)}
    expected |= {252: (47.25, 78.75), 253: (78.75, 78.75), 255: (57.75, 68.25)}
    for place, (x, y) in expected.items():
        assert position[place] == pytest.approx([x * 1e-3, y * 1e-3, 0.0])
    assert len(np.unique(position.round(6), axis=0)) == 256


# What the codec's bytes make this board emit.


def emitted(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Delay [turns] and amplitude of each transducer of the model as the board plays the frames."""
    board = board_of(sender=230_400)
    pour(board, frames.tobytes())
    delay, amplitude = sonic_drives(board.played)
    position = array_model("sonicsurface").position.astype(np.float64)
    apart = np.linalg.norm(position[:, None] - sonic_slots()[None], axis=2)
    assert apart.min(axis=1).max() < 1e-6
    return delay[:, apart.argmin(axis=1)], amplitude[:, apart.argmin(axis=1)]


def test_every_transducer_emits_the_delay_meant_for_it() -> None:
    random = np.random.default_rng(3)
    delay = random.random((50, 256), np.float32)
    amplitude = random.integers(0, 2, (50, 256)).astype(np.float32)
    got, strength = emitted(encode_frames(delay, amplitude, array="sonicsurface"))
    assert np.array_equal(strength, amplitude)
    # A constant of a quarter of a turn is that of a half-period pulse's middle.
    assert turned(got - 0.25 - delay)[amplitude == 1].max() <= 0.5 / 32 + 1e-6
