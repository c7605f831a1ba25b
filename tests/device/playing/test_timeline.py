"""What the player believes of an array it cannot see: lateness, and clocks that differ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from palpate.device.playing.timeline import Timeline

PERIOD = 100_000  # 10 kHz [ns]


def submit(timeline: Timeline, now_ns: int, frames: int, queue_frames: int = 0) -> None:
    timeline.submit(now_ns, frames, queue_bytes=512 * queue_frames, queue_frames=queue_frames)


@example([(1, 8_000_000), (1, 8_000_000), (1, 0)])
@given(st.lists(st.tuples(st.integers(1, 50), st.integers(0, 8_000_000)), min_size=1, max_size=60))
def test_lateness_is_how_far_an_array_is_behind_the_timetable_of_its_start(
    chunks: list[tuple[int, int]],
) -> None:
    timeline = Timeline(PERIOD, 0)
    now = 0
    due, starved, late, underruns = 0, 0, [], 0
    for frames, pause in chunks:
        submit(timeline, now, frames)
        starved += max(now - due, 0)
        underruns += now > due
        late += [starved] * frames  # all of them, and those that come later, play so much later than they should
        due = max(now, due) + frames * PERIOD
        now += pause
    lateness = timeline.lateness()
    for value, fraction in ((lateness.p50, 0.5), (lateness.p99, 0.99), (lateness.p999, 0.999), (lateness.max, 1.0)):
        assert value == pytest.approx(np.percentile(late, fraction * 100, method="inverted_cdf") * 1e-9)
    assert timeline.underruns == underruns
    assert timeline.starved_ns == starved
    assert timeline.dry_ns == due


CHUNK, QUEUE = 50, 350  # frames of a submit, and under way at it: 40 ms in all
MINUTES_10 = 600 * 10_000 // CHUNK  # submits


def stream(timeline: Timeline, chunk_ns: float, submits: int = MINUTES_10) -> float:
    """Submit whenever the array has made room, that is every `chunk_ns`; returns the time of the last [ns]."""
    for _ in range(QUEUE // CHUNK):
        submit(timeline, 0, CHUNK, queue_frames=timeline.frames)
    for number in range(submits):
        submit(timeline, round(number * chunk_ns), CHUNK, queue_frames=QUEUE)
        timeline.waited(round(number * chunk_ns))
    return (submits - 1) * chunk_ns


@pytest.mark.exhaustive
def test_an_array_with_a_slower_crystal_is_not_believed_dry() -> None:
    timeline = Timeline(PERIOD, 34)
    stream(timeline, CHUNK * PERIOD * (1 + 100e-6))  # 60 ms in 10 minutes, more than is under way
    assert (timeline.underruns, timeline.starved_ns) == (0, 0)


@pytest.mark.exhaustive
def test_an_array_with_a_faster_crystal_is_not_believed_to_hold_more_than_fits_it() -> None:
    timeline = Timeline(PERIOD, 34)
    end_ns = stream(timeline, CHUNK * PERIOD * (1 - 100e-6))
    submit(timeline, round(end_ns + (34 + QUEUE + CHUNK) * PERIOD + 5e6), CHUNK)
    assert timeline.underruns == 1
    assert timeline.starved_ns == pytest.approx(5e6, rel=0.1)


def test_a_bus_that_is_too_slow_is_told_from_a_crystal() -> None:
    timeline = Timeline(PERIOD, 34)
    end_ns = stream(timeline, CHUNK * PERIOD / 0.99, submits=12_000)
    assert timeline.starved_ns == pytest.approx(0.01 * end_ns - (34 + QUEUE + CHUNK) * PERIOD, rel=0.1)


def test_a_first_frame_that_is_held_gives_what_follows_as_much_time() -> None:
    hold = 64 * PERIOD  # more than the 34 frames that fit
    timeline = Timeline(PERIOD, 34, hold_ns=hold)
    submit(timeline, 1000, 28)
    submit(timeline, 1000 + 20 * PERIOD, 1)
    assert timeline.dry_ns == 1000 + hold + 29 * PERIOD
    submit(timeline, timeline.dry_ns, 1)
    assert timeline.underruns == 0
    submit(timeline, timeline.dry_ns + PERIOD, 1)
    assert (timeline.underruns, timeline.starved_ns) == (1, PERIOD)


def test_queue_depth_counts_from_the_first_wait_on() -> None:
    timeline = Timeline(PERIOD, 34)
    for queue_frames in (0, 1, 2):
        submit(timeline, 0, 1, queue_frames)
    assert timeline.queue_depth() is None
    timeline.waited(0)
    for queue_frames in (3, 2, 4):
        submit(timeline, 0, 1, queue_frames)
    depth = timeline.queue_depth()
    assert depth is not None
    assert (depth.min, depth.mean) == (2 * 512, 3 * 512)


def test_an_underrun_is_stamped_when_submitted_and_when_taken() -> None:
    timeline = Timeline(PERIOD, 34)
    submit(timeline, 1000, 10)
    submit(timeline, 5_001_000, 10)
    timeline.taken(6_000_000, 10)
    assert [event.taken_ns for event in timeline.underrun_events()] == [None]
    timeline.taken(7_000_000, 11)
    timeline.taken(8_000_000, 20)
    (event,) = timeline.underrun_events()
    assert (event.frame, event.submitted_ns, event.taken_ns) == (10, 5_001_000, 7_000_000)
    assert event.duration == pytest.approx(4e-3)
