"""The thread that hears processes: a function that raises is not called again, and the others are."""

import os
import threading
import time
from contextlib import contextmanager

import pytest

from palpate.render.live.supervisor import Supervisor


@contextmanager
def pipes(count):
    made = [os.pipe() for _ in range(count)]
    try:
        yield made
    finally:
        for pair in made:
            for descriptor in pair:
                os.close(descriptor)


def test_all_that_can_be_read_is_heard_when_it_has_settled():
    with pipes(2) as ((a, to_a), (b, to_b)), Supervisor() as supervisor:
        heard = []
        supervisor.watch(a, lambda: heard.append(os.read(a, 1)))
        supervisor.watch(b, lambda: heard.append(os.read(b, 9)))
        os.write(to_a, b"xyz")
        os.write(to_b, b"two")
        supervisor.settle()
        assert sorted(heard) == [b"two", b"x", b"y", b"z"]


def test_settling_is_bounded():
    with pipes(1) as ((a, to_a),), Supervisor() as supervisor:
        supervisor.watch(a, lambda: time.sleep(0.001))  # reads nothing
        os.write(to_a, b"x")
        began = time.monotonic()
        supervisor.settle(0.05)
        assert 0.05 <= time.monotonic() - began < 1.0


def test_a_function_that_raises_is_not_called_again_and_the_others_go_on():
    with pipes(2) as ((a, to_a), (b, to_b)), Supervisor() as supervisor:
        calls, heard = [], []

        def failing():
            calls.append(1)
            raise ValueError("as a user's function may")

        supervisor.watch(a, failing)
        supervisor.watch(b, lambda: heard.append(os.read(b, 1)))
        os.write(to_a, b"xx")
        os.write(to_b, b"y")
        supervisor.settle()
        os.write(to_b, b"z")
        supervisor.settle()
        assert (len(calls), heard) == (1, [b"y", b"z"])
        assert isinstance(supervisor.error, ValueError)


def test_a_function_that_returns_false_is_not_called_again():
    with pipes(1) as ((a, to_a),), Supervisor() as supervisor:
        calls = []
        supervisor.watch(a, lambda: calls.append(1) or False)
        os.write(to_a, b"x")
        time.sleep(0.02)
        supervisor.settle()
        assert calls == [1]


def test_what_is_forgotten_may_be_closed_at_once():
    """Its function is not under way any more, and a new descriptor of the same number is another one."""
    with pipes(1) as ((a, to_a),), Supervisor() as supervisor:
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
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard < 1200:
        pytest.skip(f"this process may open {hard} files only")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 1200), hard))
    try:
        with pipes(1) as ((a, to_a),), Supervisor() as supervisor:
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


def test_a_function_may_end_what_calls_it():
    with pipes(1) as ((a, to_a),):
        supervisor, ended = Supervisor().__enter__(), threading.Event()

        def ending():
            supervisor.__exit__()
            ended.set()

        supervisor.watch(a, ending)
        os.write(to_a, b"x")
        assert ended.wait(5)
        assert supervisor.error is None
