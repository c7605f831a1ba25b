"""The emulated serial ports with boards behind them: room, faults, plugs, and who may open one."""

from __future__ import annotations

import ast
import errno
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

import palpate.device
from palpate.device.boards.sonicsurface.model import SonicPorts
from palpate.device.clock import VirtualClock
from palpate.device.emulation.serial_bus import ADAPTER_BYTES, DRIVER_BYTES
from palpate.device.transports.serial_line import SerialPort

BAUD = 230_400
BYTE_NS = 10e9 / BAUD


def frames(count: int) -> bytes:
    """Frames that emit, each another."""
    return b"".join(bytes([0xFE]) + bytes([number % 32]) * 256 + bytes([0xFD]) for number in range(count))


def patterns(data: bytes) -> bytes:
    return np.frombuffer(data, np.uint8).reshape(-1, 258)[:, 1:-1].tobytes()


@pytest.fixture
def ports() -> SonicPorts:
    return SonicPorts(["one", "two"], clock=VirtualClock(), record=1000)


@pytest.fixture
def port(ports: SonicPorts) -> SerialPort:
    return ports.open(ports.path(), baud=BAUD)


def write_all(ports: SonicPorts, port: SerialPort, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[port.write(left) :]
        ports.clock.sleep_until_ns(ports.clock.now_ns() + 1_000_000)


def raised(code: int, call: Callable[[], object]) -> None:
    with pytest.raises(OSError, match=r"\[Errno") as error:
        call()
    assert error.value.errno == code


def test_they_know_nothing_of_pyserial() -> None:
    folder = Path(palpate.device.__file__).parent
    for module in ("emulation/serial_bus", "transports/serial_line", "boards/sonicsurface/model"):
        tree = ast.parse((folder / f"{module}.py").read_text())
        imported = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level}
        assert imported <= {"clock", "errors", "transports.serial_line", "emulation.serial_bus"}


def test_what_is_written_is_played(ports: SonicPorts, port: SerialPort) -> None:
    write_all(ports, port, frames(150))
    ports.clock.sleep_until_ns(round(151 * 258 * BYTE_NS))
    assert ports.board().played.tobytes() == patterns(frames(150))
    assert len(ports.board().played_ns) == ports.board().frames_played == 150
    assert ports.board().emitting
    assert not ports.board(1).frames_played


def test_driver_and_adapter_hold_so_much_and_the_driver_says_so(ports: SonicPorts, port: SerialPort) -> None:
    assert port.write(memoryview(frames(30))) == DRIVER_BYTES + ADAPTER_BYTES
    assert (port.write(memoryview(frames(1))), port.waiting()) == (0, DRIVER_BYTES)
    ports.clock.sleep_until_ns(round(100.5 * BYTE_NS))
    assert (port.waiting(), port.write(memoryview(frames(1)))) == (DRIVER_BYTES - 100, 100)
    port.drop_waiting()
    assert (port.waiting(), ports.board().queued) == (0, ADAPTER_BYTES)


def test_closing_drops_what_the_driver_holds_and_the_board_plays_on(ports: SonicPorts, port: SerialPort) -> None:
    port.write(memoryview(frames(10)))
    port.close()
    ports.clock.sleep_until_ns(10**9)
    assert ports.board().frames_played == ADAPTER_BYTES // 258
    assert ports.board().emitting
    ports.open(ports.path(), baud=BAUD).close()


def test_a_port_has_one_user_and_must_be_there(ports: SonicPorts, port: SerialPort) -> None:
    raised(errno.EAGAIN, lambda: ports.open(ports.path(), baud=BAUD))
    raised(errno.ENOENT, lambda: ports.open("emulated:9", baud=BAUD))
    inject(ports, Fault(FaultKind.DENIED), index=1)
    raised(errno.EACCES, lambda: ports.open(ports.path(1), baud=BAUD))
    ports.open(ports.path(1), baud=BAUD).close()


def test_after_replugging_a_board_is_as_from_power_up(ports: SonicPorts, port: SerialPort) -> None:
    port.write(memoryview(frames(2)))
    ports.clock.sleep_until_ns(10**8)
    ports.unplug()
    assert not ports.board().emitting
    raised(errno.ENOENT, lambda: ports.open(ports.path(), baud=BAUD))
    ports.replug()
    board = ports.board()
    assert (board.emitting, board.frames_played, board.bytes_received) == (True, 0, 0)
    raised(errno.EIO, port.waiting)  # that one was of the adapter before
    ports.open(ports.path(), baud=BAUD).write(memoryview(frames(2)))
