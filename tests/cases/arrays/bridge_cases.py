"""Messages of docs/formats/ultraleap-bridge.md, by `struct` alone, and a bridge that does as a script says."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
from collections.abc import Callable

import numpy as np

from palpate.device.boards.stratos.model import BridgeModel
from palpate.device.clock import MonotonicClock

STATUS_FIELDS = ("taken", "begun", "passed", "dropped", "dry", "dry_samples", "missed", "device_samples")
TIMEOUT = 10.0
"""[s] after which a script that waits gives up, so that a faulty link ends a test."""


def message(name: str, content: bytes = b"") -> bytes:
    return struct.pack("<4sI", name.encode(), len(content)) + content


def messages(data: bytes) -> list[tuple[str, bytes]]:
    """What bytes say; they must end with a message."""
    found: list[tuple[str, bytes]] = []
    while data:
        name, size = struct.unpack_from("<4sI", data)
        assert len(data) >= 8 + size, "ends within a message"
        found.append((name.decode(), data[8 : 8 + size]))
        data = data[8 + size :]
    return found


HELLO = message("HELO", b"PALPATEU" + struct.pack("<I", 1))


def opening(points: int = 1, rate: float = 40e3) -> bytes:
    return message("OPEN", struct.pack("<IId", points, 0, rate))


def greeting(*, version: int = 1, capacity: int = 4096, points: int = 8, about: str = "3.0\nUSX:7\nUSX") -> bytes:
    return message("HELO", b"PALPATEU" + struct.pack("<IIII", version, capacity, points, 0) + about.encode())


def status(
    taken: int = 0, begun: int = 0, passed: int = 0, dropped: int = 0, *, intensity: float = 0.0, **others: int
) -> bytes:
    counts = {"taken": taken, "begun": begun, "passed": passed, "dropped": dropped, **others}
    return message("STAT", struct.pack("<8Qf", *(counts.get(name, 0) for name in STATUS_FIELDS), intensity))


def counts_of(content: bytes) -> dict[str, float]:
    *counts, intensity = struct.unpack("<8Qf", content)
    return {**dict(zip(STATUS_FIELDS, counts, strict=True)), "intensity": intensity}


def samples(count: int, points: int = 1, seed: int = 0) -> np.ndarray:
    """Focal points 10 to 30 cm above the array, all of them sounding: float32, shape [sample, point, 4]."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-0.1, -0.1, 0.1], [0.1, 0.1, 0.3], (count, points, 3))
    return np.concatenate([place, rng.uniform(0.1, 1, (count, points, 1))], axis=2).astype("<f4")


class Peer:
    """The bridge's end of a connection, for a script."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.connection.settimeout(TIMEOUT)
        self.unread = b""

    def take(self, name: str | None = None) -> tuple[str, bytes]:
        """The next message, of that name if one is given."""
        while len(self.unread) < 8 or len(self.unread) < 8 + struct.unpack_from("<I", self.unread, 4)[0]:
            data = self.connection.recv(1 << 16)
            if not data:
                raise EOFError
            self.unread += data
        size = struct.unpack_from("<I", self.unread, 4)[0]
        found, content = self.unread[:4].decode(), self.unread[8 : 8 + size]
        self.unread = self.unread[8 + size :]
        assert name in (None, found), f"{found} instead of {name}"
        return found, content

    def give(self, data: bytes, *, piece: int | None = None) -> None:
        """Send bytes, at once or in pieces of so many."""
        for first in range(0, len(data), piece or len(data) or 1):
            self.connection.sendall(data[first : first + (piece or len(data))])

    def until_left(self) -> None:
        """Read until the other end closes the connection."""
        with contextlib.suppress(ConnectionError):
            while self.connection.recv(1 << 16):
                pass

    def greet(self, **fields: object) -> None:
        """Answer HELO and OPEN."""
        self.take("HELO")
        self.give(greeting(**fields))
        _, content = self.take("OPEN")
        self.give(message("OPEN", content[8:]))


class ScriptedBridge:
    """Listens at a port of this machine, takes one client, and does with it what a script says.

    `errors` holds what the script raised; leaving the context closes the port and waits for the script.
    """

    def __init__(self, script: Callable[[Peer], object]) -> None:
        self._script = script
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(TIMEOUT)
        self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
        self.errors: list[BaseException] = []
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> ScriptedBridge:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.join(TIMEOUT)
        self._listener.close()
        assert not self._thread.is_alive(), "the script has not ended"
        assert self.errors == []

    def _run(self) -> None:
        try:
            connection, _ = self._listener.accept()
            with connection:
                self._script(Peer(connection))
        except BaseException as error:
            self.errors.append(error)


class PlayingBridge:
    """A script that plays what it is sent at once: `samples` has it, in order; `heard` the names of all messages.

    fails_after: refuse what comes once so many samples have been taken.
    """

    def __init__(self, *, fails_after: int | None = None, refusal: str = "no array any more") -> None:
        self.samples = b""
        self.heard: list[str] = []
        self._size = 16
        self._fails_after, self._refusal = fails_after, refusal

    def __call__(self, peer: Peer) -> None:
        peer.take("HELO")
        peer.give(greeting())
        taken = 0
        while True:
            try:
                name, content = peer.take()
            except (EOFError, ConnectionError):
                return
            self.heard.append(name)
            if name == "OPEN":
                self._size, taken = 16 * struct.unpack_from("<I", content)[0], 0
                peer.give(message("OPEN", content[8:]))
            elif name == "FOCI":
                self.samples += content
                taken += len(content) // self._size
                if self._fails_after is not None and taken >= self._fails_after:
                    peer.give(message("FAIL", self._refusal.encode()))
                    return
            else:
                peer.give(status(taken, begun=taken))


class ServedModel:
    """A script that has a model of the bridge behind a port: `played` is what it was handed, in order."""

    def __init__(self) -> None:
        self.model = BridgeModel(MonotonicClock(), "USX:9", record=1 << 20)

    @property
    def played(self) -> list[bytes]:
        return [sample for sample, _ in self.model.played]

    def __call__(self, peer: Peer) -> None:
        stays = True
        try:
            while stays and (data := peer.connection.recv(1 << 16)):
                answers, stays = self.model.receive(data)
                peer.give(answers)
        except ConnectionError:
            pass  # a client that is killed
        self.model.leave()
