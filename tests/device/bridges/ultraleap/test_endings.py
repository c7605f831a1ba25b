"""palpate-ultraleap is silent on every way out: docs/formats/ultraleap-bridge.md, "Off"."""

import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from ultraleap_bridge import (
    RATE,
    Bridge,
    Client,
    compare,
    numbers_of,
    recorded,
    shared_program,
    unlike_samples,
)

SENDER = """
import sys, time
import numpy as np
from ultraleap_bridge import Client, unlike_samples
client = Client(int(sys.argv[1]))
client.open()
client.wait(lambda state: state.device_samples > 0)
client.foci(unlike_samples(int(sys.argv[2])))
client.wait(lambda state: state.begun > 400)
print("sounding", flush=True)
while True:
    client.state()
    time.sleep(0.01)
"""
"""A process that sends so many samples, and then asks for the state until it is ended from outside."""


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


@pytest.fixture
def record(tmp_path):
    return tmp_path / "record"


def started_sender(bridge, count):
    words = [sys.executable, "-c", SENDER, str(bridge.port), str(count)]
    sender = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert sender.stdout.readline() == "sounding\n"
    return sender


def judged_prefix(record, sent):
    """How many samples were heard before silence: they are the first ones, each in order, and nothing else."""
    _, heard = recorded(record)
    numbers = numbers_of(heard, sent)
    sounding = numbers[numbers != -1]
    assert list(sounding[np.flatnonzero(np.diff(sounding, prepend=-9))]) == [*range(sounding.max() + 1)]
    assert numbers[0] == numbers[-1] == -1
    assert compare(heard, sent)[2:4] == (0, 0)
    return int(sounding.max()) + 1


def sounding_client(bridge, sent):
    client = Client(bridge.port)
    client.open()
    client.wait(lambda state: state.device_samples > 0)
    client.foci(sent)
    client.wait(lambda state: state.begun > 400)
    return client


def test_a_connection_that_ends_is_silence_and_the_next_client_plays(program, record):
    sent = unlike_samples(20_000)
    with Bridge(program, record=record) as bridge:
        sounding_client(bridge, sent).socket.close()
        with Client(bridge.port) as client:
            client.open()
            client.wait(lambda state: state.device_samples > 0)
            client.play_out(sent[:400])
        assert bridge.end() == 0
    taken, begun, passed, dropped, _ = [
        int(n) for n in re.findall(r"\d+", re.findall("^played: .*", bridge.output, re.M)[0])
    ][:5]
    assert (taken, passed, begun + dropped) == (20_000, 0, 20_000)
    assert judged_prefix(record, sent) == begun
    _, heard = recorded(record, start=2)
    assert compare(heard, sent[:400]) == (400, 400, 0, 0, 0, True, True)


@pytest.mark.exhaustive
def test_a_client_that_is_killed_leaves_silence(program, record):
    with Bridge(program, "--once", record=record) as bridge:
        sender = started_sender(bridge, 30_000)
        sender.kill()
        sender.communicate(timeout=20)
        assert bridge.end(None) == 0
    assert bridge.counts()[1] == judged_prefix(record, unlike_samples(30_000)) < 30_000
    assert "client went: its connection ended" in bridge.output


@pytest.mark.exhaustive
def test_a_client_that_stops_leaves_silence_and_learns_why(program, record):
    """The bridge notices half a second after the last message; the array sounds until then."""
    with Bridge(program, "--once", record=record) as bridge:
        sender = started_sender(bridge, 60_000)
        sender.send_signal(signal.SIGSTOP)
        assert bridge.end(None) == 1
        sender.send_signal(signal.SIGCONT)
        _, errors = sender.communicate(timeout=20)
    assert 0 < bridge.counts()[1] == judged_prefix(record, unlike_samples(60_000)) < 60_000
    sentence = "nothing was heard from the client for 0.5 s while samples waited or sounded"
    assert sentence in bridge.output
    assert f"FailError: {sentence}" in errors


@pytest.mark.exhaustive
def test_a_client_must_be_heard_while_its_last_sample_sounds(program, record):
    with Bridge(program, record=record) as bridge, Client(bridge.port) as client:
        client.open(rate=1.0)  # a sample sounds for 1 s, and for the hold
        client.wait(lambda state: state.device_samples > 0)
        client.foci(unlike_samples(1))
        state = client.wait(lambda state: state.begun == 1)
        assert (state.waiting, state.dry_times) == (0, 0)
        assert "nothing was heard from the client for 0.5 s" in client.failure()
    assert judged_prefix(record, unlike_samples(1)) == 1


@pytest.mark.exhaustive
def test_a_client_that_sends_late_is_dry_and_no_sample_is_left_out(program, record):
    sent = unlike_samples(4000)
    with Bridge(program, record=record) as bridge, Client(bridge.port) as client:
        client.open()
        client.wait(lambda state: state.device_samples > 0)
        for k, wait in enumerate([0.05, 0.3, 0.05, 0.02, 0.2]):
            client.foci(sent[800 * k : 800 * (k + 1)])
            client.wait(lambda state: state.waiting == 0)
            time.sleep(wait)
        state = client.wait(lambda state: state.intensity == 0)
        assert (state.begun, state.passed, state.dry_times) == (4000, 0, 5)
    times, heard = recorded(record)
    assert compare(heard, sent) == (4000, 4000, 0, 0, 0, True, True)
    numbers = numbers_of(heard, sent)
    for last in range(799, 4000, 800):  # held for 0.1 s at most
        held = times[numbers == last]
        assert held[-1] - held[0] <= 0.1 + 2 / RATE
    assert numbers[np.argmax(numbers == 1600) - 1] == -1  # after 0.3 s


@pytest.mark.exhaustive
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_in_silence(program, record, number):
    sent = unlike_samples(30_000)
    with Bridge(program, record=record) as bridge, sounding_client(bridge, sent) as client:
        bridge.process.send_signal(number)
        assert "a signal ended palpate-ultraleap" in client.failure()
        assert bridge.end(None) == 0
    assert bridge.counts()[1] == judged_prefix(record, sent) < 30_000


def test_stop_is_silence_before_its_answer_and_what_follows_begins_anew(program, record):
    sent = unlike_samples(20_000)
    with Bridge(program, record=record) as bridge, sounding_client(bridge, sent[:19_000]) as client:
        state = client.state(b"STOP")
        assert (state.intensity, state.waiting, state.taken) == (0, 0, 19_000)
        assert state.dropped == 19_000 - state.begun > 0
        client.foci(sent[19_000:])
        later = client.wait(lambda state: state.waiting == 0 and state.intensity == 0)
        assert later.begun == state.begun + 1000
    _, heard = recorded(record)
    numbers = numbers_of(heard, sent)
    assert list(np.unique(numbers)) == [-1, *range(state.begun), *range(19_000, 20_000)]
    assert numbers[np.argmax(numbers == 19_000) - 1] == -1


@pytest.mark.exhaustive
def test_a_library_that_asks_for_nothing_any_more_is_a_failure(program, record):
    with Bridge(program, record=record, dies="0.05") as bridge, Client(bridge.port) as client:
        client.open()
        client.foci(unlike_samples(8000))
        with pytest.raises(Exception, match=r"asked for no samples for 1 s: is the array still plugged in"):
            client.wait(lambda state: False)
        bridge.end()
        taken, begun, passed, dropped, _ = bridge.counts()
        assert (taken, begun + passed + dropped) == (8000, 8000)  # the library's thread is gone, and dropped nothing
    samples = unlike_samples(60_000)
    with Bridge(program, dies="0.3") as bridge, Client(bridge.port) as client:  # STOP is answered all the same
        client.open()
        client.foci(samples)
        client.wait(lambda state: state.device_samples == 12_000)
        assert client.state(b"STOP").intensity > 0


def test_a_library_that_does_not_stop_is_named(program):
    with Bridge(program, fault="stop") as bridge, Client(bridge.port) as client:
        client.open()
        assert bridge.end() == 0
    assert "warning: the Ultraleap library cannot stop: HardwareFault" in bridge.output
