"""Other programs read a study's events and answer for a participant, over real sockets; none of them stops a study."""

import json
import math
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from palpate.render.study.plan.study_plan import Question
from palpate.render.study.run.desk import KeyChoice, StudyDesk
from palpate.render.study.run.event_stream import FAULTS_MOST, LINE_BYTES_MOST, EventStream

TOKEN = "a-token"
KEYS = (KeyChoice(key="ArrowLeft", label="First", value=0), KeyChoice(key="ArrowRight", label="Second", value=1))
DENSER = Question(name="denser", text="Which one?", kind="choice", options=("First", "Second"))
SIZE = Question(name="size", text="How large?", kind="number", low=0, high=100)


class Client:
    """A program on the other side of the socket."""

    def __init__(self, port, host="127.0.0.1"):
        self.connection = socket.create_connection((host, port), timeout=5)
        self.lines = self.connection.makefile("rb")

    def read(self, event=None):
        """The next line, or the next one of an event; None: the connection has ended."""
        for line in self.lines:
            values = json.loads(line)
            if event in (None, values["event"]):
                return values
        return None

    def write(self, **values):
        self.connection.sendall(json.dumps(values).encode() + b"\n")

    def ask(self, **values):
        """The answer to a line with the token; others are left out."""
        self.write(**{"token": TOKEN} | values)
        while (line := self.read())["event"] not in ("reply", "error"):
            pass
        return line

    def close(self):
        self.lines.close()
        self.connection.close()


@contextmanager
def serving(**options):
    """A desk and its stream, and a function that connects clients."""
    desk, clients = StudyDesk(), []

    def connect():
        clients.append(Client(stream.port))
        return clients[-1]

    with EventStream(desk, **{"port": None, "token": TOKEN} | options) as stream:
        try:
            yield desk, stream, connect
        finally:
            for client in clients:
                client.close()


def wait_for(is_so, seconds=5.0):
    end = time.monotonic() + seconds
    while not is_so() and time.monotonic() < end:
        time.sleep(0.002)
    return is_so()


def test_a_client_gets_the_screen_that_is_shown_and_each_event_after_it():
    with serving() as (desk, stream, connect):
        desk.show(
            "question", "Which one?", title="Trial 1 of 10", hint="Press", keys=KEYS, question=DENSER, progress=0.5
        )
        client = connect()
        before = time.monotonic()
        hello = client.read()
        assert hello["event"] == "hello"
        assert hello["format"] == 1
        assert re.match(r"\d+\.\d+", hello["palpate"])
        assert before - 5 < hello["array_time"] < time.monotonic()
        assert hello["screen"] == {
            "number": 1, "kind": "question", "title": "Trial 1 of 10", "text": "Which one?", "hint": "Press",
            "keys": [{"key": "ArrowLeft", "label": "First"}, {"key": "ArrowRight", "label": "Second"}],
            "choices": "← First     → Second", "question": {"name": "denser", "kind": "choice"},
            "ends": None, "progress": 0.5,
        }  # fmt: skip
        stream.send("trial_begun", trial=3, name="cc", level=math.nan, ratio=np.float32(1.5), file=Path("a.h5"))
        begun = client.read()
        times = {begun.pop("time"), begun.pop("array_time"), begun.pop("is_estimate")}
        assert len(times) == 3
        assert begun == {"event": "trial_begun", "trial": 3, "name": "cc", "level": None, "ratio": 1.5, "file": "a.h5"}
        desk.show("rest", "Rest", ends=12.5)
        shown = client.read()
        assert (shown["event"], shown["number"], shown["kind"]) == ("screen", 2, "rest")
        assert (shown["ends"], shown["question"], shown["keys"]) == (12.5, None, [])
        assert connect().read()["screen"]["number"] == 2


def test_the_wall_clocks_time_is_that_of_the_arrays_time():
    """An onset is sent after it happened, so both times lie before the line was made."""
    with serving() as (_, stream, connect):
        client = connect()
        client.read()
        onset = time.monotonic() - 2.0
        stream.send("stimulus_onset", array_time=onset, is_estimate=True)
        line = client.read()
        assert line["array_time"] == onset
        assert line["is_estimate"] is True
        moment = datetime.fromisoformat(line["time"])
        assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}\+00:00", line["time"])
        assert timedelta(seconds=1.9) < datetime.now(UTC) - moment < timedelta(seconds=5)


def test_answers_count_once_and_only_for_the_screen_that_is_shown():
    with serving() as (desk, _, connect):
        client = connect()
        assert client.ask(page=True)["counts"] is True
        assert desk.has_page
        desk.show("question", "Which one?", keys=KEYS, question=DENSER)
        assert client.ask(press="ArrowRight", screen=0, seconds=0.1)["counts"] is False
        assert client.ask(press="x", screen=1, seconds=0.2)["counts"] is False
        taken = client.ask(press="ArrowRight", screen=1, seconds=0.51)
        assert (taken["event"], taken["counts"], taken["screen"]) == ("reply", True, 1)
        assert client.ask(press="ArrowRight", screen=1, seconds=0.52)["counts"] is False
        assert desk.await_response(1).__dict__ == {"value": 1, "key": "ArrowRight", "seconds": 0.51}
        assert desk.extra_presses == 3
        desk.show("question", "How large?", question=SIZE)
        assert client.ask(give=101, screen=2, seconds=1)["text"] == "size must be from 0 to 100, not 101"
        assert client.ask(give=25, screen=2, seconds=2)["counts"] is True
        assert desk.await_response(1).value == 25
        assert client.ask(stop="the participant\x1b[2J coughs")["counts"] is True
        assert desk.status()["stop_reason"] == r"the participant\x1b[2J coughs"


def test_without_the_token_events_are_read_only():
    with serving() as (desk, _, connect):
        desk.show("text", "Welcome", keys=KEYS)
        client = connect()
        for token in ("another", "", None, 5, "ä"):
            for asked in ({"page": True}, {"press": "ArrowLeft", "screen": 1, "seconds": 1}, {"stop": "now"}):
                assert "token must be" in client.ask(token=token, **asked)["text"]
        assert desk.status() | {"has_page": False, "is_stopped": False, "extra_presses": 0} == desk.status()
        desk.show("text", "Next")
        assert client.read("screen")["text"] == "Next"


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (b"no json", "the line is not JSON: Expecting value"),
        (b"\x00\xff\xfe\x1b[2J", "the line is not JSON: 'utf-8'"),
        (b"[" * 60_000, "60000 deep in each other, more than 256"),
        (b"[1]", r"must be a JSON object, not \[1\]"),
        (b"{}", "exactly one of press, give, stop, page, not 0"),
        (b'{"press": "a", "give": 1}', "exactly one of press, give, stop, page, not 2"),
        (b'{"press": "a", "token": "a-token", "secs": 1}', "a line with press has no key 'secs'"),
        (b'{"press": "a", "token": "a-token", "seconds": 1}', "screen must be the whole number .* not None"),
        (b'{"press": "a", "token": "a-token", "screen": true, "seconds": 1}', "screen must be .* not True"),
        (b'{"press": "a", "token": "a-token", "screen": -1, "seconds": 1}', "screen must be .* not -1"),
        (b'{"press": "a", "token": "a-token", "screen": 1, "seconds": -0.1}', "from 0 to 86400, not -0.1"),
        (b'{"press": "a", "token": "a-token", "screen": 1, "seconds": 1e9}', "from 0 to 86400, not 1000000000"),
        (b'{"press": "a", "token": "a-token", "screen": 1, "seconds": NaN}', "NaN is not a finite number"),
        (b'{"press": "a", "token": "a-token", "screen": 1, "seconds": "1"}', "from 0 to 86400, not '1'"),
        (b'{"press": 5, "token": "a-token", "screen": 1, "seconds": 1}', "press must be a text of 1 to 32"),
        (b'{"press": "", "token": "a-token", "screen": 1, "seconds": 1}', "press must be a text of 1 to 32"),
        (b'{"give": true, "token": "a-token", "screen": 1, "seconds": 1}', "size must be a number, not True"),
        (b'{"give": [1], "token": "a-token", "screen": 1, "seconds": 1}', r"number, a text or null, not \[1\]"),
        (b'{"give": 1%s, "token": "a-token", "screen": 1, "seconds": 1}' % (b"0" * 400), "a text or null, not 10000"),
        (b'{"give": "a", "token": "a-token", "screen": 1, "seconds": 1}', "size must be a number, not 'a'"),
        (b'{"stop": {}, "token": "a-token"}', "stop must be a text of 1 to 200 characters, not {}"),
        (b'{"page": 1, "token": "a-token"}', "page must be true, not 1"),
        (b'{"press": "a", "press": "b"}', "key 'press' more than once"),
    ],
)
def test_a_line_that_is_wrong_is_answered_by_a_sentence_and_changes_nothing(line, text, capfd):
    with serving() as (desk, _, connect):
        desk.show("question", "How large?", question=SIZE)
        client = connect()
        client.read()
        client.connection.sendall(b"\r\n" + line + b"\r\n")
        refused = client.read()
        assert refused["event"] == "error"
        assert re.search(text, refused["text"])
        assert "\x1b" not in refused["text"]
        assert client.ask(give=25, screen=1, seconds=1)["counts"] is True
        assert desk.await_response(0).value == 25
    assert capfd.readouterr() == ("", "")


def test_a_client_that_sends_too_much_or_too_often_what_is_wrong_is_cut_off():
    with serving() as (_, stream, connect):
        long = connect()
        long.read()
        long.connection.sendall(b"x" * (LINE_BYTES_MOST + 1))
        assert long.read()["text"] == "a line may have 65536 bytes at most"
        assert long.read() is None
        wrong = connect()
        wrong.read()
        wrong.connection.sendall(b"?\n" * FAULTS_MOST)
        assert [wrong.read()["event"] for _ in range(FAULTS_MOST)] == ["error"] * FAULTS_MOST
        assert wrong.read() is None
        assert stream.counts.cut_off == 2
        assert wait_for(lambda: stream.counts.connected == 0)


def test_a_client_that_does_not_read_loses_lines_is_told_how_many_and_delays_nobody():
    with serving() as (_, stream, connect):
        slow, quick = connect(), connect()
        quick.read()
        slow.read()
        for client in stream._clients:  # so that what waits goes out in several steps, as over a network
            client.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65536)
        text, longest = "x" * 60_000, 0.0

        def send(number):
            nonlocal longest
            begun = time.perf_counter()
            stream.send("answer", number=number, text=text)
            longest = max(longest, time.perf_counter() - begun)
            assert quick.read()["number"] == number

        number = lost = 0

        def read():
            nonlocal number, lost
            line = slow.read()
            if line["event"] == "lost":
                number, lost = number + line["count"], lost + line["count"]
            else:
                assert line["number"] == number  # each gap is where a line says how long it is
                number += 1

        for sent in range(200):  # 12 MB, more than the buffers of both sides
            send(sent)
        for _ in range(8):  # which makes room for some lines, but those that are missing come first
            read()
        time.sleep(0.02)
        for sent in range(200, 205):
            send(sent)
        while number < 205:
            read()
        assert lost == stream.counts.lost_lines > 5
        assert longest < 0.5
        stream.send("study_ended")
        assert slow.read()["event"] == "study_ended"


def test_a_page_that_does_not_read_is_cut_off():
    """A participant who never sees a screen cannot answer it, and must not be touched meanwhile."""
    with serving() as (desk, stream, connect):
        page = connect()
        page.ask(page=True)
        while desk.has_page and stream.counts.cut_off == 0:
            stream.send("answer", text="x" * 200_000)
        assert wait_for(lambda: not desk.has_page, 1.0)
        assert stream.counts.cut_off == 1


def test_the_page_is_open_while_its_connection_stands():
    with serving() as (desk, _, connect):
        reader, page = connect(), connect()
        assert page.ask(page=True)["counts"] is True
        assert "open already" in reader.ask(page=True)["text"]
        desk._seen = float("-inf")  # as if LOST_SECONDS had gone by
        assert wait_for(lambda: desk.has_page, 1.0)
        reader.close()
        time.sleep(0.01)
        assert desk.has_page
        page.close()
        assert wait_for(lambda: not desk.has_page, 1.0)
        other = connect()
        assert other.ask(page=True)["counts"] is True


def test_a_reader_keeps_no_page_open():
    with serving() as (desk, stream, connect):
        desk.open_page()
        desk._seen = float("-inf")
        connect().read()
        stream.send("rest")
        assert not desk.has_page


def test_a_page_whose_program_is_killed_is_closed():
    code = f"""
import json, socket, sys, time
connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
connection.sendall(b'{{"page": true, "token": "{TOKEN}"}}\\n')
time.sleep(60)
"""
    with serving() as (desk, stream, _):
        child = subprocess.Popen([sys.executable, "-S", "-E", "-c", code, str(stream.port)])
        try:
            assert wait_for(lambda: desk.has_page)
            os.kill(child.pid, signal.SIGKILL)
            assert wait_for(lambda: not desk.has_page, 1.0)
        finally:
            child.kill()
            child.wait()


# The desk's side


def test_a_watcher_may_ask_the_desk_and_gets_screens_until_it_ends_this():
    desk, seen = StudyDesk(), []

    def callback(screen):
        asking = threading.Thread(target=lambda: seen.append((screen.number, desk.status()["screen"])), daemon=True)
        asking.start()
        asking.join(5)

    end = desk.watch(callback)
    desk.show("text", "Welcome")
    desk.show("rest", "Rest")
    end()
    end()
    desk.show("ended", "Thank you")
    assert seen == [(1, "text"), (2, "rest")]
    assert desk.shown.number == 3
