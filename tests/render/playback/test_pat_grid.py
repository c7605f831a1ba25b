"""A pat16 ends off whatever it was left with: the board's grid of blocks, its clears, and what its reader has begun.

The board model is held against the published gateware by `test_gateware.py`; so is what it does with these bytes.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from injected_faults import Fault, FaultKind, inject
from pat_grid_cases import FRAME, MODEL, bus_of, content, played_since

from palpate.device import (
    DeviceError,
    DeviceTimeoutError,
    Player,
    VirtualClock,
    open_link,
)
from palpate.device.boards.pat16.model import CommandReader, PatBoard
from palpate.device.emulation.usb_bus import EmulatedBus

BYTE_NS = 125  # at the 8 MB/s of the chip


def leave(bus: EmulatedBus[PatBoard], residue: int, torn: int, seed: int = 1) -> None:
    """Leave a board emitting, its reader amid a frame, and its FIFO with part of a block, as a killed player may."""
    board, random = bus.board(), np.random.default_rng(seed)
    feed(bus, content(1).tobytes())
    if torn:  # the reader has this many bytes of a frame that is not complete
        feed(bus, bytes(FRAME - torn) + content(1).tobytes()[:torn])
    if residue:  # bytes of no block, which may look like the start of a frame
        feed(bus, random.integers(0, 256, residue).astype(np.uint8).tobytes())
    assert (board.emitting, board.torn_bytes, board.fifo_bytes) == (True, torn, residue)


def feed(bus: EmulatedBus[PatBoard], data: bytes) -> None:
    assert bus.board().accept(memoryview(data)) == len(data)
    bus.clock.advance(0.02)


def assert_plays_all_and_ends_off(bus: EmulatedBus[PatBoard], link) -> None:
    """Every frame that is sent is executed, and the board is silent 10 s after the end."""
    before = len(bus.board().played)
    frames = content(20, seed=9)
    report = Player(link).play([frames], update_rate=10e3)
    assert (report.frames, report.off_sent) == (20, True)
    # a frame that was torn before may play on the way
    assert np.array_equal(played_since(bus.board(), before)[-20:], frames)
    bus.clock.advance(10)
    assert not bus.board().emitting


@pytest.mark.parametrize("step", [73, pytest.param(3, marks=pytest.mark.exhaustive)])
def test_three_blocks_silence_any_grid_and_any_reader_at_once(step: int) -> None:
    """Zeros, an off frame and zeros behind any bytes; the board's own rule decides, block after block."""
    random = np.random.default_rng(step)
    off = bytes(open_link(MODEL, backend=bus_of())._off)
    emitting = content(1).tobytes()
    for residue in range(0, FRAME, step):
        for torn in (0, 1, 26, 34, 255, 256, 257, 511, *random.integers(1, 511, 8)):
            reader = CommandReader()
            reader.read(bytes(FRAME - torn) + emitting[:torn])
            old = random.integers(0, 256, residue).astype(np.uint8).tobytes()
            stream = old + bytes(FRAME) + off + bytes(FRAME)
            frames = [reader.read(stream[start : start + FRAME]) for start in range(0, 3 * FRAME, FRAME)]
            last = [frame for frame in frames if frame is not None][-1]
            assert not any(last[256:]), (residue, torn)
            assert reader.torn_bytes == 0, (residue, torn)


PHASES = range(-20, 1536 * BYTE_NS // 1000 + 20)  # [us] of the clear after the first byte, in steps of 1 us


@pytest.mark.exhaustive
@pytest.mark.parametrize(("residue", "torn"), [(0, 0), (1, 511), (37, 300), (300, 0), (511, 34)])
def test_no_phase_of_the_clear_leaves_the_array_on(residue: int, torn: int) -> None:
    met = 0
    for phase_us in PHASES:
        bus = bus_of()
        leave(bus, residue, torn)
        board, clock = bus.board(), bus.clock
        clock.sleep_until_ns(int(board.next_clear_ns) - 1000 * phase_us)
        link = open_link(MODEL, backend=bus)
        cleared = board.bytes_cleared
        link.start(4)
        met += board.bytes_cleared not in (cleared, cleared + residue)
        assert not board.emitting
        assert (board.torn_bytes, board.fifo_bytes) == (0, 0)
        frames = content(3, seed=5)
        before = len(board.played)
        link.write(array("B", frames.tobytes()))
        link.send_off()
        clock.advance(10)
        assert np.array_equal(played_since(board, before), frames)
        assert not board.emitting
        link.close()
    # The clear falls into the first write until a block is whole, which sets its clock back: 8 bytes a microsecond.
    assert met >= (FRAME - residue) * BYTE_NS // 1000 - 2


@pytest.mark.exhaustive
@settings(max_examples=150, deadline=None)
@given(st.integers(0, 511), st.integers(0, 511), st.integers(-1_000, 1_600_000), st.integers(0, 255))
def test_any_state_at_any_time_is_silenced_and_plays_whole(residue: int, torn: int, early: int, divider: int) -> None:
    bus = bus_of()
    if divider:
        with open_link(MODEL, backend=bus) as slow:
            slow.start(divider)
    else:  # a torn frame may load 0, which is 256 carrier periods
        frame = bytearray(content(1).tobytes())
        frame[34] |= 0x80
        feed(bus, bytes(frame))
    bus.clock.advance(0.1)
    leave(bus, residue, torn)
    bus.clock.sleep_until_ns(int(bus.board().next_clear_ns) - early)
    with open_link(MODEL, backend=bus) as link:
        assert_plays_all_and_ends_off(bus, link)


@pytest.mark.parametrize("early_ns", [0, 100, 37_500, 63_900, 64_000, 200_000])
def test_no_frame_is_lost_where_the_clear_would_fall_into_the_next_write(early_ns: int) -> None:
    bus = bus_of()
    with open_link(MODEL, backend=bus) as link:
        link.start(4)
        link.write(array("B", content(3).tobytes()))
        bus.clock.advance(0.1)
        bus.clock.sleep_until_ns(int(bus.board().next_clear_ns) - early_ns)  # a frame passes the chip in 64 us
        before, frames = len(bus.board().played), content(5, seed=5)
        link.write(array("B", frames.tobytes()))
        link.send_off()
        bus.clock.advance(10)
        assert np.array_equal(played_since(bus.board(), before), frames)
        assert not bus.board().emitting


@pytest.mark.parametrize("pause", [0.0, 0.7, 0.79, 0.81, 0.95, 1.0, 1.05, 3.0])
def test_a_stop_after_a_torn_write_and_a_pause_is_off_for_good(pause: float) -> None:
    for torn in (0, 1, 37, 255, 256, 511):
        bus = bus_of()
        with open_link(MODEL, backend=bus) as link:
            link.start(4)
            link.write(array("B", content(3).tobytes()[: 2 * FRAME + torn]))
            bus.clock.advance(pause)
            begin_ns = bus.clock.now_ns()
            link.send_off()
            bus.clock.advance(0.004)
            assert not bus.board().emitting, torn
            if pause < 0.8:  # the count is known: at once
                assert bus.clock.now_ns() - begin_ns < 10_000_000, torn
            bus.clock.advance(10)
            assert not bus.board().emitting, torn
            assert_plays_all_and_ends_off(bus, link)


@pytest.mark.parametrize("missing", [1, 37, 255, 256, 511])
def test_a_host_that_miscounts_a_cut_transfer_ends_off_all_the_same(missing: int) -> None:
    """The driver says that more was taken than was: the grid is not where the link believes it to be."""
    bus = bus_of()
    with open_link(MODEL, backend=bus) as link:
        link.start(4)
        link.write(array("B", content(2).tobytes()[: 2 * FRAME - missing]))
        link._transport._taken += missing
        link.send_off()
        bus.clock.advance(0.1)
        assert not bus.board().emitting
        bus.clock.advance(10)
        assert not bus.board().emitting


def ends(name: str, bus: EmulatedBus[PatBoard]) -> tuple[Iterator[np.ndarray], type[BaseException] | None]:
    """Blocks that end a playback in one of several ways, and what `play` raises then."""
    wire = content(64)

    class Own(Exception):
        pass

    def blocks() -> Iterator[np.ndarray]:
        for number in range(40):
            if number == 20 and name == "exception":
                raise Own
            if number == 20 and name == "stall":
                inject(bus, Fault(FaultKind.STALL, byte=bus.board().bytes_received + 1000))
            if number == 20 and name == "hiccup":
                bus.clock.advance(0.95)
            if number == 20 and name == "pause":
                bus.clock.advance(5)
            yield wire

    return blocks(), {"exception": Own, "stall": DeviceError}.get(name)


@pytest.mark.parametrize("name", ["normal", "exception", "stall", "hiccup", "pause"])
def test_ten_seconds_after_any_end_the_array_is_off(name: str) -> None:
    bus = bus_of()
    with open_link(MODEL, backend=bus) as link:
        player = Player(link)
        blocks, error = ends(name, bus)
        if error is None:
            report = player.play(blocks, update_rate=10e3)
            # every frame is executed, those after a pause too, in which the board has cleared its FIFO
            assert np.array_equal(played_since(bus.board(), 0), np.tile(content(64), (40, 1)))
            assert report.frames == 2560
        else:
            with pytest.raises(error):
                player.play(blocks, update_rate=10e3)
            assert player.report is not None
            # at once where the count is known; a stall of a blocking write leaves it unknown
            assert player.report.off_after == pytest.approx(1.3 if name == "stall" else 0.0, abs=0.1)
        bus.clock.advance(10)
        assert not bus.board().emitting
        assert_plays_all_and_ends_off(bus, link)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("kind", [FaultKind.STALL, FaultKind.TIMEOUT])
@pytest.mark.parametrize("first", range(0, FRAME, 64))
def test_a_stream_that_breaks_off_at_any_byte_of_a_frame_ends_off_and_plays_whole_again(
    kind: FaultKind, first: int
) -> None:
    """A stall, or a NAK for longer than the second after which the device counts as hung."""
    bus = bus_of()
    with open_link(MODEL, backend=bus) as link:
        player = Player(link)
        for byte in range(first, first + 64):
            link.start(4)
            count = 1 + byte % 2 if kind is FaultKind.STALL else 30 if byte % 2 else 1
            inject(bus, Fault(kind, byte=bus.board().bytes_received + 3 * FRAME + byte, count=count))
            before = len(bus.board().played)
            try:
                player.play([content(8)], update_rate=10e3)
            except DeviceError:
                assert kind is FaultKind.STALL or byte % 2
            else:  # one NAK is a short write, which is continued
                assert kind is FaultKind.TIMEOUT
                assert np.array_equal(played_since(bus.board(), before), content(8))
            bus.clock.advance(10)
            assert not bus.board().emitting
        assert_plays_all_and_ends_off(bus, link)


def test_an_unplugged_board_that_comes_back_plays_whole() -> None:
    bus = bus_of()
    with open_link(MODEL, backend=bus) as link:
        link.start(4)
        link.write(array("B", content(5).tobytes()))
        bus.unplug()
        with pytest.raises(DeviceError):
            link.send_off()
    bus.replug()
    bus.clock.advance(0.3)  # before the board takes frames
    with open_link(MODEL, backend=bus) as link:
        assert_plays_all_and_ends_off(bus, link)


def test_a_process_that_is_held_up_in_every_attempt_is_told_so() -> None:
    bus = bus_of()

    class Slow(VirtualClock):
        def sleep_until_ns(self, time_ns: int) -> None:
            super().sleep_until_ns(time_ns + 700_000_000)

    link = open_link(MODEL, backend=bus, clock=Slow())
    with pytest.raises(DeviceTimeoutError, match=r"may not be off: 3 times this process was held up .* 0\.66 s"):
        link.start(4)
    link.close()
