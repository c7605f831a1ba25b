"""Playback with several transfers under way, to the board model: content, exact counts after a cut, off, replay."""

from __future__ import annotations

from array import array
from collections.abc import Iterator

import numpy as np
import pytest
import usb.core
from board_pipe import BoardPipe

from palpate.device import (
    DeviceLostError,
    DeviceStallError,
    EmulatorBackend,
    LinkError,
    Player,
    UsbLink,
    VirtualClock,
    array_model,
)
from palpate.device.transports.pyusb import claim
from palpate.device.transports.queued import QueuedTransport

FRAME = 512
RATE = 10e3
MODEL = array_model("emulator")
STALL, NO_DEVICE = 4, 5


class Setup:
    def __init__(self) -> None:
        self.bus = EmulatorBackend(clock=VirtualClock(), record=100_000)
        (device,) = usb.core.find(find_all=True, backend=self.bus)
        device.set_configuration()
        claim(device, 0)
        self.pipe = BoardPipe(self.bus)
        transport = QueuedTransport(device, 1, who="emulator EMU0001", clock=self.bus.clock, pipe=self.pipe)
        self.link = UsbLink(MODEL, transport, device, "emulator EMU0001", serial="EMU0001", clock=self.bus.clock)
        self.player = Player(self.link)

    @property
    def played(self) -> np.ndarray:
        return self.bus.board().played

    def assert_off_and_plays_again(self) -> None:
        assert not self.bus.board().playing.any()
        wire = content(300, seed=9)
        assert self.player.play(in_blocks(wire), update_rate=RATE).frames == 300
        assert np.array_equal(self.played[-301:-1], wire)


@pytest.fixture
def setup() -> Iterator[Setup]:
    setup = Setup()
    yield setup
    setup.link.close()


def content(count: int, *, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(1, 256, (count, FRAME), np.uint8)


def in_blocks(wire: np.ndarray, size: int = 100) -> Iterator[array]:
    for start in range(0, len(wire), size):
        yield array("B", wire[start : start + size].tobytes())


def test_content_played_is_content_sent_with_the_queue_full_all_the_time(setup: Setup) -> None:
    wire = content(6000)
    report = setup.player.play(in_blocks(wire), update_rate=RATE)
    assert np.array_equal(setup.played[:-1], wire)
    assert (report.transport, report.frames, report.underruns, report.board_underruns) == ("queued", 6000, 0, 0)
    assert setup.pipe.flight_max == 5  # blocks of 10 ms, 50 ms under way
    assert report.queue_depth is not None
    assert 0.025 <= report.queue_depth.min / FRAME / RATE <= report.queue_depth.mean / FRAME / RATE <= 0.05
    setup.assert_off_and_plays_again()


@pytest.mark.parametrize("cut", [2600 * FRAME, 2600 * FRAME + 1, 2600 * FRAME + 300, 2649 * FRAME + 511])
def test_a_stop_cancels_the_queue_and_the_torn_frame_is_completed_from_what_was_taken(setup: Setup, cut: int) -> None:
    wire = content(5000)
    setup.pipe.fault, setup.pipe.struck = (cut, None), setup.player.stop
    report = setup.player.play(in_blocks(wire), update_rate=RATE)
    assert report.stopped_by == "stop"
    assert (report.bytes, report.frames) == (cut, cut // FRAME)
    assert report.frames_cleared is not None
    whole = report.frames - report.frames_cleared
    assert np.array_equal(setup.played[:whole], wire[:whole])
    if cut % FRAME:
        torn = setup.played[-2]
        assert np.array_equal(torn[: cut % FRAME], wire[cut // FRAME, : cut % FRAME])
        assert not torn[cut % FRAME :].any()
    assert len(setup.played) == whole + (cut % FRAME > 0) + 1
    setup.assert_off_and_plays_again()


@pytest.mark.parametrize(("status", "error"), [(STALL, DeviceStallError), (NO_DEVICE, DeviceLostError), (1, LinkError)])
@pytest.mark.parametrize("at", [0, 700, 2600 * FRAME + 300])
def test_a_transfer_that_fails_ends_the_playback_with_the_count_exact(
    setup: Setup, status: int, error: type[LinkError], at: int
) -> None:
    wire = content(5000)
    setup.pipe.fault = (at, status)
    with pytest.raises(error) as raised:
        setup.player.play(in_blocks(wire), update_rate=RATE)
    report = raised.value.report
    assert report is not None
    assert (report.stopped_by, report.bytes) == ("device", at)
    assert report.off_sent == (error is not DeviceLostError)
    if report.off_sent:
        assert report.frames_cleared is not None
        whole = report.frames - report.frames_cleared
        assert np.array_equal(setup.played[:whole], wire[:whole])
        setup.assert_off_and_plays_again()


def test_a_stop_while_the_board_goes_on_taking_counts_what_it_took_and_what_it_dropped(setup: Setup) -> None:
    wire = content(5000)

    def stop(frames: int) -> None:
        if frames >= 2600:
            setup.player.stop()

    report = setup.player.play(in_blocks(wire), update_rate=RATE, progress=stop)
    assert report.stopped_by == "stop"
    assert report.frames_cleared is not None
    assert setup.bus.board().bytes_received == -(-report.bytes // FRAME) * FRAME + FRAME  # a rest, and off
    whole = report.frames - report.frames_cleared
    assert np.array_equal(setup.played[:whole], wire[:whole])
    assert len(setup.played) == whole + (report.bytes % FRAME > 0) + 1
    setup.assert_off_and_plays_again()
