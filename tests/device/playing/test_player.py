"""Playback on the emulated board: what is played, what is reported, and off on every way out."""

from __future__ import annotations

import dataclasses
import json
import sys
import threading
import time
from array import array
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from injected_faults import Fault, FaultKind, inject

from palpate.device import (
    DeviceBusyError,
    DeviceError,
    DeviceTimeoutError,
    EmulatorBackend,
    FrameError,
    LiveStatistics,
    Player,
    UpdateRateError,
    UsbLink,
    VirtualClock,
    array_model,
    open_link,
)
from palpate.device.playing.limits import Guard

FRAME = 512
MODEL = array_model("emulator")
RATE = 10e3


def content(count: int, *, seed: int = 0) -> np.ndarray:
    """Frames that all differ and are never off."""
    wire = np.random.default_rng(seed).integers(1, 256, (count, FRAME), np.uint8)
    wire[:, 0] = np.arange(count) % 251
    return wire


def in_blocks(wire: np.ndarray, size: int) -> Iterator[array]:
    for start in range(0, len(wire), size):
        yield array("B", wire[start : start + size].tobytes())


def wait_for(condition) -> None:
    """Until another thread is there; the bound only keeps a broken test from hanging."""
    end = time.monotonic() + 20
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the other thread did not come to it")
        time.sleep(0.001)


@pytest.fixture
def bus() -> EmulatorBackend:
    return EmulatorBackend(clock=VirtualClock(), record=1_000_000)


@pytest.fixture
def link(bus: EmulatorBackend) -> Iterator[UsbLink]:
    with open_link(MODEL, backend=bus) as link:
        yield link


@pytest.fixture(autouse=True)
def no_thread_left() -> Iterator[None]:
    before = threading.active_count()
    yield
    assert threading.active_count() == before


def assert_off(bus: EmulatorBackend) -> None:
    """Nothing emits now, nor in a second."""
    assert not bus.board().playing.any()
    bus.clock.advance(1)
    assert not bus.board().playing.any()


def assert_plays_again(bus: EmulatorBackend, link: UsbLink) -> None:
    wire = content(50, seed=9)
    before = len(bus.board().played)
    assert Player(link).play(in_blocks(wire, 7), update_rate=RATE).frames == 50
    assert np.array_equal(bus.board().played[before:-1], wire)
    assert_off(bus)


@pytest.mark.exhaustive
@given(
    st.integers(0, 6000),
    st.integers(1, 700),
    st.integers(1, 12),
    st.sampled_from([1, 2, 4, 37, 255]),
    st.integers(0, 9),
)
def test_content_played_is_content_sent_then_off(count: int, size: int, queue: int, divider: int, seed: int) -> None:
    bus = EmulatorBackend(clock=VirtualClock(), record=10_000)
    wire = content(count, seed=seed)
    with open_link(MODEL, backend=bus) as link:
        report = Player(link, queue_blocks=queue).play(in_blocks(wire, size), update_rate=40e3 / divider)
    played = bus.board().played
    assert np.array_equal(played[:-1], wire)
    assert not played[-1].any()
    assert report.stopped_by == "end"
    assert (report.frames, report.bytes, report.frames_cleared) == (count, count * FRAME, 0)
    assert report.duration == pytest.approx(count * divider / 40e3)
    assert (report.underruns, report.board_underruns, report.board_starved) == (0, 0, 0)
    assert report.off_confirmed


def test_the_report_names_array_clock_and_rate_and_is_json(link: UsbLink) -> None:
    report = Player(link).play(in_blocks(content(3000), 100), update_rate=RATE)
    assert (report.array, report.serial, report.clock, report.update_rate) == ("emulator", "EMU0001", "virtual", RATE)
    # the off frame plays a period after the last frame began
    assert report.duration <= report.elapsed <= report.duration + 2 / RATE
    again = json.loads(json.dumps(report.as_dict()))
    assert set(again) == {field.name for field in dataclasses.fields(report)} | {"may_emit", "off_doubt"}
    assert (again["may_emit"], again["off_doubt"]) == (False, None)


def test_blocks_may_be_any_bytes(bus: EmulatorBackend, link: UsbLink) -> None:
    wire = content(4)
    blocks = [wire[0].tobytes(), bytearray(wire[1].tobytes()), memoryview(wire[2].tobytes()), wire[3:4], b""]
    Player(link).play(blocks, update_rate=RATE)
    assert np.array_equal(bus.board().played[:-1], wire)


@pytest.mark.parametrize(
    "block", [bytes(511), bytes(513), np.zeros(128, np.float32), np.zeros((2, 1024), np.uint8)[:, ::2], "x" * 512, None]
)
def test_a_block_that_is_no_whole_number_of_frames_is_refused(bus: EmulatorBackend, link: UsbLink, block) -> None:
    player = Player(link)
    with pytest.raises(FrameError, match="a block"):
        player.play([content(3).tobytes(), block], update_rate=RATE)
    assert player.report is not None
    assert player.report.stopped_by == "exception"
    assert_off(bus)
    assert_plays_again(bus, link)


def test_a_rate_that_is_not_the_carriers_is_refused_before_anything_is_sent(
    bus: EmulatorBackend, link: UsbLink
) -> None:
    with pytest.raises(UpdateRateError):
        Player(link).play([bytes(FRAME)], update_rate=7e3)
    assert bus.board().bytes_received == 0


def test_playing_begins_when_the_queue_is_full(bus: EmulatorBackend, link: UsbLink) -> None:
    seen = []

    def blocks() -> Iterator[bytes]:
        for _ in range(6):
            seen.append(bus.board().bytes_received)
            yield content(1).tobytes()

    Player(link, queue_blocks=5).play(blocks(), update_rate=RATE)
    assert seen == [0] * 6  # 5 fill the queue, the 6th is made before the first is sent


def test_late_blocks_are_counted_by_the_player_and_by_the_board(bus: EmulatorBackend, link: UsbLink) -> None:
    def blocks() -> Iterator[bytes]:
        yield content(10).tobytes()  # fills the queue of one
        yield content(20).tobytes()  # made before playing starts
        for sent in (30, 60, 90):
            wait_for(lambda sent=sent: bus.board().bytes_received >= sent * FRAME)
            bus.clock.advance(0.1)
            if sent < 90:
                yield content(30).tobytes()

    report = Player(link, queue_blocks=1).play(blocks(), update_rate=RATE)
    assert report.frames == 90
    assert report.underruns == report.board_underruns == 3
    assert [event.frame for event in report.underrun_events] == [30, 60, 90]  # the last is the off frame
    assert [event.time for event in report.underrun_events] == pytest.approx([0.1, 0.2, 0.3])
    # each pause begins with 30 frames queued
    assert [event.duration for event in report.underrun_events] == pytest.approx([0.1 - 30 / RATE] * 3)
    assert report.starved == pytest.approx(3 * (0.1 - 30 / RATE))
    assert report.board_starved == pytest.approx(report.starved, abs=3 / RATE)
    assert_off(bus)


class Broken(Exception):
    """What a maker of blocks may raise."""


@pytest.mark.parametrize(("after", "error"), [(0, Broken), (1, Broken), (40, Broken), (30, KeyboardInterrupt)])
def test_what_the_blocks_raise_passes_through_and_the_array_is_off(
    bus: EmulatorBackend, link: UsbLink, after: int, error: type[BaseException]
) -> None:
    def blocks() -> Iterator[bytes]:
        yield from in_blocks(content(100 * after), 100)
        raise error

    player = Player(link)
    with pytest.raises(error):
        player.play(blocks(), update_rate=RATE)
    assert player.report is not None
    assert (player.report.stopped_by, player.report.off_confirmed) == ("exception", True)
    assert_off(bus)
    assert_plays_again(bus, link)


def test_stop_clears_what_is_queued_and_play_returns(bus: EmulatorBackend, link: UsbLink) -> None:
    player = Player(link)

    def endless() -> Iterator[bytes]:
        wire = content(100)
        while True:
            if bus.board().bytes_received > 3000 * FRAME:
                player.stop()
            yield wire.tobytes()

    report = player.play(endless(), update_rate=RATE)
    assert report.stopped_by == "stop"
    assert report.off_confirmed
    assert report.frames_cleared is not None
    assert report.frames_cleared > 0
    played = bus.board().played
    assert len(played) == report.frames - report.frames_cleared + 1
    assert np.array_equal(played[:-1], np.resize(content(100), (len(played) - 1, FRAME)))
    assert report.duration == pytest.approx((len(played) - 1) / RATE)
    assert_off(bus)
    assert_plays_again(bus, link)


def test_stop_does_not_wait_for_the_end_of_a_long_block(bus: EmulatorBackend, link: UsbLink) -> None:
    player = Player(link)
    original = bus.bulk_write

    def stop_soon(*args: object) -> int:
        if bus.board().bytes_received > 3000 * FRAME:
            player.stop()
        return original(*args)

    bus.bulk_write = stop_soon
    assert player.play([content(20_000).tobytes()], update_rate=RATE).frames < 4000
    assert_off(bus)


def test_an_array_that_does_not_say_it_is_off_is_an_error(
    bus: EmulatorBackend, link: UsbLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.device.playing.writer.wait_silent", lambda link, period_ns: False)
    player = Player(link)

    def blocks() -> Iterator[bytes]:
        yield content(10).tobytes()
        player.stop()

    with pytest.raises(DeviceTimeoutError, match="may still be emitting") as error:
        player.play(blocks(), update_rate=RATE)
    assert error.value.report is not None
    assert not error.value.report.off_confirmed


def test_stop_while_the_queued_frames_play_out_is_prompt() -> None:
    def progress(frames: int) -> None:
        if frames == 2000:
            player.stop()

    bus = EmulatorBackend(record=10_000)  # real time: 2000 frames would play for 12.75 s
    with open_link(MODEL, backend=bus) as real:
        player = Player(real)
        report = player.play(in_blocks(content(2000), 100), update_rate=40e3 / 255, progress=progress)
    assert report.stopped_by == "stop"
    assert (report.frames, report.board_underruns) == (2000, 0)
    assert report.frames_cleared == 2000 - (len(bus.board().played) - 1)
    assert report.frames_cleared > 1000
    assert not bus.board().playing.any()


def test_a_torn_frame_is_completed_before_the_off_frame(bus: EmulatorBackend, link: UsbLink) -> None:
    player = Player(link)
    wire = content(3000)
    torn_at = 2600 * FRAME + 77
    inject(bus, Fault(FaultKind.TIMEOUT, byte=torn_at))
    writes = link.short_writes

    def blocks() -> Iterator[array]:
        yield from in_blocks(wire, 100)
        wait_for(lambda: bus.board().bytes_received >= torn_at)

    original = bus.bulk_write

    def stop_when_short(*args: object) -> int:
        count = original(*args)
        if bus.board().bytes_received == torn_at:
            player.stop()
        return count

    bus.bulk_write = stop_when_short
    report = player.play(blocks(), update_rate=RATE)
    assert report.stopped_by == "stop"
    assert link.short_writes == writes + 1
    assert report.short_writes == 1
    assert report.bytes == torn_at
    assert report.frames == 2600
    played = bus.board().played
    torn = played[-2]
    assert np.array_equal(torn[:77], wire[2600, :77])
    assert not torn[77:].any()
    assert not played[-1].any()
    assert link.status().torn_bytes == 0
    assert_plays_again(bus, link)


@pytest.mark.parametrize("request_number", [2, 3])
@pytest.mark.parametrize("kind", [FaultKind.STALL, FaultKind.TIMEOUT])
def test_a_stop_whose_request_fails_still_ends_off(
    bus: EmulatorBackend, link: UsbLink, request_number: int, kind: FaultKind
) -> None:
    player = Player(link)

    def blocks() -> Iterator[bytes]:
        yield from in_blocks(content(2500), 100)
        inject(bus, Fault(kind, request=request_number))
        player.stop()
        yield bytes(FRAME)

    with pytest.raises(DeviceError):
        player.play(blocks(), update_rate=RATE)
    assert player.report is not None
    assert player.report.off_confirmed
    if request_number == 3:  # what could not be cleared was played
        assert player.report.frames_cleared == 0
        assert len(bus.board().played) == player.report.frames + 1
    assert_off(bus)
    assert_plays_again(bus, link)


def test_a_player_plays_one_thing_at_a_time(link: UsbLink) -> None:
    player = Player(link)

    def blocks() -> Iterator[bytes]:
        with pytest.raises(DeviceBusyError, match="playing already"):
            player.play([bytes(FRAME)], update_rate=RATE)
        yield bytes(FRAME)

    assert player.play(blocks(), update_rate=RATE).frames == 1


def test_a_stop_while_the_link_is_started_counts_and_one_before_does_not(
    bus: EmulatorBackend, link: UsbLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    player = Player(link)
    start = link.start

    def stopped_start(divider: int) -> None:
        start(divider)
        player.stop("bored")

    monkeypatch.setattr(link, "start", stopped_start)
    report = player.play(in_blocks(content(500), 100), update_rate=RATE)
    assert (report.stopped_by, report.frames, report.off_confirmed) == ("bored", 0, True)
    assert_off(bus)
    monkeypatch.undo()
    player.stop()  # nothing is played
    assert_plays_again(bus, link)
    assert player.play(in_blocks(content(5), 5), update_rate=RATE).stopped_by == "end"


def test_a_block_that_comes_again_is_neither_copied_nor_looked_at_again(
    bus: EmulatorBackend, link: UsbLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[int] = []
    written: list[array] = []
    measure, write = Guard.measure, link.write
    monkeypatch.setattr(
        Guard, "measure", lambda self, data, size: measured.append(id(data)) or measure(self, data, size)
    )
    monkeypatch.setattr(link, "write", lambda data, **rest: written.append(data) or write(data, **rest))
    small, large = array("B", content(100).tobytes()), array("B", content(300, seed=1).tobytes())
    Player(link).play([small, large] * 20, update_rate=RATE)
    assert measured == [id(small), id(large)]
    assert sum(data is small for data in written) == 20
    assert len({id(data) for data in written}) == 1 + 3 + 1  # the large one in two transfers of 20 ms, and off
    expected = np.frombuffer((small + large) * 20, np.uint8).reshape(-1, FRAME)
    assert np.array_equal(bus.board().played[:-1], expected)


def test_progress_and_watch_are_called_on_the_calling_thread_and_watch_ten_times_a_second_at_most(
    link: UsbLink,
) -> None:
    seen: list[LiveStatistics] = []
    taken: list[int] = []
    threads: set[int] = set()

    def watch(live: LiveStatistics) -> None:
        seen.append(live)
        threads.add(threading.get_ident())

    def progress(frames: int) -> None:
        taken.append(frames)
        threads.add(threading.get_ident())

    began = time.monotonic()
    report = Player(link).play(in_blocks(content(5000), 10), update_rate=RATE, watch=watch, progress=progress)
    assert len(seen) <= 2 + (time.monotonic() - began) * 10
    assert threads == {threading.get_ident()}
    assert seen[-1].frames == taken[-1] == report.frames == 5000
    assert (seen[-1].underruns, seen[-1].starved) == (report.underruns, report.starved)
    assert [live.frames for live in seen] == sorted(live.frames for live in seen)
    assert taken == sorted(taken)


def test_threads_take_turns_faster_while_playing_only() -> None:
    before = sys.getswitchinterval()
    seen: list[float] = []

    def blocks() -> Iterator[bytes]:
        seen.append(sys.getswitchinterval())
        yield bytes(FRAME)
        raise Broken

    with open_link(MODEL, backend=EmulatorBackend(clock=VirtualClock())) as link, pytest.raises(Broken):
        Player(link).play(blocks(), update_rate=RATE)
    assert seen[0] < before == sys.getswitchinterval()


def test_whatever_ends_the_writing_thread_the_array_is_off_and_the_caller_learns_of_it(
    bus: EmulatorBackend, link: UsbLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = link.write

    def fails_once(data: array, **rest: object) -> None:
        if bus.board().bytes_received > 1000 * FRAME:
            monkeypatch.undo()
            raise MemoryError
        write(data, **rest)

    monkeypatch.setattr(link, "write", fails_once)
    player = Player(link)
    with pytest.raises(MemoryError):
        player.play(in_blocks(content(3000), 100), update_rate=RATE)
    assert player.report is not None
    assert (player.report.stopped_by, player.report.off_confirmed) == ("device", True)
    assert_off(bus)
    assert_plays_again(bus, link)


def test_an_exception_in_progress_passes_through_and_the_array_is_off(bus: EmulatorBackend, link: UsbLink) -> None:
    def progress(frames: int) -> None:
        if frames:
            raise Broken

    with pytest.raises(Broken):
        Player(link).play(in_blocks(content(3000), 100), update_rate=RATE, progress=progress)
    assert_off(bus)
