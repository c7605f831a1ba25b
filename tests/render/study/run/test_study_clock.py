"""Real and simulated time of a study's run: how waits end, and what happens meanwhile."""

import threading
import time

from virtual_clock import SkippingClock, VirtualClock

from palpate.render.study.run.desk import LOST_SECONDS, KeyChoice, StudyClock, StudyDesk


def test_real_time_is_that_of_clock_monotonic_and_waits_end_when_they_are_notified():
    clock, changed = StudyClock(), threading.Condition()
    assert time.monotonic() <= clock.now() <= time.monotonic()
    began = clock.now()
    clock.sleep(0.01)
    assert clock.now() - began >= 0.01
    threading.Timer(0.01, lambda: _notify(changed)).start()
    with changed:
        clock.wait(changed, 5.0)
    with changed:
        clock.wait(changed, 5.0, lambda: True)
        clock.wait(changed, 0.01, lambda: False)
    assert clock.now() - began < 4.0


def _notify(changed):
    with changed:
        changed.notify_all()


def test_virtual_waits_run_what_is_planned_in_its_order_and_end_where_real_ones_do():
    clock, changed, seen = VirtualClock(10.0), threading.Condition(), []
    for when in (12.0, 11.0, 11.5, 30.0):
        clock.call_at(when, lambda: seen.append(clock.now()))
    clock.wait(changed, 5.0, lambda: len(seen) == 2)
    assert (seen, clock.now()) == ([11.0, 11.5], 11.5)
    clock.wait(changed, 5.0)  # without a condition, one event ends it
    assert (seen[2:], clock.now()) == ([12.0], 12.0)
    clock.wait(changed, 5.0)
    assert (len(seen), clock.now()) == (3, 17.0)
    clock.sleep(20.0)
    assert (seen[3:], clock.now()) == ([30.0], 37.0)


def test_a_desk_takes_its_time_from_its_clock():
    clock = VirtualClock()
    desk = StudyDesk(clock)
    page, screen = desk.open_page(), desk.show("question", "Which?", keys=(KeyChoice(key="1", label="one", value=1),))
    clock.call_at(clock.now() + 1.0, lambda: desk.press(screen.number, "1", 1.0))
    assert desk.await_response(0.5) is None
    assert desk.await_response(10.0).value == 1
    assert clock.now() == 1001.0
    desk.await_change(LOST_SECONDS - 1.0 - 0.01)
    assert (desk.has_page, desk.is_open(page)) == (True, True)
    desk.await_change(0.02)
    assert not desk.has_page
    skipping = SkippingClock()
    desk.await_change(100.0, skipping)  # the run's own clock, whose time the desk does not share
    assert (skipping.skipped, clock.now()) == (100.0, 1001.0 + LOST_SECONDS - 1.0 + 0.01)
