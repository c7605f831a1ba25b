"""The link over pyusb: finding, opening, short writes, and an error of our own for each of the bus's."""

from __future__ import annotations

from array import array
from collections.abc import Callable

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.device import (
    DeviceBusyError,
    DeviceError,
    DeviceLostError,
    DeviceNotFoundError,
    DeviceStallError,
    DeviceTimeoutError,
    EmulatorBackend,
    LinkError,
    UsbLink,
    VirtualClock,
    array_model,
    find_arrays,
    open_link,
)

FRAME = 512
MODEL = array_model("emulator")


def frames(count: int, *, seed: int = 0) -> array:
    return array("B", np.random.default_rng(seed).integers(1, 256, count * FRAME, np.uint8).tobytes())


@pytest.fixture
def bus() -> EmulatorBackend:
    return EmulatorBackend(["one", "two"], clock=VirtualClock(), record=10_000)


def test_a_strangers_device_with_the_shared_test_ids_is_no_array(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate.device.boards.emulator.model.PRODUCT_STRING", "a keyboard")
    bus = EmulatorBackend(clock=VirtualClock())
    assert find_arrays(backend=bus) == ()
    with pytest.raises(DeviceNotFoundError, match="plug it in"):
        open_link(MODEL, backend=bus)


def test_a_claim_refused_by_the_system_is_busy_and_leaves_nothing_open(bus: EmulatorBackend) -> None:
    inject(bus, Fault(FaultKind.BUSY))
    with pytest.raises(DeviceBusyError):
        open_link(MODEL, backend=bus)
    open_link(MODEL, backend=bus).close()


def test_an_open_that_fails_lets_the_array_go(bus: EmulatorBackend) -> None:
    with pytest.raises(LinkError) as refused:  # an emulated bus has no libusb handle
        open_link(MODEL, backend=bus, transport="queued")
    open_link(MODEL, backend=bus).close()
    assert "queued" in str(refused.value)


@pytest.mark.parametrize("kind", [FaultKind.SHORT, FaultKind.TIMEOUT])
@pytest.mark.parametrize("offset", [0, 1, 511, 512, 700])
def test_a_short_write_is_completed_and_counted(bus: EmulatorBackend, kind: FaultKind, offset: int) -> None:
    inject(bus, Fault(kind, byte=offset))
    sent = frames(3)
    with open_link(MODEL, backend=bus) as link:
        link.write(sent)
        assert (link.short_writes, link.bytes_sent) == (1, len(sent))
        bus.clock.advance(1)
    assert bus.board().played.tobytes() == sent.tobytes()


def test_an_abandoned_write_says_how_much_was_taken_and_off_completes_the_frame(bus: EmulatorBackend) -> None:
    inject(bus, Fault(FaultKind.SHORT, byte=700))
    sent = frames(3)
    with open_link(MODEL, backend=bus) as link:
        link.status()
        link.write(sent, abandon=lambda: True)
        assert link.bytes_sent == 700
        link.send_off()
        bus.clock.advance(1)
    expected = sent[:700].tobytes() + bytes(2 * FRAME - 700) + bytes(FRAME)
    assert bus.board().played.tobytes() == expected


def test_after_a_stall_the_board_is_asked_how_much_it_took(bus: EmulatorBackend) -> None:
    inject(bus, Fault(FaultKind.STALL, byte=700))
    with open_link(MODEL, backend=bus) as link:
        link.status()
        with pytest.raises(DeviceStallError):
            link.write(frames(3))
        link.send_off()
        bus.clock.advance(1)
    assert len(bus.board().played) == 3
    assert not bus.board().playing.any()


def test_a_board_that_takes_nothing_ends_the_write_in_bounded_time(bus: EmulatorBackend) -> None:
    inject(bus, Fault(FaultKind.TIMEOUT, byte=100, count=None))
    with open_link(MODEL, backend=bus) as link:
        with pytest.raises(DeviceTimeoutError, match="emulator one did not answer in time"):
            link.write(frames(1))
        assert link.bytes_sent == 100
    assert bus.clock.now_ns() < 2e9


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        (FaultKind.UNPLUG, DeviceLostError),
        (FaultKind.STALL, DeviceStallError),
        (FaultKind.TIMEOUT, DeviceTimeoutError),
    ],
)
@pytest.mark.parametrize(
    ("request_number", "call"),
    [(1, lambda link: link.start(4)), (2, lambda link: link.status()), (3, lambda link: link.clear())],
)
def test_a_failed_request_is_an_error_of_our_own(
    bus: EmulatorBackend,
    kind: FaultKind,
    error: type[DeviceError],
    request_number: int,
    call: Callable[[UsbLink], object],
) -> None:
    with open_link(MODEL, backend=bus) as link:
        inject(bus, Fault(kind, request=request_number))
        with pytest.raises(error, match="array emulator one"):
            call(link)


def test_a_write_never_blocks_for_more_than_50_ms(bus: EmulatorBackend, monkeypatch: pytest.MonkeyPatch) -> None:
    timeouts: list[int] = []
    original = EmulatorBackend.bulk_write

    def noted(self: EmulatorBackend, handle, ep, intf, data, timeout) -> int:
        timeouts.append(timeout)
        return original(self, handle, ep, intf, data, timeout)

    monkeypatch.setattr(EmulatorBackend, "bulk_write", noted)
    with open_link(MODEL, backend=bus) as link:
        link.start(255)  # 157 Hz
        link.write(frames(2100))  # more than the FIFO holds
        asked: list[int] = []
        link.write(frames(100), abandon=lambda: asked.append(bus.clock.now_ns()) or len(asked) >= 5)
    assert set(timeouts) == {50}
    assert max(np.diff(asked)) <= 50e6
    assert 5 <= len(asked) <= 6  # the stream asks again between pieces


def test_after_a_stall_the_next_start_ends_the_halt(bus: EmulatorBackend) -> None:
    inject(bus, Fault(FaultKind.STALL, byte=700))
    with open_link(MODEL, backend=bus) as link:
        link.start(4)
        with pytest.raises(DeviceStallError):
            link.write(frames(3))
        link.start(4)
        link.write(frames(2))
        bus.clock.advance(1)
        assert np.array_equal(bus.board().played[-2:].ravel(), np.frombuffer(frames(2), np.uint8))
