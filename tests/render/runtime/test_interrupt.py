"""Ctrl-C while rendering: never swallowed, never in the middle of a chunk, and heard where native code hears none."""

import os
import signal
import subprocess
import sys
import time

import pytest

from palpate.render.runtime.interrupt import abandonable, ended_promptly, interrupt_between

DEAF = """
import ctypes, signal
from palpate.render.runtime.interrupt import abandonable, ended_promptly

def end():
    print("ended", flush=True)
    return 7

signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever runs the tests may ignore it
sleep = ctypes.CDLL(None).sleep
with ended_promptly(end):
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # so that the C library sleeps on
    with abandonable():
        print("begun", flush=True)
        sleep(30)
"""


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


def test_native_code_that_hears_no_signal_ends_with_the_process():
    begun = time.monotonic()
    with subprocess.Popen([sys.executable, "-c", DEAF], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(0.5)  # until it sleeps: before that Python itself hears the signal
        process.send_signal(signal.SIGINT)
        assert process.stdout.read() == "ended\n"
    assert process.returncode == 7
    assert time.monotonic() - begun < 15  # of 30 s that it would sleep


def interrupt_here():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5)


def begin_again_and_again():
    for _ in range(200):  # until the waiting thread has seen the signal
        with abandonable():
            time.sleep(0.001)


def test_what_can_be_raised_is_raised_and_no_more_such_work_begins_meanwhile():
    ended = []
    with ended_promptly(lambda: ended.append(1) or 1):
        with abandonable():
            pass
        with pytest.raises(KeyboardInterrupt):
            interrupt_here()
        with pytest.raises(KeyboardInterrupt):
            begin_again_and_again()
    assert not ended
    with abandonable():
        pass


def test_where_an_application_handles_the_signal_nothing_changes():
    seen, before = [], signal.signal(signal.SIGINT, lambda signum, frame: seen.append(signum))
    try:
        with ended_promptly(lambda: 1):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.05)
            refused = None
            try:
                begin_again_and_again()
            except KeyboardInterrupt as error:
                refused = error
    finally:
        signal.signal(signal.SIGINT, before)
    assert (seen, refused) == ([signal.SIGINT], None)
