"""Limits of on-time and duty: counted as the array plays, and the array is off beyond them."""

from __future__ import annotations

import threading
import time
from array import array
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from palpate.device import (
    EmulatorBackend,
    Limits,
    LimitsError,
    Player,
    SafetyLimitError,
    VirtualClock,
    array_model,
    open_link,
)
from palpate.device.codec import duty, is_emitting
from palpate.device.link import Link
from palpate.device.playing.limits import Guard

MODEL = array_model("emulator")
RATE = 10_000 / 63  # divider 252: little data for much time
PERIOD = round(1e9 / RATE)
LOUD = array("B", np.full(512, 255, np.uint8).tobytes())
HALF = array("B", np.tile(np.array([0, 128], np.uint8), 256).tobytes())
SILENT = array("B", bytes(512))


@pytest.fixture
def bus() -> EmulatorBackend:
    return EmulatorBackend(clock=VirtualClock())


@pytest.fixture
def link(bus: EmulatorBackend) -> Iterator[Link]:
    with open_link(MODEL, backend=bus) as link:
        yield link


def seconds(frame: array, duration: float) -> Iterator[array]:
    """A frame for a time, in blocks of half a second."""
    block = frame * round(RATE / 2)
    for _ in range(round(duration * 2)):
        yield block


def test_limits_survive_json() -> None:
    for limits in (Limits(), Limits(on_time_max=None, duty_max=None), Limits(on_time_max=5.0, duty_window=1.0)):
        assert Limits.from_json(limits.to_json()) == limits
    assert Limits.from_json("{}") == Limits()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "must be a JSON object"),
        ("{", "not JSON"),
        ('{"on_time": 3}', "unknown field 'on_time'; known: duty_max"),
        ('{"on_time_max": 0}', "on_time_max is 0"),
        ('{"on_time_max": NaN}', "on_time_max is nan"),
        ('{"pause_min": null}', "pause_min is None"),
        ('{"duty_max": 1.5}', "duty_max is 1.5"),
        ('{"duty_window": "long"}', "duty_window is 'long'"),
        ('{"duty_max": true}', "duty_max is True"),
        ('{"on_time_max": 1' + "0" * 400 + "}", "on_time_max is an integer of 1329 bits"),
        ('{"on_time_max": 1' + "0" * 5000 + "}", "not JSON that can be read"),
        ("[" * 100_000, "nested too deeply"),
        ('{"duty_window": 1e999}', "duty_window is inf"),
        ('{"pause_min": ' + "[" * 500 + "]" * 500 + "}", r"pause_min is \[+\.\.\."),
    ],
)
def test_limits_that_are_none_are_refused_by_name(text: str, message: str) -> None:
    with pytest.raises(LimitsError, match=message):
        Limits.from_json(text)


@settings(max_examples=20)
@example([(LOUD, 3), (SILENT, 4), (LOUD, 2)], 1)
@given(
    st.lists(st.tuples(st.sampled_from([SILENT, HALF, LOUD]), st.integers(1, 12)), min_size=1, max_size=25),
    st.integers(1, 7),
)
def test_on_time_and_duty_are_those_of_the_frames_one_by_one(runs: list[tuple[array, int]], chunk: int) -> None:
    period = 250_000_000  # so that 4 silent frames make a pause, and no chunk hides one
    wire = b"".join(frame.tobytes() * count for frame, count in runs)
    frames = np.frombuffer(wire, np.uint8).reshape(-1, 512)
    on = is_emitting(frames, array=MODEL)
    longest, since, last = 0, None, None
    for number in np.flatnonzero(on):
        if since is None or number - last - 1 >= 4:
            since = number
        last = number
        longest = max(longest, number + 1 - since)

    guard = Guard(Limits(on_time_max=None, duty_max=None, pause_min=1.0), MODEL)
    guard.start()
    start = 0
    for dose in guard.measure(array("B", wire), min(chunk, 3)):
        guard.admit(dose, start * period, period)
        start += dose.frames
    assert guard.on_time_ns == longest * period
    assert guard._driven_ns == pytest.approx(float(duty(frames, array=MODEL).sum()) * period)


def test_emission_without_a_pause_ends_at_the_limit_with_the_array_off(bus: EmulatorBackend, link: Link) -> None:
    player = Player(link)
    with pytest.raises(
        SafetyLimitError, match=r"array emulator was stopped at a limit.*120 s without a pause of 1 s"
    ) as end:
        player.play(seconds(LOUD, 200), update_rate=RATE)
    report = end.value.report
    assert report is player.report
    assert report is not None
    assert report.stopped_by == "limit"
    assert report.off_confirmed
    assert 119 < report.frames / RATE <= 120
    assert not bus.board().playing.any()


def test_pauses_reset_it_and_shorter_ones_do_not(link: Link) -> None:
    player = Player(link, limits=Limits(on_time_max=3.0))

    def bursts(pause: array) -> Iterator[array]:
        for _ in range(4):
            yield from seconds(LOUD, 2)
            yield pause

    report = player.play(bursts(SILENT * (int(RATE) + 2)), update_rate=RATE)
    assert 1.9 < report.on_time < 2.1
    with pytest.raises(SafetyLimitError):
        player.play(bursts(SILENT * (int(RATE) - 20)), update_rate=RATE)


def test_a_limit_can_be_lifted_on_purpose(link: Link) -> None:
    report = Player(link, limits=Limits(on_time_max=None)).play(seconds(LOUD, 130), update_rate=RATE)
    assert report.on_time == pytest.approx(130, rel=0.02)
    assert report.duty == pytest.approx(1.0)


def test_the_next_playback_without_a_pause_goes_on_counting(bus: EmulatorBackend, link: Link) -> None:
    player = Player(link, limits=Limits(on_time_max=3.0))
    player.play(seconds(LOUD, 2), update_rate=RATE)
    with pytest.raises(SafetyLimitError):
        player.play(seconds(LOUD, 2), update_rate=RATE)
    bus.clock.advance(1.5)
    player.play(seconds(LOUD, 2), update_rate=RATE)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (Limits(on_time_max=10.0), "10 s without a pause"),
        (Limits(on_time_max=None, duty_max=0.5, duty_window=20.0), r"mean duty above 0\.5 over 20 s"),
    ],
)
def test_a_frame_that_is_held_because_nothing_follows_counts(
    bus: EmulatorBackend, link: Link, limits: Limits, message: str
) -> None:
    player = Player(link, limits=limits)
    over = threading.Event()

    def blocks() -> Iterator[array]:
        yield LOUD * 200
        end = time.monotonic() + 20
        while (bus.board().playing.any() or not bus.board().frames_played) and time.monotonic() < end:
            bus.clock.advance(1.0)  # nothing comes: the last frame plays on
            time.sleep(0.03)
        over.set()
        yield LOUD

    with pytest.raises(SafetyLimitError, match=message):
        player.play(blocks(), update_rate=RATE)
    assert over.is_set()
    assert not bus.board().playing.any()


def test_mean_duty_over_the_window_is_limited_and_half_of_it_plays_twice_as_long(link: Link) -> None:
    limits = Limits(on_time_max=None, duty_max=0.5, duty_window=20.0)
    for frame, full in ((LOUD, 10.0), (HALF, 10.0 / float(duty(np.array(HALF, np.uint8)[None], array=MODEL)[0]))):
        player = Player(link, limits=limits)
        if full < 20:
            with pytest.raises(SafetyLimitError, match=r"mean duty above 0\.5 over 20 s"):
                player.play(seconds(frame, 60), update_rate=RATE)
            assert player.report is not None
            assert player.report.frames / RATE == pytest.approx(full, abs=0.2)
        else:
            player.play(seconds(frame, 60), update_rate=RATE)


def test_the_window_slides(link: Link) -> None:
    player = Player(link, limits=Limits(on_time_max=None, duty_max=0.5, duty_window=10.0))

    def blocks() -> Iterator[array]:
        for _ in range(10):
            yield from seconds(LOUD, 4)
            yield from seconds(SILENT, 6)

    assert player.play(blocks(), update_rate=RATE).duty == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize("window", [20.0, 1e300])
def test_silence_ends_the_hold_and_each_moment_of_it_counts_once(window: float) -> None:
    guard = Guard(Limits(on_time_max=None, duty_max=None, duty_window=window), MODEL)
    second = 1_000_000_000
    (loud,) = guard.measure(LOUD, 1)
    guard.admit(loud, 0, second)
    for now in (0, 2, 3, 3, 5):
        guard.hold(now * second)
    guard.admit(loud, 6 * second, second)
    assert guard._driven_ns == pytest.approx(7 * second)
    guard.silence(7 * second)
    guard.hold(100 * second)
    assert guard._driven_ns == pytest.approx(7 * second)


def test_a_held_frame_is_driven_at_its_duty_and_fills_no_more_than_the_window() -> None:
    second = 1_000_000_000
    guard = Guard(Limits(on_time_max=None, duty_max=0.6, duty_window=20.0), MODEL)
    (half,) = guard.measure(HALF, 1)
    (both,) = guard.measure(LOUD + HALF, 2)
    guard.admit(both, 0, second)
    guard.hold(10_000 * second)  # the host was asleep
    assert guard._driven_ns / (20 * second) == pytest.approx(half.duty_last)
    guard = Guard(Limits(on_time_max=None, duty_max=0.5, duty_window=20.0), MODEL)
    (loud,) = guard.measure(LOUD, 1)
    guard.admit(loud, 0, second)
    guard.admit(loud, 8 * second, second)  # 7 s of them held
    with pytest.raises(SafetyLimitError):
        guard.admit(loud, 10 * second, second)
