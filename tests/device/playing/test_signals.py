"""Signals, in a process of its own that plays in real time: the array is off, and the caller learns of it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading

import pytest

from palpate.device import EmulatorBackend, Player, PlayInterrupted, VirtualClock, array_model, open_link
from palpate.device.playing.signals import end_process, ending_on_signals

PLAYS_FOREVER = """
import json, signal, sys, threading, time
import numpy as np
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # whatever runs the tests, such as nohup, may ignore it
from palpate.device import EmulatorBackend, Player, PlayInterrupted, array_model, open_link

maker = sys.argv[1]
bus = EmulatorBackend(record=10)
wire = np.full((100, 512), 200, np.uint8)
closed, told = [], []

def blocks():
    try:
        while maker != "ends" or bus.board().bytes_received < 2000 * 512:
            yield wire.tobytes()
            if maker == "sleeps" and bus.board().bytes_received:
                tell()
                time.sleep(600)
    finally:
        closed.append(True)

def tell():
    if not told:
        told.append(True)
        print("playing", flush=True)

def progress(frames):
    if frames and maker != "sleeps":  # which tells by itself, when it is about to
        tell()

signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
before = [signal.getsignal(s) for s in signals]
with open_link(array_model("emulator"), backend=bus) as link:
    try:
        Player(link).play(blocks(), update_rate=40e3 / 4 if maker != "ends" else 40e3 / 255, progress=progress)
    except PlayInterrupted as interrupt:
        report = interrupt.report
        print(json.dumps({
            "signum": interrupt.signum,
            "stopped_by": report.stopped_by,
            "off_confirmed": report.off_confirmed,
            "frames": report.frames,
            "last": bus.board().played.max(axis=1).tolist(),
            "playing": int(bus.board().playing.max()),
            "threads": threading.active_count(),
            "handlers_restored": before == [signal.getsignal(s) for s in signals],
            "maker_closed": closed,
        }))
        raise
"""


def played_until(signum: signal.Signals, maker: str) -> tuple[dict[str, object], str]:
    """What the process tells about its end, and its standard error."""
    child = subprocess.Popen(
        [sys.executable, "-c", PLAYS_FOREVER, maker], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert child.stdout is not None
        assert child.stdout.readline() == "playing\n"
        child.send_signal(signum)
        out, err = child.communicate(timeout=60)
    finally:
        child.kill()
        child.wait()
    return json.loads(out), err


@pytest.mark.exhaustive
@pytest.mark.parametrize("maker", ["streams", "sleeps", "ends"])
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_switches_the_array_off_and_ends_the_script(signum: signal.Signals, maker: str) -> None:
    end, err = played_until(signum, maker)
    assert (end["signum"], end["stopped_by"]) == (signum, signum.name)
    assert end["off_confirmed"]
    *content, off = end["last"]
    assert off == 0
    assert set(content) <= {200}
    assert end["playing"] == 0
    assert end["frames"] > 0
    assert end["threads"] == 1
    assert end["handlers_restored"]
    assert maker != "sleeps" or end["maker_closed"] == [True]
    assert "PlayInterrupted: playback was stopped by" in err  # uncaught, it ends the script, as the signal asked


@pytest.mark.parametrize("where", ["blocks", "progress"])
@pytest.mark.parametrize("signum", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_of_two_signals_ends_the_playback_with_the_array_off(signum: signal.Signals, where: str) -> None:
    def raise_two() -> None:
        signal.raise_signal(signum)
        signal.raise_signal(signal.SIGINT)

    def blocks():
        for number in range(40):
            if number == 20 and where == "blocks":
                raise_two()
            yield bytes([200]) * 512 * 100

    def progress(frames: int) -> None:
        if frames and where == "progress":
            raise_two()

    signal.signal(signum, lambda *_: None)  # if the player does not handle it, this test fails, and not all of pytest
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    bus = EmulatorBackend(clock=VirtualClock())
    with open_link(array_model("emulator"), backend=bus) as link, pytest.raises(PlayInterrupted) as caught:
        Player(link).play(blocks(), update_rate=10e3, progress=progress)
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
    report = caught.value.report
    assert (caught.value.signum, report.stopped_by, report.off_confirmed) == (signum, signum.name, True)
    assert not bus.board().playing.any()


@pytest.fixture
def handlers_kept():
    """Handlers of signals are those of before afterwards: a process that ends leaves them ignored."""
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for signum, handler in before.items():
        signal.signal(signum, handler)


@pytest.mark.usefixtures("handlers_kept")
def test_a_signal_whose_exception_a_destructor_swallowed_keeps_the_next_playback_from_beginning() -> None:
    bus = EmulatorBackend(clock=VirtualClock())
    with ending_on_signals():
        with pytest.raises(KeyboardInterrupt):  # stands for the destructor, out of which Python raises nothing
            end_process(signal.SIGTERM, None)
        with open_link(array_model("emulator"), backend=bus) as link, pytest.raises(KeyboardInterrupt):
            Player(link).play([bytes([200]) * 512 * 100], update_rate=10e3)
    assert bus.board().frames_played == 0
    with open_link(array_model("emulator"), backend=bus) as link:  # a program that goes on may play again
        assert Player(link).play([bytes([200]) * 512 * 100], update_rate=10e3).frames == 100


def test_away_from_the_main_thread_no_handler_is_touched() -> None:
    seen = []

    def play() -> None:
        def blocks():
            seen.append(signal.getsignal(signal.SIGINT))
            yield bytes(512)

        with open_link(array_model("emulator"), backend=EmulatorBackend(clock=VirtualClock())) as link:
            seen.append(Player(link).play(blocks(), update_rate=10e3).stopped_by)

    thread = threading.Thread(target=play)
    thread.start()
    thread.join()
    assert seen == [signal.getsignal(signal.SIGINT), "end"]


ENDS_WHILE_A_DAEMON_PLAYS = """
import atexit, json, threading
import numpy as np
outcome = {}

@atexit.register  # before palpate's own, so after it
def tell():
    outcome["last"] = bus.board().played.max(axis=1).tolist()
    outcome["stopped_by"] = player.report.stopped_by if player.report else None
    print(json.dumps(outcome))

from palpate.device import EmulatorBackend, Player, array_model, open_link

bus = EmulatorBackend(record=10)
wire = np.full((100, 512), 200, np.uint8)
playing = threading.Event()

def blocks():
    while True:
        yield wire.tobytes()
        if bus.board().bytes_received:
            playing.set()

link = open_link(array_model("emulator"), backend=bus)
player = Player(link)
threading.Thread(target=lambda: player.play(blocks(), update_rate=10e3), daemon=True).start()
playing.wait(30)
"""


@pytest.mark.exhaustive
def test_the_end_of_the_interpreter_switches_off_what_a_daemon_thread_plays() -> None:
    done = subprocess.run(
        [sys.executable, "-c", ENDS_WHILE_A_DAEMON_PLAYS], capture_output=True, text=True, timeout=60, check=True
    )
    outcome = json.loads(done.stdout)
    assert outcome["last"][-1] == 0
    assert set(outcome["last"][:-1]) == {200}
    assert outcome["stopped_by"] in (None, "exit")
    assert done.stderr == "" or "Traceback" not in done.stderr


def test_a_signal_that_was_ignored_stays_ignored_while_it_plays() -> None:
    seen = []

    def blocks():
        seen.append(signal.getsignal(signal.SIGINT))
        yield bytes(512)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell does for `command &` in a script
    with (
        open_link(array_model("emulator"), backend=EmulatorBackend(clock=VirtualClock())) as link,
        ending_on_signals(),
    ):
        seen.append(signal.getsignal(signal.SIGINT))
        Player(link).play(blocks(), update_rate=10e3)
    assert seen == [signal.SIG_IGN, signal.SIG_IGN]


def test_a_command_that_no_signal_ended_has_its_handlers_back_and_one_that_was_ignores_later_ones() -> None:
    before = [signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with ending_on_signals():
        assert signal.getsignal(signal.SIGTERM) not in before
    assert [signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
    with pytest.raises(KeyboardInterrupt, match="SIGTERM"), ending_on_signals():
        signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGTERM)
    signal.raise_signal(signal.SIGINT)
