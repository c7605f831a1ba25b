"""Arrays held open for a live run: what is refused before a process is started, and what ends a run."""

import os
import resource
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from palpate.device.errors import DeviceError, SafetyLimitError
from palpate.device.playing.limits import Limits
from palpate.render import Connection
from palpate.render.errors import StrategyError
from palpate.render.live import held_arrays
from palpate.render.live.held_arrays import HeldArrays, Supervisor
from palpate.render.playback.placed_arrays import arrays_of

REFUSED = {
    "lead of microseconds": ({"lead": 1e-9}, r"lead must lie in 0\.002\.\.0\.1 s .*, not 1e-09"),
    "lead of few frames": ({"lead": 0.003, "update_rate": 1000.0}, r"lead must lie in 0\.004\.\.0\.1 s"),
    "rate": ({"update_rate": 20.0}, "update_rate of a live run must be 40 Hz or more, not 20"),
    "virtual clock": ({"connection": Connection(clock="virtual")}, "clock=virtual is not for live runs"),
    "watchdog of what is emulated": ({"connection": Connection(watchdog=True)}, "a watchdog is for real arrays"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_a_live_run_has_not_is_refused_before_anything_is_started(case, monkeypatch):
    monkeypatch.setattr(held_arrays, "WriterHandle", None)  # calling it would fail
    fields, sentence = REFUSED[case]
    fields = {"connection": Connection(), "update_rate": 10e3, "lead": 6e-3} | fields
    connection = fields.pop("connection")
    with pytest.raises(StrategyError, match=sentence):
        HeldArrays(arrays_of("emulator"), connection, **fields)


class Writer:
    """A writer's messages, given by a test."""

    def __init__(self, requests, **fields):
        self.ready = {"emission": "board", "realtime": True}
        self.update_rate = fields["update_rate"]
        self.told, self.closed = [], []
        self.pace = fields["pace"]

    def fileno(self):
        return self.end

    def messages(self):
        told, self.told = self.told, []
        return iter(told)

    def close(self):
        self.closed.append("close")

    def release(self):
        self.closed.append("release")


@contextmanager
def held(monkeypatch, **fields):
    monkeypatch.setattr(held_arrays, "WriterHandle", Writer)
    watching = SimpleNamespace(watch=lambda *_: None, settle=lambda: None, close=lambda: None, error=None)
    monkeypatch.setattr(held_arrays, "Supervisor", lambda: watching)
    Writer.end = 0
    yield HeldArrays(arrays_of("emulator"), Connection(), update_rate=10e3, **fields)


def hear(own, *messages):
    own.writer.told += [dict(message) for message in messages]
    return own._hear()


OFF = {"event": "off", "arrays": [{"off_confirmed": True}, {"off_confirmed": None}], "frames": 7, "late": 1}


def test_messages_become_counts_events_and_an_outcome(monkeypatch):
    heard, told = [], []
    with held(monkeypatch, heard=lambda *message: heard.append(message), told=told.append) as own:
        assert hear(own, {"event": "poses", "rows": [[0, 0, 5_000_000]]}, {"event": "skipped", "rows": [[3, 2, 2]]})
        assert hear(own, {"event": "warning", "text": "near"}, {"event": "warning", "text": "near"})
        own.require_running()
        assert hear(own, OFF)
        assert hear(own, {"event": "gone"}) is False
        assert told == ["near"]  # not the same sentence again and again
        assert (own.counts.statistics().poses, own.counts.statistics().frames) == (1, 7)
        assert own.outcome["off_confirmed"] is None  # one of the arrays cannot say
        assert [event for event, _ in heard] == ["poses", "skipped", "warning", "warning", "off"]
        assert own.error is None
        with pytest.raises(DeviceError, match="not held any more"):
            own.require_running()


@pytest.mark.parametrize(
    ("arrays", "confirmed"),
    [([True, True], True), ([True, None], None), ([None, False], False), ([True, False], False)],
)
def test_that_all_arrays_are_off_is_confirmed_only_where_each_says_so(monkeypatch, arrays, confirmed):
    with held(monkeypatch) as own:
        hear(own, {"event": "off", "arrays": [{"off_confirmed": each} for each in arrays]})
        assert own.outcome["off_confirmed"] is confirmed


def test_a_limit_is_the_error_that_a_playback_raises(monkeypatch):
    with held(monkeypatch, limits=Limits(on_time_max=0.1)) as own:
        hear(own, {"event": "failed", "kind": "SafetyLimitError", "text": "too long"}, OFF, {"event": "gone"})
        assert not own.is_running
        with pytest.raises(SafetyLimitError, match="too long"):
            own.require_running()


def test_a_writer_that_ends_without_a_word_may_leave_the_array_on(monkeypatch):
    with held(monkeypatch) as own:
        hear(own, {"event": "gone"})
        with pytest.raises(DeviceError, match="may be emitting, switch it off"):
            own.require_running()


def test_what_a_users_function_raises_ends_the_run(monkeypatch):
    def told(sentence):
        raise ZeroDivisionError(sentence)

    with held(monkeypatch, told=told) as own:
        assert hear(own, {"event": "warning", "text": "near"}, OFF)  # the rest is still heard
        assert own.outcome["frames"] == 7
        with pytest.raises(ZeroDivisionError, match="near"):
            own.require_running()


def test_closing_twice_is_closing_once(monkeypatch):
    ended = []
    with held(monkeypatch) as own:
        own.close(lambda: ended.append(1))
        own.close(lambda: ended.append(2))
        assert own.writer.closed == ["close", "release"]
        assert ended == [1]


@contextmanager
def supervised(count):
    """A supervisor, and so many pipes."""
    made, supervisor = [os.pipe() for _ in range(count)], Supervisor()
    try:
        yield supervisor, made
    finally:
        supervisor.close()
        for descriptor in sum(made, ()):
            os.close(descriptor)


def test_a_function_that_raises_is_not_called_again_and_the_others_go_on():
    with supervised(3) as (supervisor, ((a, to_a), (b, to_b), (c, to_c))):
        calls, heard = [], []

        def failing():
            calls.append("raises")
            raise ValueError("as a user's function may")

        supervisor.watch(a, failing)
        supervisor.watch(b, lambda: heard.append(os.read(b, 1)))
        supervisor.watch(c, lambda: calls.append("false") or False)
        for end in (to_a, to_b, to_c):
            os.write(end, b"xy")
        supervisor.settle()
        os.write(to_b, b"z")
        supervisor.settle()
        assert sorted(calls) == ["false", "raises"]
        assert heard == [b"x", b"y", b"z"]
        assert isinstance(supervisor.error, ValueError)


def test_what_is_forgotten_may_be_closed_at_once():
    """Its function is not under way any more, and a new descriptor of the same number is another one."""
    with supervised(1) as (supervisor, ((a, to_a),)):
        is_reading, goes_on = threading.Event(), threading.Event()

        def slow():
            is_reading.set()
            goes_on.wait(5)
            os.read(a, 1)

        supervisor.watch(a, slow)
        os.write(to_a, b"x")
        assert is_reading.wait(5)
        threading.Timer(0.02, goes_on.set).start()
        supervisor.forget(a)
        assert goes_on.is_set()  # it waited
        for _ in range(50):
            end, other = os.pipe()
            supervisor.watch(end, lambda end=end: os.read(end, 1))
            supervisor.forget(end)
            os.close(end)
            os.close(other)
        assert supervisor.error is None


def test_descriptors_above_those_of_select_are_watched():
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 1200:
        pytest.skip(f"this process may open {hard} files only")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1200), hard))
    try:
        with supervised(1) as (supervisor, ((a, to_a),)):
            high = os.dup2(a, 1100)
            heard = []
            supervisor.watch(high, lambda: heard.append(os.read(high, 1)))
            os.write(to_a, b"x")
            supervisor.settle()
            supervisor.forget(high)
            os.close(high)
            assert heard == [b"x"]
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
