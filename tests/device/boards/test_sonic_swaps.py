"""One pattern that a SonicSurface switches on and off by single bytes, and off for both boards of a line."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from palpate.device import Player, UpdateRateError, VirtualClock, array_model, encode_frames, open_link
from palpate.device.boards.sonicsurface.model import SonicBoard
from palpate.device.boards.sonicsurface.swaps import SwapTransport
from palpate.device.registry import emulated_backend

MODEL = array_model("sonicsurface")
BYTE = 1 / 23040  # [s] on the line: ten bits at 230400 Bd
PATTERN = encode_frames(np.random.default_rng(2).random((1, 256)), [1.0], array=MODEL)[0]
OFF = encode_frames(np.zeros((1, 256)), [0.0], array=MODEL)[0]
OFF_DELAYS = [32] * 256


class Line:
    """An emulated board of a clock of its own, what it was sent, and what another board at the same line plays."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.sent = bytearray()
        self.ports: Any = emulated_backend("sonicsurface", clock=VirtualClock(), record=100_000)
        accept: Callable[[SonicBoard, memoryview], int] = SonicBoard.accept

        def note(board: SonicBoard, data: memoryview) -> int:
            count = accept(board, data)
            if board is self.board:
                self.sent += data[:count]
            return count

        monkeypatch.setattr(SonicBoard, "accept", note)

    @property
    def board(self) -> SonicBoard:
        return self.ports.board()

    def secondary(self) -> SonicBoard:
        """A secondary board, on since before the first byte, that got all that was sent."""
        board = SonicBoard(VirtualClock(), record=100_000, chip_bytes=len(self.sent) + 1, secondary=True)
        board.accept(memoryview(bytes(self.sent)))
        board.clock.advance(11 * len(self.sent) / board.baud)
        return board


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Line:
    return Line(monkeypatch)


def frames(on: list[bool] | np.ndarray) -> np.ndarray:
    return np.where(np.asarray(on)[:, None], PATTERN, OFF).astype(np.uint8)


def on_and_off(frequency: float, rate: float, seconds: float) -> np.ndarray:
    """Off for the first half of each period, as `am` begins."""
    return (np.arange(round(seconds * rate)) * frequency / rate) % 1 >= 0.5


@pytest.mark.parametrize(("frequency", "divider"), [(300, 1), (200, 10), (44, 64)])
def test_a_pattern_switched_at_a_frequency_is_shown_and_hidden_at_that_frequency(
    line: Line, frequency: int, divider: int
) -> None:
    rate = MODEL.update_rate(divider)
    wire = frames(on_and_off(frequency, rate, 0.5))
    with open_link(MODEL, backend=line.ports) as link:
        report = Player(link).play(np.split(wire, [100, 1000]), update_rate=rate)
    shown = line.board.played[:, 0] < 32
    first = np.flatnonzero(shown)[0]
    last = np.flatnonzero(shown)[-1]
    assert (line.board.played[first : last + 1 : 2] == PATTERN[1:-1]).all()
    assert (line.board.played[first + 1 : last : 2] == 32).all()
    assert last - first == 2 * frequency // 2 - 2  # as many periods as fit half a second
    time = line.board.played_ns[first : last + 1] * 1e-9
    due = time[0] + np.arange(len(time)) / (2 * frequency)
    assert np.abs(time - due).max() <= (divider + 1) * BYTE  # a frame at most
    assert (report.frames, report.underruns, report.off_sent) == (len(wire), 0, True)
    assert report.duty == pytest.approx(0.5, abs=0.02)
    assert not line.board.emitting
    assert (line.board.bytes_stray, line.board.bytes_strange) == (0, 0)


def test_the_pattern_is_sent_once_and_each_change_is_one_byte(line: Line) -> None:
    with open_link(MODEL, backend=line.ports) as link:
        Player(link).play([frames([False, True, True, False, True])], update_rate=MODEL.update_rate(4))
    start = line.sent.index(PATTERN[:-1].tobytes())
    start_byte, swap = b"\xfe", b"\xfd"
    slots = [start_byte, swap, start_byte, swap, swap]
    expected = PATTERN[:-1].tobytes() + b"".join(first + start_byte * 3 for first in slots)
    assert line.sent[start : start + len(expected)] == expected


def test_the_end_hides_a_pattern_at_once_and_not_after_the_11_ms_of_an_off_frame(line: Line) -> None:
    with open_link(MODEL, backend=line.ports) as link:
        Player(link).play([frames([True] * 50)], update_rate=MODEL.update_rate(10))
    on = np.flatnonzero((line.board.played < 32).any(axis=1))[-1]
    assert (line.board.played_ns[on + 1] - line.board.played_ns[on]) * 1e-9 == pytest.approx(500 * BYTE, abs=1e-6)
    assert not line.board.emitting


def test_a_stop_amid_a_modulation_leaves_both_buffers_off(line: Line) -> None:
    block = frames(on_and_off(200, 23_040, 0.05))
    with open_link(MODEL, backend=line.ports) as link:
        player = Player(link)

        def blocks() -> Iterator[np.ndarray]:
            for number in range(1000):
                if number == 30:
                    player.stop()
                yield block

        report = player.play(blocks(), update_rate=23_040)
    assert (report.stopped_by, report.off_sent) == ("stop", True)
    assert report.off_after is not None
    assert report.off_after < 0.15  # 50 ms under way, 45 ms of off bytes, and looks in between
    for swap in (b"", b"\xfd"):
        line.board.accept(memoryview(swap))
        line.ports.clock.advance(0.01)
        assert not line.board.emitting


def test_at_a_rate_of_its_line_a_board_gets_whole_frames(line: Line) -> None:
    wire = encode_frames(np.random.default_rng(1).random((9, 256)), np.ones(9), array=MODEL)
    with open_link(MODEL, backend=line.ports) as link:
        Player(link).play([wire], update_rate=MODEL.update_rate(258))
    assert wire.tobytes() in bytes(line.sent)


@pytest.mark.parametrize("changed_at", [20, 4000])
def test_a_second_pattern_is_refused_with_its_frame_and_what_can_be_played(line: Line, changed_at: int) -> None:
    wire = frames(on_and_off(200, 2304, 2.0))
    changed_at += int(np.flatnonzero((wire[changed_at:] == PATTERN).all(axis=1))[0])
    wire[changed_at, 7] ^= 1
    with open_link(MODEL, backend=line.ports) as link:
        player = Player(link)
        message = (
            rf"plays 2304 Hz only as one pattern switched on and off.*but frame {changed_at} has another pattern; it "
            r"plays any frames at up to 89\.3023 Hz"
        )
        with pytest.raises(UpdateRateError, match=message):
            player.play(np.split(wire, 8), update_rate=2304)
    assert (player.report is None) == (changed_at < 576)  # refused before anything is played where that shows soon
    assert not line.board.emitting


def test_a_link_used_without_a_player_refuses_a_second_pattern(line: Line) -> None:
    with open_link(MODEL, backend=line.ports) as link:
        link.start(10)
        link.write(array("B", frames([True, False]).tobytes()))
        other = PATTERN.copy()
        other[9] ^= 1
        with pytest.raises(UpdateRateError, match="was sent another pattern"):
            link.write(array("B", other.tobytes()))
        link.send_off()
    assert not line.board.emitting


def test_bytes_are_counted_as_those_of_whole_frames(line: Line) -> None:
    port = line.ports.open(line.ports.path(), baud=230_400)
    transport = SwapTransport(port, 230_400, frame_bytes=258, clock=line.ports.clock)
    transport.slot_bytes = 10
    transport.submit(array("B", frames([True] * 20).tobytes()))  # 257 + 200 bytes on the line
    assert (transport.bytes_taken, transport.bytes_under_way) == (0, 20 * 258)
    line.ports.clock.advance(457 * BYTE / 2 + 1e-6)
    assert transport.bytes_taken + transport.bytes_under_way == 20 * 258
    assert transport.bytes_taken == pytest.approx(10 * 258, abs=20)
    transport.submit(array("B", frames([False] * 10).tobytes()))  # 100 bytes more
    assert transport.drain()
    assert (transport.bytes_taken, transport.bytes_under_way) == (30 * 258, 0)
    assert len(line.sent) == 257 + 300


def test_no_byte_is_lost_count_of_while_time_goes_on_between_two_looks(line: Line) -> None:
    class Running(VirtualClock):
        def now_ns(self) -> int:
            self.advance(100e-6)
            return super().now_ns()

    port = line.ports.open(line.ports.path(), baud=230_400)
    transport = SwapTransport(port, 230_400, frame_bytes=258, clock=Running())
    transport.slot_bytes = 4
    for _ in range(20):
        transport.submit(array("B", frames([True, False]).tobytes()))
        assert 0 <= transport.bytes_under_way <= 40 * 258
    assert transport.drain()
    assert (transport.bytes_taken, transport.bytes_under_way) == (40 * 258, 0)


@pytest.mark.parametrize("divider", [258, 10])
def test_a_secondary_board_on_the_line_is_silent_throughout_a_playback_and_after_it(line: Line, divider: int) -> None:
    wire = frames(on_and_off(200, 2304, 0.05))
    with open_link(MODEL, backend=line.ports) as link:
        link.start(divider)
        assert not line.secondary().emitting
        Player(link).play([wire], update_rate=MODEL.update_rate(divider))
    secondary = line.secondary()
    assert secondary.frames_played > 3
    emitting = (secondary.played < 32).any(axis=1)
    assert emitting[0]  # the swap of the primary's first off frame shows the second buffer of the power-up
    assert not emitting[1:].any()
    assert not secondary.emitting
    secondary.accept(memoryview(b"\xfd"))  # a swap read out of noise
    secondary.clock.advance(1)
    assert not secondary.emitting


def test_opening_silences_a_board_that_was_just_switched_on(line: Line) -> None:
    assert line.board.emitting  # as its firmware is published
    with open_link(MODEL, backend=line.ports):
        assert line.board.playing.tolist() == OFF_DELAYS
        assert not line.secondary().emitting


def test_clocks_run_again_only_once_the_board_is_off(line: Line) -> None:
    with open_link(MODEL, backend=line.ports) as link:
        line.board.accept(memoryview(PATTERN.tobytes() + b"\x96"))  # another program's
        link.start(258)
    before, after = bytes(line.sent).split(b"\x97")
    assert before.endswith(OFF[:-1].tobytes() + b"\xc0")
    assert not after
    assert not line.board.emitting
