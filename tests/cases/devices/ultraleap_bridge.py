"""palpate-ultraleap, compiled against stubs of the vendor's library; a client of it; what its fake array recorded.

The client is written from docs/formats/ultraleap-bridge.md, as the bridge is, and shares no code with palpate's link.
"""

import fcntl
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import time
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]
SOURCES = ROOT / "device" / "bridges" / "ultraleap"
STUBS = ROOT / "tests" / "device" / "bridges" / "stubs"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror")
RATE = 40_000
"""Device samples a second of the fake array with one focal point [Hz]."""


def compile_program(folder, version=3, compiler="g++", flags=()):
    """The program, compiled for one SDK's stub into a folder, by the one line that the source names."""
    if not shutil.which(compiler):
        pytest.skip(f"{compiler} is not installed")
    program = folder / f"palpate-ultraleap-{version}"
    stub = STUBS / f"sdk{version}"
    command = [
        compiler,
        "-std=c++14",
        *WARNINGS,
        *flags,
        "-isystem",
        stub,
        SOURCES / f"sdk{version}.cpp",
        stub / "stub.cpp",
    ]
    done = subprocess.run([*command, "-o", program, "-pthread"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


def shared_program(tmp_path_factory, version=3):
    """The program, compiled once for all processes that run tests; BRIDGE_FLAGS adds options, as -fsanitize=thread."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    program = folder / f"palpate-ultraleap-{version}"
    with (folder / f"lock-{version}").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        flags = os.environ.get("BRIDGE_FLAGS", "").split()
        return program if program.exists() else compile_program(folder, version, flags=flags)


class Bridge:
    """The program that serves, on a port that is free; its output is there when it has ended."""

    def __init__(self, program, *options, **stub):
        environment = os.environ | {f"STUB_{name.upper()}": str(value) for name, value in stub.items()}
        words = [program, "--port", "0", *options]
        self.process = subprocess.Popen(
            words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.ready = self.process.stdout.readline()
        self.port = int((re.findall(r" port (\d+) ", self.ready) or [0])[0])
        self.output = ""

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        if not self.process.stdout.closed:
            self.end(signal.SIGTERM if self.process.poll() is None else None)

    def end(self, number=signal.SIGTERM):
        """Exit code, after a signal if there is one."""
        if number:
            self.process.send_signal(number)
        self.process.wait(timeout=20)  # its output is far smaller than a pipe holds
        with self.process.stdout as output:  # `communicate` would not see what `readline` has read ahead
            self.output += output.read()
        return self.process.returncode

    def counts(self):
        """Samples taken, begun, passed, dropped, times it ran dry: by the last playing's printed line."""
        line = re.findall(r"^played: .*$", self.output, re.MULTILINE)[-1]
        return tuple(int(number) for number in re.findall(r"\d+", line))[:5]


class State(NamedTuple):
    """The content of STAT."""

    taken: int
    begun: int
    passed: int
    dropped: int
    dry_times: int
    dry_device_samples: int
    missed_callbacks: int
    device_samples: int
    intensity: float

    @property
    def waiting(self):
        return self.taken - self.begun - self.passed - self.dropped


class FailError(Exception):
    """The bridge answered FAIL."""


class Client:
    """A client of the bridge."""

    def __init__(self, port, greets=True):
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self.socket.setsockopt(
            socket.IPPROTO_TCP, socket.TCP_NODELAY, 1
        )  # else PING waits 40 ms for FOCI's acknowledgement
        self.hello = self.greet() if greets else b""

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.socket.close()

    def greet(self, name=b"PALPATEU", version=1):
        self.send(b"HELO", name + struct.pack("<I", version))
        return self.receive(b"HELO")

    def send(self, name, content=b""):
        self.socket.sendall(name + struct.pack("<I", len(content)) + content)

    def receive(self, expected):
        header = self.receive_bytes(8)
        content = self.receive_bytes(struct.unpack("<I", header[4:])[0])
        if header[:4] == b"FAIL":
            raise FailError(content.decode())
        assert header[:4] == expected
        return content

    def receive_bytes(self, size):
        found = b""
        while len(found) < size:
            part = self.socket.recv(size - len(found))
            assert part, "the bridge ended the connection"
            found += part
        return found

    def failure(self):
        """The sentence of FAIL, after which the connection ends."""
        while True:
            try:
                self.receive(b"STAT")
            except FailError as refused:
                assert self.socket.recv(1) == b""
                return str(refused)

    def open(self, points=1, rate=float(RATE)):
        self.send(b"OPEN", struct.pack("<IId", points, 0, rate))
        return struct.unpack("<d", self.receive(b"OPEN"))[0]

    def foci(self, samples):
        self.send(b"FOCI", np.asarray(samples, "<f4").tobytes())

    def state(self, request=b"PING"):
        self.send(request)
        return State(*struct.unpack("<8Qf", self.receive(b"STAT")))

    def wait(self, is_reached):
        """The first state that is as asked for."""
        for _ in range(4000):
            state = self.state()
            if is_reached(state):
                return state
            time.sleep(0.002)
        raise AssertionError(f"not reached: {state}")

    def stream(self, samples, block=400, ahead=8000):
        """Send samples in blocks, never with more than `ahead` of them waiting."""
        for first in range(0, len(samples), block):
            self.wait(lambda state: state.waiting < ahead)
            self.foci(samples[first : first + block])

    def play_out(self, samples, **how):
        """Stream samples, and wait until the last one was played."""
        self.stream(samples, **how)
        return self.wait(lambda state: state.waiting == 0 and state.intensity == 0)


def unlike_samples(count, points=1, seed=0):
    """Samples of which no two are equal, each point audible: x tells the number, the rest is random."""
    random = np.random.default_rng(seed)
    samples = random.uniform(0.01, 0.2, (count, points, 4)).astype("<f4")
    samples[:, :, 0] = np.arange(count)[:, None] / 2**20 + np.arange(points) / 2**23  # exact in float32
    samples[:, :, 3] = random.uniform(0.1, 1, (count, points))
    return samples


def recorded(name, points=1, start=1):
    """Times [s], and points, of each device sample since a start of the fake array."""
    row = np.dtype([("time", "<f8"), ("points", "<f4", (points, 4))])
    rows = np.fromfile(f"{name}.{start}", row)
    return rows["time"], rows["points"]


def numbers_of(points, sent):
    """The number of the sample that each device sample has: -1 if it is silent, -2 if it is none that was sent."""
    numbers = {sample.tobytes(): number for number, sample in enumerate(np.asarray(sent, "<f4"))}
    is_silent = (points[:, :, 3] == 0).all(axis=1)
    return np.array(
        [-1 if silent else numbers.get(row.tobytes(), -2) for silent, row in zip(is_silent, points, strict=True)]
    )


def held_numbers(rate, device_rate, device_samples, tie):
    """The number of the sample that each device sample must have, by the page's rule, in exact fractions.

    A sample may be due in the very middle between two device samples; `tie`, -1 or 1, says which of them gets it.
    """
    step = Fraction(rate) / Fraction(device_rate)
    return [int((m + Fraction(1, 2) + Fraction(tie, 10**6)) * step) for m in range(device_samples)]


class Comparison(NamedTuple):
    """What was recorded beside what was sent; the last two: whether there was silence before and after."""

    sent: int
    recorded: int
    wrong: int
    twice: int
    lost: int
    before: bool
    after: bool


def compare(points, sent):
    """Samples by number: those that returned after another, and those that never sounded."""
    numbers = numbers_of(points, sent)
    sounding = numbers[numbers != -1]
    runs = sounding[np.flatnonzero(np.diff(sounding, prepend=-9))]
    played, times = np.unique(runs[runs >= 0], return_counts=True)
    assert (np.diff(runs[runs >= 0]) > 0).all() or (times > 1).any()  # in order, unless one came twice
    wrong = int((sounding == -2).sum())
    ends = bool(numbers[0] == -1), bool(numbers[-1] == -1)
    return Comparison(len(sent), len(played), wrong, int((times - 1).sum()), len(sent) - len(played), *ends)


def focus_file(samples, rate, *, magic=b"PALPATEF", version=1, count=None):
    """Bytes of a file of focal points (docs/formats/focal-points.md)."""
    count = len(samples) if count is None else count
    header = struct.pack("<8sIIdQ", magic, version, samples.shape[1], rate, count)
    return header + np.asarray(samples, "<f4").tobytes()
