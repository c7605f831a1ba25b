"""Records of what was drawn, through a pipe: any parts of it give the same records, and a slow reader loses none."""

import os
from contextlib import contextmanager

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from palpate.render.live import drawn_log
from palpate.render.live.drawn_log import DrawnLog, LoggedPoints, LoggedPose, LogReader


@contextmanager
def pipe():
    end, other = os.pipe()
    os.set_blocking(end, False)
    try:
        yield end, DrawnLog(other)
    finally:
        os.close(end)
        os.close(other)


def records():
    """Poses of a palm and of planes, points of one focus and two, with a gain and without."""
    rng = np.random.default_rng(0)
    made = []
    for number, (foci, patches, has_gain) in enumerate([(1, 0, False), (2, 3, True), (1, 1, True)]):
        pose = rng.normal(size=7).astype(np.float32)
        patch_pose = rng.normal(size=(patches, 7)).astype(np.float32) if patches else None
        made.append(LoggedPose(40 * number, number, 10**15 + number, pose, patch_pose))
        shape = (5, foci, 3) if foci > 1 else (5, 3)
        position = rng.normal(size=shape).astype(np.float32)
        gain = rng.uniform(size=5).astype(np.float32) if has_gain else None
        made.append(LoggedPoints(40 * number, position, rng.uniform(size=shape[:-1]).astype(np.float32), gain))
    return made


def require_same(found, given_records):
    assert [type(one) for one in found] == [type(one) for one in given_records]
    for one, other in zip(found, given_records, strict=True):
        for value, expected in zip(one, other, strict=True):
            if expected is None or isinstance(expected, int):
                assert value == expected
            else:
                np.testing.assert_array_equal(value, expected)


def log_all(log, made):
    for record in made:
        log.add(record)


@given(st.lists(st.integers(1, 200), max_size=20))
def test_any_parts_of_the_bytes_give_the_same_records(sizes):
    with pipe() as (end, log):
        log_all(log, records())
        data = os.read(end, 1 << 16)
    reader, found = LogReader(), []
    for size in [*sizes, len(data)]:
        part, data = data[:size], data[size:]
        found += reader.feed(part)
    require_same(found, records())


def test_what_a_reader_is_too_slow_for_is_counted(monkeypatch):
    monkeypatch.setattr(drawn_log, "BACKLOG_MOST", 1000)
    made = records() * 700
    with pipe() as (end, log):
        log_all(log, made)
        reader, found = LogReader(), []
        for _ in range(10):
            log.flush()
            try:
                found += reader.feed(os.read(end, 1 << 20))
            except BlockingIOError:
                break
        assert log.lost == len(made) - len(found) > 0
    require_same(found, made[: len(found)])  # whole records, in order


def test_at_the_end_what_nobody_reads_is_counted_in_a_bounded_time():
    made = records() * 700
    end, other = os.pipe()
    log = DrawnLog(other)
    log_all(log, made)
    log.drain(0.01)
    unread = log.lost
    assert 0 < unread < len(made)
    os.close(end)
    log.drain(60.0)  # nobody will ever read: it does not wait
    assert log.lost > unread
    log.add(made[0])
    os.close(other)
