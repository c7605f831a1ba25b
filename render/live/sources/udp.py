"""Poses by UDP, in JSON; docs/formats/live-poses.md describes it.

A datagram is one frame of the tracker: all hands that it sees, or none. What cannot be read is reported with its reason
and left out.
"""

import math
import re
import socket
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ....datasets.hand_model.joints import JOINT_COUNT
from ....datasets.json_text import parse_json
from ....datasets.rigid import Numbers
from ...errors import StrategyError
from .hand_frame import OWN, Seen, SeenHand, SourceFault

HOST, PORT = "127.0.0.1", 5005
DATAGRAM_BYTES = 65536
HANDS_MOST = 8
SIDES = (None, "left", "right")
_BURST = 4  # of more datagrams than these at a time, the newest are read
_FLOOD = 3  # readings one after the other that left datagrams out: one alone is that of a machine that was busy
_ROUND = 1e-3  # [s] between two readings of the socket, so that a flood costs little
_ADDRESS = re.compile(r"(?:(?P<host>.*):)?(?P<port>[0-9]+)")


KNOWN_ENTRIES = frozenset({"time", "side", "id", "palm", "joints", "radius", "hands"})


class DatagramError(ValueError):
    """A datagram that cannot be read."""

    @property
    def kind(self) -> str:
        """What is wrong, without the values."""
        return re.sub(r"[0-9]+", "", str(self).split(", not", 1)[0].split(":", 1)[0])


def frames_of(data: bytes) -> SeenHand | list[SeenHand]:
    """All hands of a datagram, or a frame without hand; a single one is of a JSON object without `hands`.

    Raises DatagramError.
    """
    try:
        content = parse_json(data, allow_nan=True)
    except ValueError as error:
        raise DatagramError(f"a datagram is no JSON: {error}") from None
    if not isinstance(content, dict):
        raise DatagramError("a datagram must be one JSON object")
    at = _number(content.get("time"), "time")
    if "hands" not in content:
        return _json_hand(content, at)
    listed = content["hands"]
    if not isinstance(listed, list) or len(listed) > HANDS_MOST:
        raise DatagramError(f"hands: must be a list of at most {HANDS_MOST}, not {listed!r:.60}")
    frames = [_json_hand(hand, at) for hand in listed]
    return [frame for frame in frames if not frame.is_lost] or [SeenHand(at)]


@dataclass
class UdpSource:
    """Receives frames at an address.

    host: of this machine; 127.0.0.1 takes datagrams of this machine alone, 0.0.0.0 those of anybody who can reach it.
    """

    host: str = HOST
    port: int = PORT
    clock: str = OWN
    _socket: socket.socket | None = field(default=None, repr=False)

    @classmethod
    def at(cls, address: str) -> Self:
        """The source at `HOST:PORT`, `PORT` or, for an empty text, the default; raises StrategyError."""
        found = _ADDRESS.fullmatch(address or str(PORT))
        if not found or not 0 <= int(found["port"]) <= 65535:
            raise StrategyError(f"the address for UDP must be HOST:PORT with a port of 0..65535, not {address!r:.60}")
        return cls((found["host"] or HOST).strip("[]"), int(found["port"]))

    def __enter__(self) -> Self:
        """Bind the address; raises OSError where it is taken or not of this machine."""
        kind, _, _, _, address = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_DGRAM)[0]
        opened = socket.socket(kind, socket.SOCK_DGRAM)
        try:
            opened.bind(address)
        except OSError as error:
            opened.close()
            raise OSError(error.errno, f"cannot listen at {self.host}:{self.port}: {error.strerror}") from None
        self.port = opened.getsockname()[1]
        self._socket = opened
        return self

    def __exit__(self, *_: object) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def __iter__(self) -> Iterator[Seen]:
        """Frames and faults as they come, for ever."""
        if self._socket is None:
            raise RuntimeError("UdpSource is iterated over inside its `with`")
        ready, floods = 0.0, 0
        while True:
            time.sleep(max(ready - time.monotonic(), 0.0))
            data, left_out = _newest(self._socket)
            ready = time.monotonic() + _ROUND if len(data) == _BURST else 0.0
            floods = floods + 1 if left_out else 0
            if left_out:
                text = f"more than {_BURST} datagrams came at a time, again and again: the newest {_BURST} are read"
                yield SourceFault("flood", text if floods >= _FLOOD else "", left_out)
            for one in data:
                try:
                    yield frames_of(one)
                except DatagramError as error:
                    yield SourceFault(error.kind, str(error))


def _newest(opened: socket.socket) -> tuple[list[bytes], int]:
    """Wait for a datagram; the newest that are there, oldest first, and how many older ones were left out."""
    opened.setblocking(True)
    found = deque([opened.recv(DATAGRAM_BYTES)], _BURST)
    count = 1
    opened.setblocking(False)
    try:
        while count < 4096:
            found.append(opened.recv(DATAGRAM_BYTES))
            count += 1
    except BlockingIOError:
        pass
    return list(found), count - len(found)


def _json_hand(hand: Any, at: float) -> SeenHand:
    if not isinstance(hand, dict):
        raise DatagramError(f"hands: each must be an object, not {hand!r:.60}")
    side, hand_id = hand.get("side"), hand.get("id", "")
    if side not in SIDES:
        raise DatagramError(f"side: must be left or right, not {side!r:.60}")
    if isinstance(hand_id, bool) or not isinstance(hand_id, str | int):
        raise DatagramError(f"id: must be a text or a whole number, not {hand_id!r:.60}")
    palm, joints, radius = (hand.get(name) for name in ("palm", "joints", "radius"))
    if palm is None and joints is None and (unknown := sorted(set(hand) - KNOWN_ENTRIES)):
        raise DatagramError(f"palm: neither it nor joints is there, but {unknown[0]!r:.60}, which means nothing here")
    return SeenHand(
        at,
        side,
        str(hand_id),
        None if palm is None else _numbers(palm, "palm", (7,)),
        None if joints is None else _numbers(joints, "joints", (JOINT_COUNT, 7)),
        None if radius is None else _numbers(radius, "radius", (JOINT_COUNT,)),
    )


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DatagramError(f"{name}: must be a number, not {value!r:.60}")
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _numbers(value: Any, name: str, shape: tuple[int, ...]) -> Numbers:
    """Numbers of a shape; null, a joint that is null and NaN are unknown."""
    if len(shape) == 2 and isinstance(value, list):
        value = [[None] * shape[1] if row is None else row for row in value]
    try:
        found = np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DatagramError(f"{name}: must be numbers of shape {list(shape)}, not {value!r:.60}") from None
    if found.shape != shape:
        raise DatagramError(f"{name}: must have shape {list(shape)}, not {list(found.shape)}")
    return found
