"""An FT232H over pyusb: requests and kernel drivers; and the links to boards behind it and behind serial adapters."""

from __future__ import annotations

import errno
from array import array
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate.device.boards.discovery import open_link
from palpate.device.boards.pat16.ftdi import FtdiPort
from palpate.device.boards.pat16.link import PatLink
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames, off_frame
from palpate.device.errors import CalibrationError, DeviceBusyError, DeviceStallError, LinkError, UpdateRateError
from palpate.device.registry import array_model, emulated_backend
from palpate.device.transports.pyusb import UsbError

BOARDS = pytest.mark.parametrize("name", ["pat16", "sonicsurface"])


class Recorder:
    """A pyusb device that notes its requests, and answers as it is told."""

    bus, address = 1, 2

    def __init__(self, *, failures: dict[int, int] | None = None) -> None:
        self.requests: list[tuple[int, int, int, int]] = []
        self.failures = failures or {}

    def ctrl_transfer(self, kind: int, request: int, value: int, index: int, data: Any, timeout: int) -> int:
        self.requests.append((kind, request, value, index))
        if request in self.failures:
            raise UsbError("no", None, self.failures[request])
        return 0


def port_of(device: Recorder) -> FtdiPort:
    return FtdiPort(device, "S1", who="pat16 S1", detached=False)


def test_requests_are_those_of_ftdi() -> None:
    device = Recorder()
    port = port_of(device)
    port.reset()
    port.reset_bitmode()
    port.set_latency(2)
    port.purge()
    assert device.requests == [
        (0x40, 0x00, 0, 1),
        (0x40, 0x0B, 0x00FF, 1),
        (0x40, 0x09, 2, 1),
        (0x40, 0x00, 1, 1),
        (0x40, 0x00, 2, 1),
    ]


def test_requests_that_fail_are_errors_of_the_link() -> None:
    with pytest.raises(DeviceStallError):
        port_of(Recorder(failures={0x0B: errno.EPIPE})).reset_bitmode()
    with pytest.raises(LinkError, match="pat16 S1 is gone"):
        port_of(Recorder(failures={0x0B: errno.ENODEV})).reset_bitmode()


def test_a_kernel_driver_is_detached_and_gets_its_chip_back() -> None:
    name = "pat16"
    bus = emulated_backend(name, clock=VirtualClock())
    port = bus._ports[0]
    bus.bind_kernel_driver()
    with open_link(array_model(name), backend=bus) as link:
        assert not port.driver
        link.start(array_model(name).divider_default)
    assert port.driver


@BOARDS
def test_an_adapter_that_another_holds_is_busy(name: str) -> None:
    bus = emulated_backend(name, clock=VirtualClock())
    with open_link(array_model(name), backend=bus), pytest.raises(DeviceBusyError, match=f"array {name} .*in use"):
        open_link(array_model(name), backend=bus)
    open_link(array_model(name), backend=bus).close()


@BOARDS
@pytest.mark.parametrize("torn", [0, 1, 100, 257, 511])
def test_start_finds_the_boundary_of_frames_and_silence(name: str, torn: int) -> None:
    model = array_model(name)
    bus = emulated_backend(name, clock=(clock := VirtualClock()), record=10_000)
    rng = np.random.default_rng(torn)
    content = encode_frames(rng.random((5, 256)), np.ones(5), array=model)
    left = content[:3].tobytes() + content[3].tobytes()[: torn * model.frame_bytes // 512]
    board = bus.board()
    with open_link(model, backend=bus) as killed:
        killed.start(model.divider_default)
        killed.write(array("B", left))
    clock.advance(0.1)
    assert board.emitting
    with open_link(model, backend=bus) as link:
        link.start(model.divider_default)
        assert not board.emitting
        before = len(board.played)
        link.write(array("B", content.tobytes()))
        link.drain()
        clock.advance(0.1)
        assert len(board.played) == before + 5
        assert board.emitting
        link.send_off()
        clock.advance(0.1)
        assert not board.emitting


def test_start_sets_the_divider_of_a_pat16() -> None:
    bus = emulated_backend("pat16", clock=(clock := VirtualClock()), record=100)
    model = array_model("pat16")
    content = array("B", encode_frames(np.zeros((20, 256)), np.ones(20), array=model).tobytes())
    for divider in (8, 3, 255):
        with open_link(model, backend=bus) as link:
            link.start(divider)
            link.write(content)
            link.drain()
            clock.advance(0.2)
            # the first is taken as it comes, and is followed at the end of a carrier period
            assert set(np.diff(bus.board().played_ns[-19:])) == {divider * 25_000}
            with pytest.raises(UpdateRateError, match=r"divider 256 is outside 1\.\.255"):
                link.start(256)


def test_a_torn_frame_is_completed_silent_when_switched_off() -> None:
    bus = emulated_backend("pat16", clock=(clock := VirtualClock()), record=100)
    model = array_model("pat16")
    content = encode_frames(np.zeros((2, 256)), np.ones(2), array=model)
    off = off_frame(array=model).tobytes()
    with open_link(model, backend=bus) as link:
        link.start(4)
        link.write(array("B", content.tobytes()[:700]))
        sent, zeros = link.bytes_sent, bytes(512)
        link.send_off()
        assert link.off_bytes == off + zeros + off + zeros  # the zeros fill blocks, and are skipped
        assert link.bytes_sent == sent + (1024 - 700) + len(link.off_bytes)
        clock.advance(0.1)
    last = bus.board().played[-4:]
    assert last[0].tobytes() == content[0].tobytes()
    assert last[1].tobytes() == content[1].tobytes()[:188] + bytes(324)
    assert last[2].tobytes() == last[3].tobytes() == off


def test_both_buffers_of_a_sonicsurface_are_off_so_that_noise_cannot_switch_it_on() -> None:
    bus = emulated_backend("sonicsurface", clock=(clock := VirtualClock()), record=100)
    model = array_model("sonicsurface")
    content = array("B", encode_frames(np.zeros((2, 256)), np.ones(2), array=model).tobytes())
    with open_link(model, backend=bus) as link:
        link.start(1)
        link.write(content)
        link.send_off()
        clock.advance(0.1)
        for _ in range(2):
            bus.board().accept(memoryview(b"\xfd"))
            clock.advance(0.01)
            assert not bus.board().emitting


def test_a_sonicsurface_whose_clocks_or_board_were_switched_off_plays() -> None:
    bus = emulated_backend("sonicsurface", clock=(clock := VirtualClock()), record=100)
    model = array_model("sonicsurface")
    with open_link(model, backend=bus) as stranger:
        stranger.start(1)
        stranger.write(array("B", b"\x96\xc1"))
        stranger.drain()
    clock.advance(0.1)
    with open_link(model, backend=bus) as link:
        link.start(1)
        link.write(array("B", encode_frames(np.zeros((1, 256)), [1], array=model).tobytes()))
        clock.advance(0.1)
        assert bus.board().emitting
        with pytest.raises(UpdateRateError, match=r"divider 2 is outside 1\.\.1 of array sonicsurface"):
            link.start(2)


def test_a_board_that_never_answers_says_nothing() -> None:
    for name in ("pat16", "sonicsurface"):
        with open_link(array_model(name), backend=emulated_backend(name, clock=VirtualClock())) as link:
            assert (link.status(), link.clear()) == (None, False)
            assert link.transport == {"pat16": "sync", "sonicsurface": "serial"}[name]


def test_a_real_pat16_without_its_board_file_is_refused() -> None:
    with pytest.raises(CalibrationError, match="pat16 needs the board file"):
        PatLink.open(array_model("pat16"))


def test_a_board_file_chooses_its_board(tmp_path: Path) -> None:
    from board_file_cases import board_lines, write

    model = array_model("pat16", calibration=write(tmp_path / "b.pat", board_lines(np.random.default_rng(0))[0]))
    with pytest.raises(CalibrationError, match="the board file is of pat16 FT4TKZL8, not of OTHER"):
        PatLink.open(model, serial="OTHER")
    bus = emulated_backend("pat16", clock=VirtualClock(), serials=["A", "FT4TKZL8"])
    port = FtdiPort.open(model, backend=bus)
    assert port.serial == "FT4TKZL8"
    port.close()
    with open_link(model, serial="A", backend=bus) as link:  # emulated boards have no calibration of their own
        assert link.serial == "A"


def test_an_open_that_fails_gives_the_chip_back() -> None:
    bus = emulated_backend("pat16", clock=VirtualClock())
    bus.bind_kernel_driver()
    with pytest.raises(LinkError):  # an emulated bus has no libusb handle
        PatLink.open(array_model("pat16"), backend=bus, transport="queued")
    assert bus._ports[0].driver
