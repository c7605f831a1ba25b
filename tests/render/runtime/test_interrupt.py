"""Ctrl-C while rendering: never swallowed, never in the middle of a chunk."""

import os
import signal
import threading

import pytest

from palpate.render.runtime.interrupt import interrupt_between


class Dropped:
    """Something whose destructor is where the signal comes."""

    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)


def test_a_signal_in_a_destructor_is_raised_between_chunks():
    with interrupt_between() as raise_if_interrupted:
        raise_if_interrupted()
        Dropped()  # is dropped at once
        with pytest.raises(KeyboardInterrupt):
            raise_if_interrupted()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_signal_is_raised_at_once():
    with interrupt_between():
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_an_applications_own_handler_is_left_alone():
    seen = []
    before = signal.signal(signal.SIGINT, lambda signum, frame: seen.append(signum))
    try:
        with interrupt_between() as raise_if_interrupted:
            os.kill(os.getpid(), signal.SIGINT)
            raise_if_interrupted()
    finally:
        signal.signal(signal.SIGINT, before)
    assert seen == [signal.SIGINT]


def test_off_the_main_thread_nothing_changes():
    handlers = []

    def inside():
        with interrupt_between() as raise_if_interrupted:
            handlers.append(signal.getsignal(signal.SIGINT))
            raise_if_interrupted()

    thread = threading.Thread(target=inside)
    thread.start()
    thread.join()
    assert handlers == [signal.default_int_handler]
