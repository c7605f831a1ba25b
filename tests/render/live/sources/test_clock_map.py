"""Times of a source on the host's clock: drift, jitter and loss are followed, jumps are reported, late frames left out.

The truth is the delay with which each frame was made to arrive: a stamp is the time at which it was seen plus the
shortest delay.
"""

import numpy as np
import pytest
from live_senders import arrivals, palm_frames, seen_at

from palpate.render.live.sources.clock_map import LATE_MOST, WINDOW, ClockMap

DELAY = 2e-3


def stamps_of(frames, **how):
    """(seconds that each stamp is after the earliest possible, arrival after the stamp) in order of arrival."""
    clock = ClockMap("own")
    found = []
    rest = {name: how[name] for name in ("drift",) if name in how}
    for arrival_ns, frame in arrivals(frames, np.random.default_rng(3), delay=DELAY, **how):
        mapped = clock.stamp(frame.time, arrival_ns)
        assert mapped.fault is None
        if mapped.stamp_ns is not None:
            error = mapped.stamp_ns * 1e-9 - seen_at(frame, frames[0].time, **rest) - DELAY
            found.append((error, (arrival_ns - mapped.stamp_ns) * 1e-9))
    return np.array(found), clock


@pytest.mark.parametrize("drift", [-1e-4, 0.0, 1e-4])
def test_stamps_follow_a_clock_that_drifts_through_jitter_and_loss(drift):
    found, _ = stamps_of(palm_frames(90.0, 20.0), jitter=3e-3, loss=0.1, drift=drift)
    error, waited = found[90:].T  # the first second shows the shortest delay
    assert error.min() > -max(drift, 0.0) * WINDOW - 1e-6
    assert np.abs(np.median(error)) < 4e-4
    assert error.max() < 1.5e-3
    assert waited.min() >= 0.0


def test_frames_out_of_order_are_left_out_and_counted():
    frames = palm_frames(90.0, 5.0)
    found, clock = stamps_of(frames, swaps=0.05)
    assert clock.late > 10
    assert len(found) + clock.late == len(frames)


@pytest.mark.parametrize(
    ("jump", "text"),
    [(-3600.0, r"jumped back by 3599\.9"), (3600.0, r"jumped ahead by 3600\.0"), (-0.5, r"jumped back by 0\.2")],
)
def test_a_jump_is_reported_and_the_clock_is_mapped_anew(jump, text):
    clock, faults, errors = ClockMap("own"), [], []
    for k in range(300):
        moved = jump if k >= 150 else 0.0
        mapped = clock.stamp(100.0 + k / 90 + moved, round((5.0 + k / 90) * 1e9))
        faults += [mapped.fault.text] if mapped.fault else []
        assert mapped.restarted == (mapped.fault is not None)
        if mapped.stamp_ns is not None:
            errors.append(mapped.stamp_ns * 1e-9 - (5.0 + k / 90))
    assert len(faults) == 1
    assert faults[0].startswith("the source's clock jumped")
    assert np.abs(errors).max() < 1e-6
    assert len(errors) >= 300 - LATE_MOST
    assert pytest.approx(0, abs=1) == len(errors) - 300 + (LATE_MOST if jump == -0.5 else 0)


def test_a_clock_that_stands_still_is_reported():
    clock, faults = ClockMap("own"), []
    for k in range(2 * LATE_MOST):
        mapped = clock.stamp(7.0, round((1.0 + k / 90) * 1e9))
        faults += [mapped.fault] if mapped.fault else []
    (fault,) = faults
    assert "stands still at 7.000000 s" in fault.text


@pytest.mark.parametrize("time", [float("nan"), float("inf"), -1e300])
def test_a_time_that_is_none_is_refused_and_changes_nothing(time):
    clock = ClockMap("own")
    clock.stamp(1.0, 10_000_000_000)
    mapped = clock.stamp(time, 10_500_000_000)
    assert mapped.stamp_ns is None
    assert mapped.fault.text.startswith("the time of a frame must be finite and within 1e+11 s, not ")
    assert clock.stamp(2.0, 11_000_000_000).fault is None


def test_times_of_this_hosts_clock_are_taken_as_they_are():
    clock = ClockMap("monotonic")
    assert clock.stamp(9.99, 10_000_000_000).stamp_ns == 9_990_000_000
    assert clock.stamp(10.5, 10_400_000_000).stamp_ns == 10_400_000_000  # never after its arrival


@pytest.mark.parametrize(("time", "text"), [(5000.0, "jumped ahead by 4900"), (12.0, "88.000 s behind this host's")])
def test_a_clock_that_cannot_be_this_hosts_is_mapped(time, text):
    clock = ClockMap("monotonic")
    mapped = clock.stamp(time, 100_000_000_000)
    assert text in mapped.fault.text
    assert "no longer taken as this host's" in mapped.fault.text
    assert mapped.stamp_ns == 100_000_000_000
    assert clock.stamp(time + 0.01, 100_011_000_000).stamp_ns == 100_010_000_000
