"""The emulated board and bus, through pyusb itself, as docs/formats/emulator.md tells them."""

from __future__ import annotations

import errno
import struct
from array import array
from collections.abc import Iterator

import numpy as np
import pytest
import usb.core
import usb.util
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.device import EmulatorBackend, VirtualClock

FRAME = 512
PERIOD = 4 * 25_000  # [ns], at the divider after power-up


def frames(count: int, *, seed: int = 0, level: int | None = None) -> array:
    """Random frames; their levels fixed if given."""
    wire = np.random.default_rng(seed).integers(1, 256, (count, FRAME), np.uint8)
    if level is not None:
        wire[:, 1::2] = level
    return array("B", wire.tobytes())


def opened(bus: EmulatorBackend, **match: object) -> usb.core.Device:
    device = usb.core.find(backend=bus, idVendor=0x1209, idProduct=0x0001, **match)
    device.set_configuration()
    usb.util.claim_interface(device, 0)
    return device


def status(device: usb.core.Device) -> tuple[int, ...]:
    """frames played, underruns, starved periods, FIFO frames, torn bytes, level, divider."""
    return struct.unpack("<QQQIHBB", device.ctrl_transfer(0xC0, 0x02, 0, 0, 32))


@pytest.fixture
def bus() -> EmulatorBackend:
    return EmulatorBackend(clock=VirtualClock(), record=100_000)


@pytest.fixture
def board_usb(bus: EmulatorBackend) -> Iterator[usb.core.Device]:
    device = opened(bus)
    yield device
    usb.util.dispose_resources(device)


def tick(bus: EmulatorBackend, periods: float) -> None:
    bus.clock.advance(periods * PERIOD * 1e-9)


def test_one_frame_a_tick_and_the_last_one_holds(bus: EmulatorBackend, board_usb: usb.core.Device) -> None:
    sent = frames(3, level=9)
    board_usb.write(0x01, sent)
    tick(bus, 0.5)
    assert status(board_usb)[:4] == (0, 0, 0, 3)
    tick(bus, 2)
    assert status(board_usb) == (2, 0, 0, 1, 0, 9, 4)
    tick(bus, 5)  # frame 3 at tick 3, then four ticks without a frame
    assert status(board_usb) == (3, 1, 4, 0, 0, 9, 4)
    assert bus.board().played.tobytes() == sent.tobytes()
    assert bus.board().playing.tobytes() == sent[-FRAME:].tobytes()
    assert bus.board().played_ns.tolist() == [PERIOD, 2 * PERIOD, 3 * PERIOD]
    assert (bus.board().frames_played, bus.board().underruns, bus.board().emitting) == (3, 1, True)


def test_underruns_count_once_each_starved_periods_all(bus: EmulatorBackend, board_usb: usb.core.Device) -> None:
    for pause in (3, 5):
        board_usb.write(0x01, frames(1, level=1))
        for _ in range(pause):  # looking on changes nothing
            tick(bus, 1)
            status(board_usb)
    assert status(board_usb)[:3] == (2, 2, 2 + 4)


@pytest.mark.parametrize("divider", [1, 3, 255])
def test_the_divider_sets_the_rate(bus: EmulatorBackend, board_usb: usb.core.Device, divider: int) -> None:
    board_usb.ctrl_transfer(0x40, 0x01, divider)
    board_usb.write(0x01, frames(1000))
    bus.clock.advance(100 * divider * 25e-6)
    assert status(board_usb)[0] == 100
    assert status(board_usb)[6] == divider


def test_a_divider_out_of_range_and_an_unknown_request_stall(board_usb: usb.core.Device) -> None:
    for request in ((0x40, 0x01, 0), (0x40, 0x01, 256), (0x40, 0x01, 65535), (0x40, 0x77, 0)):
        with pytest.raises(usb.core.USBError) as error:
            board_usb.ctrl_transfer(*request)
        assert error.value.errno == errno.EPIPE
    assert status(board_usb)[6] == 4


def test_a_full_fifo_blocks_until_the_clock_makes_room(bus: EmulatorBackend, board_usb: usb.core.Device) -> None:
    assert board_usb.write(0x01, frames(2048)) == 2048 * FRAME
    assert bus.clock.now_ns() == 0
    assert board_usb.write(0x01, frames(10), timeout=1000) == 10 * FRAME
    assert bus.clock.now_ns() == 10 * PERIOD
    assert status(board_usb)[3] == 2048


def test_a_torn_frame_waits_for_its_rest_through_a_clear(bus: EmulatorBackend, board_usb: usb.core.Device) -> None:
    sent = frames(3, level=1)
    board_usb.write(0x01, sent[: 2 * FRAME + 100])
    board_usb.ctrl_transfer(0x40, 0x03)
    assert status(board_usb)[3:5] == (0, 100)
    tick(bus, 100)
    assert status(board_usb)[0] == 0
    board_usb.write(0x01, sent[2 * FRAME + 100 :])
    tick(bus, 1)
    assert bus.board().played.tobytes() == sent[2 * FRAME :].tobytes()


@settings(max_examples=40, deadline=None)
@given(st.lists(st.integers(1, 60_000), min_size=1, max_size=40), st.integers(1, 255))
def test_content_played_is_content_sent_in_pieces_of_any_size(sizes: list[int], divider: int) -> None:
    bus = EmulatorBackend(clock=VirtualClock(), record=100_000)
    device = opened(bus)
    device.ctrl_transfer(0x40, 0x01, divider)
    whole = sum(sizes) // FRAME
    sent = frames(whole + 1)[: sum(sizes)]
    start = 0
    for size in sizes:
        assert device.write(0x01, sent[start : start + size], timeout=0) == size
        start += size
    bus.clock.advance(2049 * divider * 25e-6)
    assert bus.board().played.tobytes() == sent[: whole * FRAME].tobytes()
    assert status(device)[4] == sum(sizes) % FRAME
    usb.util.dispose_resources(device)
