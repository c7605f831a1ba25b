"""The links to real boards against the models of those boards: every frame arrives, whatever the last player left."""

from __future__ import annotations

from array import array

import numpy as np
import pytest
import usb.core
import usb.util
from board_outputs import pat_pulses

from palpate.device.boards.discovery import open_link
from palpate.device.clock import VirtualClock
from palpate.device.codec import encode_frames
from palpate.device.emulation.serial_bus import EmulatedPorts
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.errors import UpdateRateError
from palpate.device.registry import array_model, emulated_backend

NAMES = ("emulator", "pat16", "sonicsurface")
OUT_ENDPOINT = {"emulator": 0x01, "pat16": 0x02}


def bus_of(name: str) -> EmulatedBus | EmulatedPorts:
    return emulated_backend(name, clock=VirtualClock(), record=10_000)


def wire(name: str, count: int, seed: int = 0) -> np.ndarray:
    """Frames that emit from every transducer."""
    delay = np.random.default_rng(seed).random((count, 256), np.float32)
    return encode_frames(delay, np.ones(count), array=array_model(name))


def emitted(name: str, frames: np.ndarray) -> bytes:
    """What of frames, or of what a board has played of them, makes the transducers do what they do."""
    if name == "pat16":
        return b"".join(part.tobytes() for part in pat_pulses(frames))
    return (frames[:, 1:-1] if frames.shape[1] == 258 else frames).tobytes()


def write(link, frames: np.ndarray) -> None:
    link.write(array("B", frames.tobytes()), abandon=lambda: False)
    assert link.drain(abandon=lambda: False)


def killed_player(bus: EmulatedBus | EmulatedPorts, name: str, frames: np.ndarray, torn: int, *, count: int) -> None:
    """Play so many frames, then leave the array as it is, with part of a frame in it and no word of goodbye."""
    link = open_link(array_model(name), backend=bus)
    link.start(link.array.divider_default)
    write(link, frames[:count])
    link.close()
    torn_frame = array("B", frames[0, :torn].tobytes())
    if isinstance(bus, EmulatedPorts):
        port = bus.open(bus.path(), baud=230_400)
        assert port.write(memoryview(torn_frame)) == torn
        bus.clock.advance(0.1)
        port.close()
        return
    device = usb.core.find(backend=bus)
    if device.is_kernel_driver_active(0):
        device.detach_kernel_driver(0)
    if torn:
        device.write(OUT_ENDPOINT[name], torn_frame, timeout=1000)
    usb.util.dispose_resources(device)
    bus.clock.advance(0.1)


@pytest.mark.parametrize(
    ("count", "torn"), [(0, 100), (5, 0), (5, 1), (5, 100), (5, 255), (5, 256), (5, 257), (5, 511)]
)
@pytest.mark.parametrize("name", NAMES)
def test_whatever_a_killed_player_left_the_next_one_starts_silent_and_whole(name: str, count: int, torn: int) -> None:
    bus = bus_of(name)
    frames = wire(name, 5)
    killed_player(bus, name, frames, torn % frames.shape[1], count=count)
    assert bus.board().emitting == (count > 0)
    left = bus.board().bytes_received
    link = open_link(array_model(name), backend=bus)
    link.start(link.array.divider_default)
    bus.clock.advance(0.1)
    assert not bus.board().emitting
    before = bus.board().frames_played
    again = wire(name, 20, seed=1)
    write(link, again)
    link.send_off()
    bus.clock.advance(0.5)
    assert emitted(name, bus.board().played[before : before + 20]) == emitted(name, again)
    assert not bus.board().emitting
    assert bus.board().bytes_received - left == link.bytes_sent
    link.close()


@pytest.mark.parametrize("divider", [4, 255])
def test_a_pat_board_is_silent_at_once_after_start_however_slow_the_last_player_was(divider: int) -> None:
    bus = bus_of("pat16")
    dead = open_link(array_model("pat16"), backend=bus)
    dead.start(divider)
    write(dead, wire("pat16", 28))
    dead.close()
    bus.clock.advance(0.01)
    assert bus.board().emitting
    link = open_link(array_model("pat16"), backend=bus)
    assert bus.board().emitting  # opening sends nothing
    for slower in (4, divider, 4):
        before_ns = bus.clock.now_ns()
        link.start(slower)
        assert not bus.board().emitting
        write(link, wire("pat16", 28))
    # whoever keeps count knows the rate, too: no wait is longer than what was queued
    assert bus.clock.now_ns() - before_ns < 35 * divider * 25_000 + 10_000_000
    link.close()


@pytest.mark.parametrize("divider", [3, 4, 100])
def test_the_pat_board_plays_at_the_rate_that_the_link_was_started_with(divider: int) -> None:
    bus = bus_of("pat16")
    link = open_link(array_model("pat16"), backend=bus)
    link.start(divider)
    bus.clock.advance(0.1)
    before = bus.board().frames_played
    write(link, wire("pat16", 50))
    bus.clock.advance(0.5)
    # The first is taken as soon as its bytes have come, and is followed at the end of a carrier period.
    lasted_ns = np.diff(bus.board().played_ns[before:])
    assert (divider - 1) * 25_000 < lasted_ns[0] <= divider * 25_000
    assert (lasted_ns[1:] == divider * 25_000).all()
    with pytest.raises(UpdateRateError, match=r"divider 256 is outside 1\.\.255"):
        link.start(256)
    link.close()
