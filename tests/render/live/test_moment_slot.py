"""Moments between two processes: whole or not at all, only for those who ask, and cut only with a count."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from palpate.datasets.motions.hand_motion import PALM_DOWN
from palpate.render import ContourBatch, FocalPoints, render, static_pose
from palpate.render.live.drawn_log import LoggedPose
from palpate.render.live.moment_slot import (
    ASKED_NS,
    COPY_NS,
    DRAWING,
    FOCUS_MOST,
    LINES_MOST,
    POINTS_MOST,
    RESTING,
    MomentSlot,
    MomentTap,
)

POSE = LoggedPose(3, 7, 11, np.array([0, 0, 0.2, *PALM_DOWN], np.float32), None)
NO_FOCUS = FocalPoints(np.zeros((0, 3), np.float32), np.zeros(0, np.float32))


@pytest.fixture
def slot():
    own = MomentSlot()
    yield own
    own.close()


def contours(*sizes, value=0.0, **fields):
    """Polylines of so many points, whose numbers are all the same."""
    start = np.cumsum([0, *sizes]).astype(np.int64)
    return ContourBatch(
        points=np.full((start[-1], 3), value, np.float32),
        kind=np.zeros(start[-1], np.uint8),
        polyline_start=start,
        polyline_patch=np.zeros(len(sizes), np.int32),
        polyline_closed=np.ones(len(sizes), np.uint8),
        pose_start=np.array([0, len(sizes)], np.int64),
        **fields,
    )


def leave(slot, batch, pose=POSE, focus=NO_FOCUS, **fields):
    slot.copy(pose, batch, focus, **({"index": 0, "time": 0.0, "now_ns": 0} | fields))
    return slot.read()


def focal_points(samples, *foci, first=0):
    level = np.arange(first, first + samples, dtype=np.float32)
    shape = (samples, *foci)
    level = np.broadcast_to(level.reshape(-1, *[1] * len(foci)), shape).copy()
    return FocalPoints(np.repeat(level[..., None], 3, axis=-1), level)


@pytest.mark.parametrize("strategy", ["cc", "corner-pauses"])
@pytest.mark.parametrize("patch_pose", [None, np.arange(14, dtype=np.float32).reshape(2, 7)])
def test_a_moment_is_read_as_it_was_copied_bit_for_bit(slot, strategy, patch_pose):
    rendered = render("cube", "palm", static_pose([0, 0, 0.2]), strategy).numpy()
    batch = replace(ContourBatch.from_arrays(rendered.arrays()), raw_error=1e-4)
    focus = focal_points(5, 2)
    read = leave(slot, batch, POSE._replace(patch_pose=patch_pose), focus, index=4, time=2.5, now_ns=9)
    assert (read.number, read.index, read.time, read.copied_ns) == (1, 4, 2.5, 9)
    assert read.pose[:3] == POSE[:3]
    np.testing.assert_array_equal(read.pose.pose, POSE.pose)
    np.testing.assert_array_equal(read.pose.patch_pose, patch_pose)
    assert (read.points_left_out, read.contours.raw_error) == (0, 1e-4)
    given, found = batch.arrays(), read.contours.arrays()
    assert given.keys() == found.keys()
    for name, value in given.items():
        assert found[name].dtype == value.dtype, name
        np.testing.assert_array_equal(found[name], value)
    for value, copied in zip(focus, read.focus, strict=True):
        np.testing.assert_array_equal(copied, value)


@pytest.mark.parametrize(("patches", "number"), [(20_000, 1), (400_000, None)])
def test_a_hand_of_many_patches_has_room_and_one_without_room_stops_no_drawing(slot, patches, number):
    patch_pose = np.zeros((patches, 7), np.float32)
    read = leave(slot, contours(POINTS_MOST), POSE._replace(patch_pose=patch_pose))
    assert (read and read.number) == number


def test_the_newest_moment_of_this_run_is_read(slot):
    assert slot.read() is None
    for k in (1, 2, 3):
        assert leave(slot, contours(2, value=k)).contours.points[0, 0] == k
    slot.begin()
    assert slot.read() is None  # what was drawn before belongs to another run
    assert leave(slot, contours(1)).number == 4


def test_another_end_of_the_memory_reads_the_same_and_a_closed_one_reads_nothing(slot):
    other = MomentSlot(fd=slot.fd)
    leave(other, contours(2, value=5))
    other.note(DRAWING, is_lost=True, pose_due_ns=8)
    assert slot.read().contours.points[1, 2] == 5
    assert slot.noted() == (DRAWING, True, 8)
    slot.close()
    slot.close()
    assert slot.read() is None
    assert slot.noted()[0] == RESTING
    slot.ask(0)


@pytest.mark.parametrize(
    ("sizes", "lines"),
    [
        ((POINTS_MOST,), 1),
        ((POINTS_MOST + 1,), 0),
        ((5, POINTS_MOST - 4, 3), 1),
        ((1,) * (LINES_MOST + 2), LINES_MOST),
    ],
)
def test_polylines_without_room_are_left_out_and_their_points_counted(slot, sizes, lines):
    read = leave(slot, contours(*sizes, value=3, intensity=np.ones(sum(sizes), np.float32)))
    assert read.contours.polyline_count == lines
    assert read.contours.point_count == len(read.contours.intensity) == sum(sizes[:lines])
    assert read.points_left_out == sum(sizes[lines:])


class MemoryWrittenMeanwhile:
    """The memory of a slot, which another process overwrites while a reader copies it."""

    def __init__(self, slot):
        self.slot, self.memory, self.values = slot, slot._memory, [2, 3]  # the second overwrites what is being read

    def __getitem__(self, span):
        found = bytes(self.memory[span])
        while self.values:
            self.slot.copy(POSE, contours(3, value=self.values.pop(0)), NO_FOCUS, index=0, time=0.0, now_ns=0)
        return found

    def __setitem__(self, span, content):
        self.memory[span] = content

    def release(self):
        self.memory.release()


def test_a_slot_that_is_written_while_it_is_read_is_read_again(slot):
    leave(slot, contours(3, value=1))
    slot._memory = MemoryWrittenMeanwhile(slot)
    assert slot.read().number == 3
    assert not slot._memory.values


def require_whole(read, value):
    """All that was read is of one moment."""
    assert read.contours.point_count == 1 + value % 50 * 9
    assert (read.contours.points == value).all()
    assert (read.contours.kind == value % 256).all()
    assert (read.focus.intensity == value).all()
    assert (read.pose.pose == value).all()
    assert (read.time, read.index) == (value, value)


def hammer(slot, count):
    """Copy moments one after the other, each of other numbers and of another size."""
    for value in range(1, count + 1):
        batch = contours(1 + value % 50 * 9, value=value)
        batch.kind[:] = value % 256
        focus = FocalPoints(np.full((9, 3), value, np.float32), np.full(9, value, np.float32))
        pose = LoggedPose(value, value, value, np.full(7, value, np.float32), None)
        slot.copy(pose, batch, focus, index=value, time=float(value), now_ns=value)


def read_until(slot, count):
    """Read until the last of so many moments is there; how many different ones were seen."""
    seen = set()
    while max(seen, default=0) < count:
        if (read := slot.read()) is not None:
            require_whole(read, read.number)
            assert read.number >= max(seen, default=0)
            seen.add(read.number)
    return len(seen)


def test_moments_that_a_thread_copies_without_end_are_read_whole(slot):
    thread = threading.Thread(target=hammer, args=(slot, 300))
    thread.start()
    assert read_until(slot, 300) > 0
    thread.join()


def due(tap, now_ns, state=DRAWING):
    return tap.is_due(state, is_lost=False, pose_due_ns=0, now_ns=now_ns)


def test_moments_are_copied_only_while_one_asks_at_most_forty_times_a_second(slot):
    tap, copied, began = MomentTap(slot, 10e3), [], 10 * ASKED_NS
    tap.begin()
    for now_ns in range(began, began + ASKED_NS, 1_000_000):
        assert not due(tap, now_ns)
        tap.add_points(focal_points(10))
    slot.ask(began)
    for now_ns in range(began, began + 2 * ASKED_NS, 1_000_000):
        if due(tap, now_ns):
            tap.copy(POSE, contours(2), index=0, time=0.0, now_ns=now_ns)
            copied.append(now_ns)
        tap.add_points(focal_points(10))
    assert len(copied) == ASKED_NS // COPY_NS  # half a second of them, then nobody asks any more
    assert min(np.diff(copied)) >= COPY_NS - 1_000_000  # the renderer comes by once a millisecond
    slot.ask(began + 2 * ASKED_NS)
    assert not due(tap, began + 2 * ASKED_NS, RESTING)


@pytest.mark.parametrize(("rate", "foci"), [(10e3, ()), (40e3, ()), (40e3, (3,))])
def test_the_newest_focal_points_are_evenly_thinned_to_what_there_is_room_for(slot, rate, foci):
    tap = MomentTap(slot, rate)
    slot.ask(0)
    assert due(tap, 0)
    for k in range(400):
        tap.add_points(focal_points(10, *foci, first=10 * k))
    tap.copy(POSE, contours(2), index=0, time=0.0, now_ns=0)
    focus = slot.read().focus
    samples = focus.intensity.reshape(len(focus.intensity), -1)[:, 0]
    assert focus.intensity.shape[1:] == foci
    assert focus.intensity.size <= FOCUS_MOST
    assert samples[-1] == 3999
    assert len(set(np.diff(samples))) == 1
    assert samples[0] >= 4000 - rate / 30
    np.testing.assert_array_equal(focus.position[..., 1], focus.intensity)
    tap.copy(POSE, contours(2), index=0, time=0.0, now_ns=0)
    np.testing.assert_array_equal(slot.read().focus.intensity, focus.intensity)  # of the last 1/30 s, copied or not
    tap.add_points(focal_points(10, *foci, first=4000))
    tap.copy(POSE, contours(2), index=0, time=0.0, now_ns=0)
    assert slot.read().focus.intensity.flat[-1] == 4009
    assert slot.read().focus.intensity.size <= FOCUS_MOST
