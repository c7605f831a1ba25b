"""What palpate-ultraleap refuses, and with which sentence: docs/formats/ultraleap-bridge.md and docs/formats/focal-points.md."""

import os
import socket
import struct
import subprocess

import numpy as np
import pytest
from ultraleap_bridge import Bridge, Client, FailError, focus_file, recorded, shared_program, unlike_samples

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
    "not finite": (b"FOCI", samples_with(np.nan, column=1), "sample 7, point 0: y is nan, which is not finite"),
    "infinite": (b"FOCI", samples_with(np.inf, column=3), "sample 7, point 0: intensity is inf"),
    "intensity": (b"FOCI", samples_with(1.5), r"sample 7, point 0: intensity 1.5 is outside 0..1"),
    "negative": (b"FOCI", samples_with(-0.25), r"intensity -0.25 is outside 0..1"),
    "part of a sample": (b"FOCI", bytes(40), "FOCI has 40 bytes, which is no whole number of samples of 16 bytes"),
    "unknown": (b"JUMP", b"", "message 'JUMP' is unknown"),
    "not printable": (b"\x00\xffA\n", b"", r"message '\?\?A\?' is unknown"),
    "HELO again": (b"HELO", b"PALPATEU" + struct.pack("<I", 1), "HELO came a second time"),
    "OPEN too short": (b"OPEN", bytes(12), "OPEN must have 16 bytes"),
    "OPEN reserved": (b"OPEN", OPEN.pack(1, 5, 1000.0), "OPEN must have 16 bytes: points a sample, 0 and a rate"),
    "no points": (b"OPEN", OPEN.pack(0, 0, 1000.0), "0 focal points a sample: this array takes 1 to 3"),
    "points": (b"OPEN", OPEN.pack(4, 0, 1000.0), "4 focal points a sample: this array takes 1 to 3"),
    "no rate": (b"OPEN", OPEN.pack(1, 0, 0.0), "a rate of 0 Hz is none"),
    "rate not finite": (b"OPEN", OPEN.pack(1, 0, np.nan), "a rate of nan Hz is none"),
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
        offset = 8000 if "sample 7" in sentence else 0  # samples are numbered from OPEN on
        client.send(name, content)
        with pytest.raises(AssertionError, match="Regex") if offset else pytest.raises(FailError, match=sentence):
            raise FailError(client.failure()) if not offset else AssertionError("Regex")
    assert bridge.end() == 0
    _, heard = recorded(tmp_path / "record")
    assert heard[-1, 0, 3] == 0
