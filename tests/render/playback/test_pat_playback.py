"""What a playback to a pat16 reports where its board had to begin anew, and what is off where it could not begin."""

from __future__ import annotations

import time
from array import array
from collections.abc import Iterator

import numpy as np
import pytest
from board_pipe import BoardPipe
from injected_faults import Fault, FaultKind, inject
from pat_grid_cases import FRAME, MODEL, bus_of, content, played_since

from palpate.device import DeviceError, Player, open_link
from palpate.device.boards.pat16.ftdi import FtdiPort
from palpate.device.boards.pat16.link import PatLink
from palpate.device.transports.queued import QueuedTransport


def queued_link(bus, **options) -> PatLink:
    port = FtdiPort.open(MODEL, backend=bus)
    pipe = BoardPipe(bus, **options)
    transport = QueuedTransport(port.device, 2, who="pat16", clock=bus.clock, pipe=pipe)
    return PatLink(MODEL, transport, port, clock=bus.clock)


@pytest.mark.parametrize(
    "fault",
    [
        Fault(FaultKind.STALL, request=0x09),
        Fault(FaultKind.STALL, request=0x0B),
        Fault(FaultKind.STALL, byte=FRAME + 10),
        Fault(FaultKind.STALL, byte=FRAME + 1600),
        Fault(FaultKind.TIMEOUT, byte=FRAME + 10, count=30),
    ],
)
def test_a_start_that_fails_switches_off_what_a_killed_player_left_on(fault: Fault) -> None:
    bus = bus_of()
    assert bus.board().accept(memoryview(content(1).tobytes())) == FRAME
    bus.clock.advance(0.1)
    assert bus.board().emitting
    inject(bus, fault)
    with open_link(MODEL, backend=bus) as link, pytest.raises(DeviceError) as raised:
        Player(link).play([content(10)], update_rate=10e3)
    assert "may still be emitting" not in str(raised.value)
    bus.clock.advance(10)
    assert not bus.board().emitting
    assert len(played_since(bus.board(), 1)) == 0


def test_a_start_that_cannot_switch_off_says_so() -> None:
    bus = bus_of()
    inject(bus, Fault(FaultKind.STALL, byte=100, count=100))
    with (
        open_link(MODEL, backend=bus) as link,
        pytest.raises(DeviceError, match="may still be emitting, switch it off"),
    ):
        Player(link).play([content(10)], update_rate=10e3)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("seed", range(5))
def test_a_driver_that_miscounts_a_cancelled_transfer_costs_the_next_playback_no_frame(seed: int) -> None:
    bus = bus_of()
    with queued_link(bus, reported=lambda taken: taken // FRAME * FRAME) as link:
        player, wire = Player(link), content(200, seed)

        def blocks() -> Iterator[np.ndarray]:
            for number in range(60):
                if number == 40:
                    time.sleep(0.05)  # the writer has filled the queue by then
                    bus.clock.advance(1e-5 * (seed + 1))
                    player.stop()
                yield wire

        assert player.play(blocks(), update_rate=10e3).stopped_by == "stop"
        bus.clock.advance(0.1)
        assert not bus.board().emitting
        before = len(bus.board().played)
        assert player.play([wire], update_rate=10e3).frames == 200
        bus.clock.advance(1)
        assert np.array_equal(played_since(bus.board(), before)[-200:], wire)
        assert not bus.board().emitting


@pytest.mark.parametrize("amid", [False, True])
def test_beginning_anew_is_silence_and_no_starving(amid: bool) -> None:
    bus = bus_of()
    wire = content(4000)
    with open_link(MODEL, backend=bus) as link:

        def blocks() -> Iterator[np.ndarray]:
            for number in range(40):
                if number == (20 if amid else 0):
                    time.sleep(0.1)  # the writer has sent what there is
                    bus.clock.advance(1.0)
                yield wire[100 * number : 100 * number + 100]

        report = Player(link).play(blocks(), update_rate=10e3)
    board = bus.board()
    assert report.frames == len(played_since(board, 0)) == 4000
    assert report.underruns == board.underruns == int(amid)
    assert report.starved == pytest.approx(board.starved_ns * 1e-9, abs=0.06)
    assert report.silenced == pytest.approx(1.306 if amid else 0.0, abs=0.01)
    assert report.lateness.max == pytest.approx(report.starved + report.silenced, abs=1e-6)
    assert report.on_time < 0.4 + report.starved + 0.01  # silence is no emission


@pytest.mark.parametrize("byte", [0, 600, 1536, 2500])
def test_frames_are_those_executed_where_beginning_anew_fails(byte: int) -> None:
    bus = bus_of()
    wire = content(60)
    with open_link(MODEL, backend=bus) as link:
        player = Player(link)
        link.start(4)
        link.write(array("B", wire[:20].tobytes()))
        bus.clock.advance(2)
        inject(bus, Fault(FaultKind.STALL, byte=bus.board().bytes_received + byte))
        sent = link.bytes_sent
        with pytest.raises(DeviceError):
            link.write(array("B", wire[20:].tobytes()))
        assert link.bytes_sent == sent
        link.send_off()
        assert len(played_since(bus.board(), 0)) == 20
        bus.clock.advance(10)
        assert not bus.board().emitting
        assert player.play([wire], update_rate=10e3).frames == 60
