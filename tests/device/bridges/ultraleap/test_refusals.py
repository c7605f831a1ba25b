"""Messages that palpate-ultraleap refuses, each with a sentence: docs/formats/ultraleap-bridge.md."""

import contextlib
import re
import socket
import struct

import numpy as np
import pytest
from ultraleap_bridge import Bridge, Client, compare, recorded, shared_program, unlike_samples

OPEN = struct.Struct("<IId")


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    return shared_program(tmp_path_factory)


@pytest.fixture
def bridge(program, tmp_path):
    with Bridge(program, record=tmp_path / "record", rates="40000,20000,10000") as bridge:
        yield bridge


def samples_with(value, number=7, column=3):
    samples = unlike_samples(20)
    samples[number, 0, column] = value
    return samples.tobytes()


WRONG_MESSAGES = {  # by what is sent after OPEN of one point at 40 kHz
    "not finite": (b"FOCI", samples_with(np.nan, column=1), "sample 8007, point 0: y nan is not finite"),
    "infinite": (b"FOCI", samples_with(np.inf, column=3), "sample 8007, point 0: intensity inf is not finite"),
    "intensity": (b"FOCI", samples_with(1.5), r"sample 8007, point 0: intensity 1.5 is outside 0..1"),
    "negative": (b"FOCI", samples_with(-0.25), r"intensity -0.25 is outside 0..1"),
    "part of a sample": (b"FOCI", bytes(40), "FOCI has 40 bytes, which is no whole number of samples of 16 bytes"),
    "unknown": (b"JUMP", b"", "message 'JUMP' is unknown"),
    "not printable": (b"\x00\xffA\n", b"", r"message '\?\?A\?' is unknown"),
    "HELO again": (b"HELO", b"PALPATEU" + struct.pack("<I", 1), "HELO came a second time"),
    "OPEN too short": (b"OPEN", bytes(12), "OPEN must have 16 bytes"),
    "OPEN reserved": (b"OPEN", OPEN.pack(1, 5, 1000.0), "OPEN must have 16 bytes: points a sample, 0 and a rate"),
    "no points": (b"OPEN", OPEN.pack(0, 0, 1000.0), "0 focal points a sample: this array takes 1 to 3"),
    "points": (b"OPEN", OPEN.pack(4, 0, 1000.0), "4 focal points a sample: this array takes 1 to 3"),
    "no rate": (b"OPEN", OPEN.pack(1, 0, 0.0), "a rate of 0 Hz is below 1 Hz"),
    "rate not finite": (b"OPEN", OPEN.pack(1, 0, np.nan), "a rate of nan Hz is below 1 Hz"),
    "rate": (
        b"OPEN",
        OPEN.pack(3, 0, 20_000.0),
        r"a rate of 20000 Hz is above 10000 Hz, the highest at which this array takes 3 focal points "
        r"\(1: 40000 Hz, 2: 20000 Hz, 3: 10000 Hz\): update rate 10000 Hz \(40000 / 4\) fits",
    ),
}


@pytest.mark.parametrize("case", WRONG_MESSAGES)
def test_a_wrong_message_is_named_and_the_array_is_silent(bridge, tmp_path, case):
    name, content, sentence = WRONG_MESSAGES[case]
    with Client(bridge.port) as client:
        client.open()
        client.foci(unlike_samples(8000))
        client.wait(lambda state: state.begun > 0)
        client.send(name, content)
        assert re.search(sentence, client.failure())
    assert bridge.end() == 0
    _, heard = recorded(tmp_path / "record")
    assert heard[-1, 0, 3] == 0


FIRST_BYTES = {
    "HTTP": (b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", "the first message is 'GET ' instead of HELO"),
    "random": (bytes(range(7, 200)), r"the first message is '\?\?\?\?' instead of HELO"),
    "FOCI first": (b"FOCI" + bytes(4), "the first message is 'FOCI' instead of HELO"),
    "PING first": (b"PING" + bytes(4), "the first message is 'PING' instead of HELO"),
    "other program": (
        b"HELO" + struct.pack("<I", 12) + b"PALPATEX\1\0\0\0",
        "HELO is not that of palpate, which has PALPATEU",
    ),
    "long HELO": (b"HELO" + struct.pack("<I", 13) + b"PALPATEU\1\0\0\0\0", "HELO is not that of palpate"),
    "version": (
        b"HELO" + struct.pack("<I", 12) + b"PALPATEU\2\0\0\0",
        "the client speaks version 2 of the messages, and palpate-ultraleap version 1: compile palpate-ultraleap from",
    ),
    "oversized": (
        b"HELO" + struct.pack("<I", 2**20 + 1),
        "message 'HELO' has 1048577 bytes, which is more than 1048576",
    ),
}


@pytest.mark.parametrize("case", FIRST_BYTES)
def test_another_program_is_sent_away_with_a_sentence(bridge, case):
    content, sentence = FIRST_BYTES[case]
    with Client(bridge.port, greets=False) as client:
        client.socket.sendall(content)
        assert re.search(sentence, client.failure())
    with Client(bridge.port) as client:  # palpate is served afterwards
        assert client.open() == 40_000


@pytest.mark.exhaustive
def test_a_client_that_says_nothing_is_sent_away_after_two_seconds(bridge):
    with Client(bridge.port, greets=False) as client:
        assert client.failure() == "no HELO came within 2 s"
    with Client(bridge.port) as client:
        assert client.open() == 40_000


def test_messages_may_come_in_any_pieces(bridge, tmp_path):
    """One byte at a time, and several messages at once."""
    sent = unlike_samples(30)
    foci = b"FOCI" + struct.pack("<I", 480) + sent.tobytes()
    stream = b"HELO" + struct.pack("<I", 12) + b"PALPATEU\1\0\0\0OPEN" + struct.pack("<IIId", 16, 1, 0, 40_000.0)
    with Client(bridge.port, greets=False) as client:
        for byte in stream:
            client.socket.sendall(bytes([byte]))
        client.socket.sendall(foci + b"FOCI" + bytes(4) + b"PING" + bytes(4) + foci[:100])
        assert client.receive(b"HELO")[:8] == b"PALPATEU"
        assert struct.unpack("<d", client.receive(b"OPEN")) == (40_000,)
        assert struct.unpack("<8Qf", client.receive(b"STAT"))[0] == 30
        client.socket.sendall(foci[100:])
        assert client.state().taken == 60


def test_hello_names_queue_points_library_and_array(program):
    with Bridge(program, firmware="9.9", device="x") as bridge, Client(bridge.port) as client:
        assert "array USX:00000001 (USX, firmware 9.9), Ultraleap SDK 3.0.0-stub" in bridge.ready
    magic, version, queue, points, zero = struct.unpack("<8sIIII", client.hello[:24])
    assert (magic, version, queue, points, zero) == (b"PALPATEU", 1, 65_536, 4, 0)
    assert client.hello[24:].decode().split("\n") == ["3.0.0-stub", "USX:00000001", "USX"]


def test_a_second_client_is_refused_and_the_first_plays_on(bridge):
    with Client(bridge.port) as first:
        first.open()
        with Client(bridge.port, greets=False) as second:
            second.socket.sendall(b"HELO" + struct.pack("<I", 12) + b"PALPATEU\1\0\0\0")
            assert re.match(r"the array is in use by another client, 127\.0\.0\.1 port \d+", second.failure())
        assert first.play_out(unlike_samples(400)).begun == 400


def test_samples_beyond_the_queue_are_refused(bridge):
    samples = unlike_samples(65_536)
    with Client(bridge.port) as client:
        client.open(rate=1.0)
        client.foci(samples)
        assert client.state().waiting in (65_535, 65_536)
        client.foci(samples[:2])
        assert re.match(r"FOCI has 2 samples, and the queue has room for [01]", client.failure())


def test_foci_before_open_and_requests_before_it(bridge):
    with Client(bridge.port) as client:
        assert client.state() == client.state(b"STOP") == (0,) * 9
        client.foci(unlike_samples(1))
        assert client.failure() == "FOCI came before OPEN"


def test_a_stream_that_ends_within_a_message_is_silence_and_is_told(program, tmp_path):
    with Bridge(program, "--once", record=tmp_path / "record") as bridge:
        with Client(bridge.port) as client:
            client.open()
            client.foci(unlike_samples(400))
            client.wait(lambda state: state.begun > 0)
            client.socket.sendall(b"FOCI" + struct.pack("<I", 64) + bytes(24))
        assert bridge.end(None) == 1
    assert "client went: its connection ended within a message" in bridge.output
    _, heard = recorded(tmp_path / "record")
    assert heard[-1, 0, 3] == 0
    assert compare(heard, unlike_samples(400))[2:4] == (0, 0)  # nothing of the half message


@pytest.mark.exhaustive
def test_a_client_that_reads_no_answers_is_sent_away(bridge):
    with socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", bridge.port))
        slow.sendall(b"HELO" + struct.pack("<I", 12) + b"PALPATEU\1\0\0\0")
        with contextlib.suppress(ConnectionError):
            slow.sendall((b"PING" + bytes(4)) * 1_000_000)
        with Client(bridge.port) as client:
            assert client.open() == 40_000
    bridge.end()
    assert "was sent away: the client does not read its answers" in bridge.output


def test_a_start_that_fails_is_answered_and_the_next_client_is_served(program):
    for fault, sentence in (("start", "cannot start: HardwareFault"), ("throw", "the stub throws at start")):
        with Bridge(program, fault=fault) as bridge:
            for _ in range(2):
                with Client(bridge.port) as client:
                    client.send(b"OPEN", OPEN.pack(1, 0, 1000.0))
                    assert sentence in client.failure()
