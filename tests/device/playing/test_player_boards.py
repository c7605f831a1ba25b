"""Playback to the models of real boards, whose links never answer: content, bursts, faults, and off after each."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from injected_faults import Fault, FaultKind, inject

from palpate.device import (
    ArrayModel,
    DeviceLostError,
    DeviceStallError,
    DeviceTimeoutError,
    EmulatorBackend,
    FrameError,
    Limits,
    Link,
    Player,
    PlayInterrupted,
    SafetyLimitError,
    UpdateRateError,
    VirtualClock,
    array_model,
    encode_frames,
    open_link,
)
from palpate.device.emulation.serial_bus import EmulatedPorts
from palpate.device.emulation.usb_bus import EmulatedBus
from palpate.device.registry import emulated_backend

BOARDS = ("emulator", "pat16", "sonicsurface")
USB_BOARDS = ("emulator", "pat16")


class Broken(Exception):
    """What a maker of blocks may raise."""


def rate_of(model: ArrayModel) -> float:
    return model.update_rate(model.divider_default)


def content(model: ArrayModel, count: int, *, seed: int = 0) -> np.ndarray:
    """Frames that all differ, and all emit."""
    rng = np.random.default_rng(seed)
    shape = (count, model.transducer_count)
    return encode_frames(rng.random(shape), rng.uniform(0.6, 1, shape), array=model)


def in_blocks(wire: np.ndarray, size: int = 64) -> Iterator[np.ndarray]:
    for start in range(0, len(wire), size):
        yield wire[start : start + size]


def as_played(model: ArrayModel, wire: np.ndarray) -> np.ndarray:
    """What a board records of wire frames: a SonicSurface drops its two marks."""
    return wire[:, 1:-1] if model.name == "sonicsurface" else wire


def emitting(model: ArrayModel, played: np.ndarray) -> np.ndarray:
    """Which frames that a board has played emit."""
    if model.name == "sonicsurface":
        return (played < 32).any(axis=1)
    return played[:, 256:].any(axis=1) if model.name == "pat16" else played[:, 1::2].any(axis=1)


class Setup:
    def __init__(self, name: str) -> None:
        self.model = array_model(name)
        self.bus: EmulatedBus[Any] | EmulatedPorts = emulated_backend(name, clock=VirtualClock(), record=100_000)
        self.link: Link = open_link(self.model, backend=self.bus)
        self.player = Player(self.link)

    @property
    def board(self) -> Any:
        return self.bus.board()

    def play(self, wire: np.ndarray) -> Any:
        return self.player.play(in_blocks(wire), update_rate=rate_of(self.model))

    def last_played(self, count: int) -> np.ndarray:
        """The last frames up to the last that emits."""
        played = self.board.played
        end = int(np.flatnonzero(emitting(self.model, played))[-1]) + 1
        return played[end - count : end]

    def assert_off(self) -> None:
        assert not self.board.emitting
        self.bus.clock.advance(2)
        assert not self.board.emitting

    def assert_plays_again(self) -> None:
        wire = content(self.model, 20, seed=7)
        assert self.play(wire).frames == 20
        assert np.array_equal(self.last_played(20), as_played(self.model, wire))
        self.assert_off()


@pytest.fixture
def setup(request: pytest.FixtureRequest) -> Iterator[Setup]:
    threads = threading.active_count()
    setup = Setup(request.param)
    yield setup
    setup.link.close()
    assert threading.active_count() == threads


@pytest.mark.parametrize("setup", BOARDS, indirect=True)
def test_content_played_is_content_sent_then_off(setup: Setup) -> None:
    wire = content(setup.model, 300)
    report = setup.play(wire)
    assert np.array_equal(setup.last_played(300), as_played(setup.model, wire))
    setup.assert_off()
    assert (report.frames, report.frames_cleared, report.underruns) == (300, 0, 0)
    assert report.off_sent
    assert report.frames_exact
    assert report.transport == ("serial" if setup.model.name == "sonicsurface" else "sync")
    answers = setup.model.name == "emulator"  # the other boards never do, which is no error
    assert (report.off_confirmed, report.board_underruns) == ((True, 0) if answers else (None, None))
    assert report.elapsed >= report.duration  # for as long as the board can have played
    setup.assert_plays_again()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("setup", BOARDS, indirect=True)
def test_a_stop_ends_off_within_what_the_board_holds(setup: Setup) -> None:
    wire = content(setup.model, 64)

    def endless() -> Iterator[np.ndarray]:
        for number in range(1000):
            if number == 30:
                setup.player.stop()
            yield wire

    report = setup.player.play(endless(), update_rate=rate_of(setup.model))
    assert report.stopped_by == "stop"
    assert report.off_sent
    setup.assert_off()
    played = setup.board.played
    whole = report.frames - report.frames_cleared
    end = len(played)
    while end and np.array_equal(played[end - 1], played[-1]):  # before the off frame, of which a SonicSurface gets two
        end -= 1
    is_completed = setup.model.name != "sonicsurface"  # whose next start byte ends a torn frame, which is never shown
    end -= is_completed and report.bytes % setup.model.frame_bytes > 0  # and before a torn frame
    assert np.array_equal(
        played[end - whole : end], np.resize(as_played(setup.model, wire), (whole, *played.shape[1:]))
    )
    setup.assert_plays_again()


@pytest.mark.parametrize("byte", [0, 300, 11 * 512 + 77])
@pytest.mark.parametrize(
    ("setup", "kind", "error"),
    [
        *((name, FaultKind.STALL, DeviceStallError) for name in USB_BOARDS),  # a serial line has no stalls
        *((name, FaultKind.UNPLUG, DeviceLostError) for name in BOARDS),
    ],
    indirect=["setup"],
)
def test_a_fault_ends_it_with_the_array_off(setup: Setup, kind: FaultKind, error: type[Exception], byte: int) -> None:
    wire = content(setup.model, 200)
    setup.play(wire[:5])  # so that the fault hits content, not what comes before it
    inject(setup.bus, Fault(kind, byte=content_byte(setup, byte)))
    played = len(setup.board.played)
    with pytest.raises(error) as raised:
        setup.play(wire)
    report = raised.value.report
    assert report is setup.player.report
    assert report.stopped_by == "device"
    assert report.off_sent == (kind is FaultKind.STALL)
    assert ("may still be emitting" in str(raised.value)) == (kind is FaultKind.UNPLUG)
    # pyusb does not say how much of a write that failed was taken; only this board does, while it is there
    assert report.frames_exact == (setup.model.name == "emulator" and kind is FaultKind.STALL)
    assert (report.frames_cleared is not None) == report.frames_exact
    assert report.bytes == byte if report.frames_exact else report.bytes <= byte
    assert report.frames == report.bytes // setup.model.frame_bytes
    setup.assert_off()
    if kind is FaultKind.UNPLUG:
        setup.bus.replug()
        setup.link.close()
        setup.bus.clock.advance(3)  # a pat16 is deaf at first
        setup.link = open_link(setup.model, backend=setup.bus)
        setup.player = Player(setup.link)
    else:
        content_played = setup.board.played[played:]
        assert len(content_played) >= byte // setup.model.frame_bytes - (report.frames_cleared or 0)
    setup.assert_plays_again()


def content_byte(setup: Setup, byte: int) -> int:
    """Where on the bus a byte of the next playback's content will be, behind what its start sends."""
    setup.link.start(setup.model.divider_default)
    before = setup.board.bytes_received
    setup.link.start(setup.model.divider_default)  # sends what the next start will
    return 2 * setup.board.bytes_received - before + byte


@pytest.mark.parametrize("setup", BOARDS, indirect=True)
@pytest.mark.parametrize("kind", [FaultKind.SHORT, FaultKind.TIMEOUT])
def test_short_writes_change_nothing_that_is_played(setup: Setup, kind: FaultKind) -> None:
    at = content_byte(setup, 0)
    for byte in (1, 700, 3000, 3001):
        inject(setup.bus, Fault(kind, byte=at + byte))
    wire = content(setup.model, 60)
    report = setup.play(wire)
    assert report.short_writes >= 4
    assert np.array_equal(np.unique(as_played(setup.model, wire), axis=0), distinct(setup.board.played[-100:], wire))
    assert np.array_equal(setup.last_played(60), as_played(setup.model, wire))
    setup.assert_off()


def distinct(played: np.ndarray, wire: np.ndarray) -> np.ndarray:
    """The frames played that are content, each once: no torn one is among them."""
    silent = {0, 32, 128}
    return np.unique([frame for frame in played if len(set(frame.tolist()) - silent) > 2], axis=0)


@pytest.mark.parametrize("setup", BOARDS, indirect=True)
def test_a_board_that_hangs_is_said_to_be_possibly_emitting(setup: Setup) -> None:
    setup.play(content(setup.model, 5))
    inject(setup.bus, Fault(FaultKind.TIMEOUT, byte=setup.board.bytes_received + 20 * 512, count=None))
    with pytest.raises(DeviceTimeoutError, match="did not answer in time"):
        setup.play(content(setup.model, 200))
    report = setup.player.report
    assert report is not None
    assert not report.off_sent
    assert report.off_confirmed is not True
    assert setup.board.emitting  # held, as documented


@pytest.mark.parametrize("setup", ["pat16"], indirect=True)
@pytest.mark.parametrize("divider", [1, 2])
def test_a_burst_plays_and_more_than_it_is_refused_before_anything_is_sent(setup: Setup, divider: int) -> None:
    wire = content(setup.model, 29)
    rate = 40e3 / divider
    report = setup.player.play(in_blocks(wire[:28], 5), update_rate=rate)
    played = setup.last_played(28).copy()
    played[0, 26:35] &= 0x7F  # the first one sets the rate
    assert np.array_equal(played, wire[:28])
    assert (report.frames, report.underruns, report.lateness.max) == (28, 0, 0.0)
    first = int(np.flatnonzero(emitting(setup.model, setup.board.played))[0])
    assert not setup.board.lateness_ns[first : first + 29].any()  # all of it was in the FIFO when it began
    assert np.allclose(np.diff(setup.board.played_ns[first : first + 29]), divider * 25_000)
    frames = len(setup.board.played)
    with pytest.raises(UpdateRateError, match=r"beyond 28 frames it needs divider 3 or more, which is 13333\.3 Hz"):
        setup.player.play(in_blocks(wire, 5), update_rate=rate)
    assert not setup.board.played[frames:].any() or not (setup.board.played[frames:, 256:] & 0x7F).any()
    setup.assert_off()
    setup.assert_plays_again()


@pytest.mark.parametrize("setup", ["pat16"], indirect=True)
def test_a_burst_that_is_stopped_while_it_is_held_has_sounded_when_play_returns(
    setup: Setup, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = setup.link.write

    def stop_behind(data: Any, **options: Any) -> None:
        write(data, **options)
        setup.player.stop()

    monkeypatch.setattr(setup.link, "write", stop_behind)
    report = setup.player.play([content(setup.model, 28)], update_rate=40e3)
    assert (report.stopped_by, report.frames, report.frames_cleared) == ("stop", 28, 0)
    played = setup.board.frames_played
    setup.assert_off()
    assert setup.board.frames_played == played
    monkeypatch.undo()
    setup.assert_plays_again()


@pytest.mark.parametrize("setup", ["pat16"], indirect=True)
@pytest.mark.parametrize("byte", [-100, 0, 3 * 512 + 100])
def test_the_hold_of_a_burst_is_no_content(setup: Setup, byte: int) -> None:
    at = content_byte(setup, 512 + byte)
    inject(setup.bus, Fault(FaultKind.TIMEOUT, byte=at, count=None))
    with pytest.raises(DeviceTimeoutError) as raised:
        setup.player.play([content(setup.model, 20)], update_rate=40e3)
    report = raised.value.report
    assert report is not None
    assert (report.bytes, report.frames, report.frames_exact) == (max(byte, 0), max(byte, 0) // 512, True)


@pytest.mark.parametrize("setup", USB_BOARDS, indirect=True)
@pytest.mark.parametrize("at", ["end", "stop"])
def test_a_stall_on_the_off_frame_is_tried_again(setup: Setup, at: str, monkeypatch: pytest.MonkeyPatch) -> None:
    wire = content(setup.model, 200)
    if at == "end":
        inject(setup.bus, Fault(FaultKind.STALL, byte=content_byte(setup, wire.size), count=2))
    send_off = setup.link.send_off

    def stall_first() -> None:
        monkeypatch.undo()
        inject(setup.bus, Fault(FaultKind.STALL, byte=setup.board.bytes_received, count=2))
        send_off()

    def blocks() -> Iterator[np.ndarray]:
        yield from in_blocks(wire)
        if at == "stop":
            monkeypatch.setattr(setup.link, "send_off", stall_first)
            setup.player.stop()

    with pytest.raises(DeviceStallError) as raised:
        setup.player.play(blocks(), update_rate=rate_of(setup.model))
    assert "emitting" not in str(raised.value)
    assert raised.value.report is not None
    assert raised.value.report.off_sent
    setup.assert_off()
    setup.assert_plays_again()


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("setup", BOARDS, indirect=True)
@pytest.mark.parametrize("error", [DeviceStallError, SafetyLimitError, PlayInterrupted, FrameError, Broken])
def test_whatever_it_raises_says_that_the_array_may_still_be_emitting(
    setup: Setup, error: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    wire, rate = content(setup.model, 600), rate_of(setup.model)
    cancel = setup.link.cancel

    def cancel_late() -> None:
        cancel()
        setup.bus.clock.advance(10 / rate)  # so that some of it is played

    def refuse() -> None:
        raise DeviceStallError("array refused (stall)")

    def blocks() -> Iterator[np.ndarray]:
        monkeypatch.setattr(setup.link, "cancel", cancel_late)
        monkeypatch.setattr(setup.link, "send_off", refuse)
        yield from in_blocks(wire)
        end = time.monotonic() + 5  # keeps a broken test from hanging
        while setup.board.bytes_received < 100 * setup.model.frame_bytes and time.monotonic() < end:
            time.sleep(0.001)
        if error is DeviceStallError:
            player.stop()
        elif error is PlayInterrupted:
            signal.raise_signal(signal.SIGINT)
        elif error is FrameError:
            yield np.zeros(3, np.uint8)
        elif error is Broken:
            raise Broken

    limits = Limits(on_time_max=len(wire) / 2 / rate if error is SafetyLimitError else None)
    player = Player(setup.link, limits=limits, queue_blocks=2)
    with pytest.raises(error) as raised:
        player.play(blocks(), update_rate=rate)
    said = raised.value.__notes__[0] if error is Broken else str(raised.value)
    assert said.endswith(f"array {setup.model.name} may still be emitting, switch it off")
    assert said.count("emitting") == 1
    assert player.report is not None
    assert player.report.may_emit


def test_playing_begins_when_80_ms_are_ready_however_many_blocks_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    model = array_model("emulator")
    begun = threading.Event()
    seen: list[bool] = []

    def blocks() -> Iterator[np.ndarray]:
        for _ in range(8):
            seen.append(begun.is_set())
            yield content(model, 100)
        seen.append(begun.wait(20))
        yield content(model, 100)

    with open_link(model, backend=EmulatorBackend(clock=VirtualClock())) as link:
        write = link.write
        monkeypatch.setattr(link, "write", lambda data, **options: begun.set() or write(data, **options))
        Player(link, queue_blocks=1000).play(blocks(), update_rate=10e3)
    assert seen == [False] * 8 + [True]


@pytest.mark.parametrize("setup", ["sonicsurface"], indirect=True)
def test_a_swap_read_out_of_noise_brings_nothing_back(setup: Setup) -> None:
    for _ in range(3):  # after the opening, and after a content
        assert setup.board.accept(memoryview(b"\xfd")) == 1
        setup.assert_off()
        setup.play(content(setup.model, 9))
