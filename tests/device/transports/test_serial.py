"""SonicSurface over a serial port: pyserial and the system's tty layer are real, over a pseudo-terminal."""

from __future__ import annotations

import errno
import importlib.util
import os
import signal
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pty_board import PtyBoard, pty_board

from palpate.device import (
    DeviceBusyError,
    DeviceLostError,
    DeviceNotFoundError,
    DevicePermissionError,
    DeviceTimeoutError,
    LinkError,
    NoBackendError,
    Player,
    UpdateRateError,
    VirtualClock,
    array_model,
    encode_frames,
    find_serial_arrays,
    open_link,
)
from palpate.device.transports.serial_transport import SerialTransport

comports = pytest.importorskip("serial.tools.list_ports", reason="pyserial is a test extra")
MODEL = array_model("sonicsurface")
RATE = MODEL.update_rate(MODEL.divider_default)  # [Hz]
# Distribute.vhd: 0xC0 and 0xC1 select a board, 0xFE begins its data, 0xFD swaps the buffers of both boards.
OFF_DATA = b"\xfe" + b"\x20" * 256
OFF_TWICE = OFF_DATA + b"\xfd" + OFF_DATA
OFF_BYTES = b"\xc0" + OFF_TWICE + b"\xc1" + OFF_TWICE + b"\xc0"


def content(count: int, *, seed: int = 0) -> np.ndarray:
    """Frames that all differ, and all emit; every phase byte occurs, those that a terminal would change among them."""
    return encode_frames(np.random.default_rng(seed).random((count, 256)), np.ones(count), array=MODEL)


@pytest.fixture
def board() -> Iterator[PtyBoard]:
    with pty_board() as board:
        yield board


@pytest.mark.exhaustive
def test_content_played_is_content_sent_then_off_in_both_buffers(board: PtyBoard) -> None:
    wire = content(40)
    assert {0x03, 0x0A, 0x0D, 0x11, 0x13, 0x1A} < set(wire.ravel().tolist())
    with open_link(MODEL, serial=board.path) as link:
        report = Player(link).play([wire[:25], wire[25:]], update_rate=RATE)
        assert (report.transport, report.serial, report.frames, report.frames_exact) == ("serial", board.path, 40, True)
        assert (report.off_sent, report.off_confirmed, report.stopped_by) == (True, None, "end")
        board.settle()
        assert link.bytes_sent == len(board.received)
    assert wire.tobytes() in bytes(board.received)
    assert np.array_equal(board.board.played[-42:-2], wire[:, 1:-1])
    assert bytes(board.received).endswith(wire.tobytes() + OFF_BYTES)
    assert not board.board.emitting
    assert (board.board.bytes_garbled, board.board.bytes_stray, board.board.bytes_strange) == (0, 0, 0)
    board.board.accept(memoryview(b"\xfd"))
    board.settle()
    assert not board.board.emitting


def test_a_stop_sends_no_more_than_the_window_and_ends_off(board: PtyBoard) -> None:
    with open_link(MODEL, serial=board.path) as link:
        player = Player(link)

        def endless() -> Iterator[np.ndarray]:
            for number in range(1000):
                if number == 3:
                    player.stop()
                yield content(20, seed=number % 2)

        report = player.play(endless(), update_rate=RATE)
        board.settle()
        sent = len(board.received)
    assert (report.stopped_by, report.off_sent) == ("stop", True)
    assert not board.board.emitting
    # Off at opening, at the start with a byte for the clocks, and at the end.
    assert sent <= report.bytes + 3 * len(OFF_BYTES) + 1
    assert report.frames < 60


def test_a_port_that_vanishes_while_playing_is_lost_and_the_array_perhaps_on(board: PtyBoard) -> None:
    def blocks() -> Iterator[np.ndarray]:
        yield content(10)
        board.unplug()
        yield content(300)

    with open_link(MODEL, serial=board.path) as link:
        with pytest.raises(DeviceLostError, match=f"sonicsurface at {board.path} is gone") as caught:
            Player(link).play(blocks(), update_rate=RATE)
        assert "may still be emitting" in str(caught.value)
        assert caught.value.report is not None
        assert (caught.value.report.off_sent, caught.value.report.frames_exact) == (False, False)


@pytest.mark.exhaustive
def test_a_reader_that_stalls_is_a_time_out_and_the_array_perhaps_on() -> None:
    model = array_model("sonicsurface", baud=12_000_000)  # so that the terminal's buffer is soon full
    with pty_board() as board, open_link(model, serial=board.path) as link:
        board.is_stalled = True
        with pytest.raises(DeviceTimeoutError, match="did not answer in time") as caught:
            Player(link).play([content(2000)], update_rate=model.update_rate(model.divider_default))
        assert "may still be emitting" in str(caught.value)
        before = time.monotonic()
    assert time.monotonic() - before < 5  # closing does not wait for what nobody reads


def test_a_port_has_one_user(board: PtyBoard) -> None:
    with (
        open_link(MODEL, serial=board.path),
        pytest.raises(DeviceBusyError, match=f"array sonicsurface at {board.path} is in use"),
    ):
        open_link(MODEL, serial=board.path)
    open_link(MODEL, serial=board.path).close()


def test_a_path_that_is_no_port_is_refused_by_name(tmp_path: Path, board: PtyBoard) -> None:
    with pytest.raises(DeviceNotFoundError, match="sonicsurface at /dev/ttyNONE was not found: there is no such port"):
        open_link(MODEL, serial="/dev/ttyNONE")
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(LinkError, match=f"sonicsurface at {tmp_path / 'file'} failed: .*Inappropriate ioctl"):
        open_link(MODEL, serial=str(tmp_path / "file"))
    with pytest.raises(UpdateRateError, match=r"divider 259 is outside 1\.\.258 of array sonicsurface"):
        open_link(MODEL, serial=board.path).start(259)


def test_without_permission_the_group_is_told(board: PtyBoard, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    group = Path(board.path).group()
    monkeypatch.setattr("serial.serialposix.os.open", refuse)  # this process may be root's, whom nothing is denied
    message = rf"at {board.path} may not be opened by this user: join the group .*\({group}\)"
    with pytest.raises(DevicePermissionError, match=message):
        open_link(MODEL, serial=board.path)


def test_without_pyserial_it_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for use in (find_serial_arrays, lambda: open_link(MODEL), lambda: open_link(MODEL, serial="/dev/ttyUSB0")):
        with pytest.raises(NoBackendError, match=r"pyserial is not installed.*pip install -e '.\[serial\]'"):
            use()


def adapter(device: str, vid: int | None, pid: int | None, serial: str | None, product: str) -> SimpleNamespace:
    return SimpleNamespace(
        device=device, vid=vid, pid=pid, serial_number=serial, manufacturer=None, product=product, description="n/a"
    )


# ids as Linux's drivers ch341, cp210x, ftdi_sio and cdc_acm know them; a CH340 has no serial number
CH340 = adapter("/dev/ttyUSB0", 0x1A86, 0x7523, None, "USB2.0-Serial")
CP2102 = adapter("/dev/ttyUSB1", 0x10C4, 0xEA60, "0001", "CP2102 USB to UART Bridge Controller")
CP2102_TOO = adapter("/dev/ttyUSB4", 0x10C4, 0xEA60, "0001", "CP2102 USB to UART Bridge Controller")
FT232R = adapter("/dev/ttyUSB2", 0x0403, 0x6001, "A50285BI", "FT232R USB UART")
FT232H = adapter("/dev/ttyUSB3", 0x0403, 0x6014, "FT4TKZL8", "Single RS232-HS")
ESP32 = adapter("/dev/ttyACM0", 0x303A, 0x1001, "F4:12:FA:00:00:01", "USB JTAG/serial debug unit")
BUILT_IN = adapter("/dev/ttyS4", None, None, None, "")


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[SimpleNamespace]:
    ports: list[SimpleNamespace] = []
    monkeypatch.setattr("serial.tools.list_ports.comports", lambda: list(ports))
    return ports


def test_every_adapter_may_be_one_but_a_pat16_s_chip_and_a_built_in_port(plugged: list[SimpleNamespace]) -> None:
    plugged += [CP2102, FT232H, BUILT_IN, CH340, ESP32, FT232R]
    found = find_serial_arrays()
    assert [(info.where, info.serial) for info in found] == [
        ("/dev/ttyACM0", "F4:12:FA:00:00:01"),
        ("/dev/ttyUSB0", None),
        ("/dev/ttyUSB1", "0001"),
        ("/dev/ttyUSB2", "A50285BI"),
    ]
    assert {(info.array, info.certain) for info in found} == {("sonicsurface", False)}
    assert "may be a sonicsurface: it is a serial adapter (USB2.0-Serial)" in (found[1].reason or "")
    assert not found[1].accessible  # there is no such file here
    assert "join the group" in (found[1].reason or "")


def test_one_of_several_adapters_must_be_named_and_the_only_one_is_taken(
    plugged: list[SimpleNamespace], board: PtyBoard
) -> None:
    def refused(match: str, serial: str | None = None) -> None:
        with pytest.raises(DeviceNotFoundError, match=match):
            open_link(MODEL, serial=serial)

    refused("was not found: no serial adapter is plugged in; a port can be named")
    plugged += [adapter(board.path, 0x1A86, 0x7523, None, "USB2.0-Serial"), FT232H, BUILT_IN]
    with open_link(MODEL) as link:
        assert link.serial == board.path
    plugged[:] = [CH340, FT232R, CP2102, CP2102_TOO]
    refused(
        r"at any of 4 serial adapters: /dev/ttyUSB0, 0001 at /dev/ttyUSB1, A50285BI at /dev/ttyUSB2, .* \(serial=NAME\)"
    )
    refused("0001 at /dev/ttyUSB1, 0001 at /dev/ttyUSB4", "0001")  # told apart by their ports alone
    refused("sonicsurface X was not found: found instead: /dev/ttyUSB0, 0001", "X")
    for name, path in (("A50285BI", "/dev/ttyUSB2"), ("/dev/ttyUSB0",) * 2, ("/dev/ttyUSB4",) * 2):
        refused(f"sonicsurface at {path} was not found: there is no such port", name)  # chosen, and then not there


PLAYER = """
import sys, numpy as np
from palpate.device import Player, array_model, encode_frames, open_link
from palpate.device.playing.watchdog import Watchdog
model = array_model("sonicsurface")
wire = encode_frames(np.zeros((50, 256)), np.ones(50), array=model)
with open_link(model, serial=sys.argv[1]) as link, Watchdog(link):
    print("playing", flush=True)
    Player(link).play((wire for _ in range(1000)), update_rate=model.update_rate(model.divider_default))
"""


@pytest.mark.exhaustive
def test_after_a_kill_the_watchdog_switches_it_off(board: PtyBoard) -> None:
    command = [sys.executable, "-c", PLAYER, board.path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as player:
        assert player.stdout is not None
        assert player.stdout.readline() == b"playing\n"
        end = time.monotonic() + 10
        while not board.board.emitting and time.monotonic() < end:
            time.sleep(0.01)
        assert board.board.emitting
        os.kill(player.pid, signal.SIGKILL)
        assert player.wait() == -signal.SIGKILL
        end = time.monotonic() + 15
        while board.board.emitting and time.monotonic() < end:
            time.sleep(0.01)
        board.settle()
        assert not board.board.emitting


class Stuck:
    """A port whose line is held: the driver takes some, gives nothing on, and says so."""

    def __init__(self, room: int) -> None:
        self.room, self.held = room, 0

    def write(self, data: memoryview) -> int:
        count = min(len(data), self.room - self.held)
        self.held += count
        return count

    def waiting(self) -> int:
        return self.held

    def drop_waiting(self) -> None:
        self.held = 0

    def close(self) -> None:
        self.drop_waiting()


def test_a_driver_that_says_what_it_holds_is_given_no_more_than_the_window() -> None:
    port, clock = Stuck(room=4096), VirtualClock()
    transport = SerialTransport(port, 12_000_000, clock=clock)
    transport.window_bytes = 1000
    with pytest.raises(DeviceTimeoutError):
        transport.submit(array("B", bytes(5000)))
    assert (port.held, transport.bytes_under_way, transport.bytes_taken) == (1000, 1000, 0)
    with pytest.raises(DeviceTimeoutError):
        transport.drain()
    assert clock.now_ns() == pytest.approx(2e9, rel=0.02)  # a second each
    port.drop_waiting()
    assert transport.drain()
    transport.submit(array("B", bytes(10)), abandon=lambda: True)
    assert port.held == 10


def test_what_another_program_has_left_in_the_driver_is_not_ours_but_ahead_of_us() -> None:
    port, clock = Stuck(room=4096), VirtualClock()
    port.held = 990
    transport = SerialTransport(port, 230_400, clock=clock)
    transport.window_bytes = 1000
    with pytest.raises(DeviceTimeoutError):
        transport.submit(array("B", bytes(100)))
    assert (port.held, transport.bytes_under_way) == (1000, 10)


def test_what_the_line_cannot_have_carried_yet_is_under_way_where_the_driver_says_nothing() -> None:
    clock = VirtualClock()
    port = SimpleNamespace(write=len, waiting=lambda: 0, close=lambda: None)
    transport = SerialTransport(port, 230_400, clock=clock)
    transport.window_bytes = 258
    transport.submit(array("B", bytes(258)))
    assert (transport.bytes_under_way, transport.bytes_taken) == (258, 0)
    clock.advance(100 * 10 / 230_400)  # eight bits, a start and a stop bit for each byte
    assert (transport.bytes_under_way, transport.bytes_taken) == (158, 100)
    transport.submit(array("B", bytes(258 * 10)))
    assert clock.now_ns() == pytest.approx(258 * 10 * 10 / 230_400 * 1e9, abs=3e6)  # all but the last window
    transport.drain()
    assert (transport.bytes_under_way, transport.bytes_taken) == (0, 258 * 11)


def test_what_was_under_way_when_the_adapter_was_pulled_never_counts_as_taken() -> None:
    def pulled(data: memoryview) -> int:
        raise OSError(errno.EIO, "the adapter was pulled")

    clock = VirtualClock()
    port = SimpleNamespace(write=len, waiting=lambda: 0, close=lambda: None)
    transport = SerialTransport(port, 230_400, clock=clock)
    transport.submit(array("B", bytes(258)))
    clock.advance(100 * 10 / 230_400)
    port.write = pulled
    with pytest.raises(DeviceLostError):
        transport.submit(array("B", bytes(10)))
    clock.advance(1.0)  # in which the line would have carried the rest
    assert (transport.bytes_under_way, transport.bytes_taken, transport.is_exact) == (0, 100, False)
