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
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames, off_frame
from palpate.device.errors import CalibrationError, DeviceStallError, LinkError, UpdateRateError
from palpate.device.registry import array_model, emulated_backend
from palpate.device.transports.pyusb import UsbError


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


def test_a_sonicsurface_whose_clocks_or_board_were_switched_off_plays() -> None:
    bus = emulated_backend("sonicsurface", clock=(clock := VirtualClock()), record=100)
    model = array_model("sonicsurface")
    with open_link(model, backend=bus) as stranger:
        stranger.start(model.divider_default)
        stranger.write(array("B", b"\x96\xc1"))
        stranger.drain()
    clock.advance(0.1)
    with open_link(model, backend=bus) as link:
        link.start(model.divider_default)
        link.write(array("B", encode_frames(np.zeros((1, 256)), [1], array=model).tobytes()))
        clock.advance(0.1)
        assert bus.board().emitting
        with pytest.raises(UpdateRateError, match=r"divider 259 is outside 1\.\.258 of array sonicsurface"):
            link.start(259)


def test_a_board_that_never_answers_says_nothing() -> None:
    for name in ("pat16", "sonicsurface"):
        with open_link(array_model(name), backend=emulated_backend(name, clock=VirtualClock())) as link:
            assert (link.status(), link.clear()) == (None, False)
            assert link.transport == {"pat16": "sync", "sonicsurface": "serial"}[name]


def test_a_real_pat16_without_its_board_file_is_refused() -> None:
    with pytest.raises(CalibrationError, match="pat16 needs the board file"):
        open_link(array_model("pat16"))


def test_a_board_file_chooses_its_board(tmp_path: Path) -> None:
    from board_file_cases import board_lines, write

    model = array_model("pat16", calibration=write(tmp_path / "b.pat", board_lines(np.random.default_rng(0))[0]))
    with pytest.raises(CalibrationError, match="the board file is of pat16 FT4TKZL8, not of OTHER"):
        open_link(model, serial="OTHER")
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
        open_link(array_model("pat16"), backend=bus, transport="queued")
    assert bus._ports[0].driver
