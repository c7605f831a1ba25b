"""Numbers of a live run against NumPy by hand."""

import numpy as np
import pytest

from palpate.render.live.counts import LiveCounts

MS = 1_000_000  # [ns]


def test_latency_and_age_are_those_of_the_times():
    rng = np.random.default_rng(0)
    stamp = np.cumsum(rng.integers(5, 15, 500)) * MS
    began = stamp + rng.integers(3, 9, 500) * MS
    counts = LiveCounts(period=1e-4, emission="board")
    rows = [[k, int(stamp[k]), int(began[k])] for k in range(500)]
    counts.add_poses(rows[:123])
    counts.add_poses(rows[123:])
    found = counts.statistics()
    latency, age = (began - stamp) * 1e-9, (began[1:] - stamp[:-1]) * 1e-9
    for times, seconds in ((found.latency, latency), (found.latency_recent, latency[-200:]), (found.age, age)):
        expected = (np.quantile(seconds, 0.5), np.quantile(seconds, 0.99), seconds.max())
        assert (times.p50, times.p99, times.longest) == pytest.approx(expected)
    assert found.poses == 500
    assert found.seconds == pytest.approx((began[-1] - began[0]) * 1e-9)


def test_the_pause_between_two_runs_is_no_age():
    counts = LiveCounts(period=1e-4, emission="board")
    counts.add_poses([[0, 0, 5 * MS]])
    counts.begin()
    counts.add_poses([[1, 90_000 * MS, 90_005 * MS], [2, 90_010 * MS, 90_015 * MS]])
    assert counts.statistics().age.longest == pytest.approx(0.015)


@pytest.mark.parametrize(
    ("rows", "seconds"),
    [
        ([[0, 1, 2]], 1),
        ([[9_999, 1, 2]], 1),
        ([[9_990, 10, 2]], 1),  # the last one of them is the last of its second
        ([[9_990, 11, 2]], 2),
        ([[100, 10, 2], [200, 10, 3]], 1),
        ([[0, 40_000, 3]], 4),
    ],
)
def test_seconds_with_a_dropped_frame_are_those_in_which_one_was_due(rows, seconds):
    counts = LiveCounts(period=1e-4, emission="board")
    counts.add_skipped(rows)
    assert counts.statistics().dropped_seconds == seconds


def test_counts_are_those_that_came_last_and_faults_are_counted():
    counts = LiveCounts(period=1e-4, emission="board")
    counts.set_counts({"frames": 10, "late": 1, "faded": 2})
    counts.set_counts({"frames": 30, "late": 4})
    counts.set_counts({"superseded": 5, "refused": 6, "skipped": 7})
    for text in ("a", "b", "a", *map(str, range(200))):
        counts.add_fault(text)
    found = counts.statistics()
    assert (found.frames, found.dropped, found.superseded, found.refused, found.skipped) == (30, 6, 5, 6, 7)
    assert found.faults["a"] == 2
    assert len(found.faults) == 100  # no source fills the memory with sentences
    assert found.as_dict()["latency"].keys() == {"p50", "p99", "longest"}
    assert len(repr(found)) < 200


def test_of_many_poses_the_last_ones_count(monkeypatch):
    monkeypatch.setattr(LiveCounts, "MOST", 10)
    counts = LiveCounts(period=1e-4, emission="board")
    counts.add_poses([[k, 0, k * MS] for k in range(25)])
    assert counts.statistics().latency.longest == pytest.approx(0.024)
    assert 10 <= counts.statistics().poses <= 20


def test_a_fault_that_is_reported_again_counts_as_often_as_it_came():
    counts = LiveCounts(period=1e-4, emission="board")
    counts.add_fault("the palm is too far")
    counts.add_fault("the palm is too far (1,861 times since it was reported last)")
    assert counts.statistics().faults == {"the palm is too far": 1862}
