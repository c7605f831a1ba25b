"""What the parent of a sweep and a worker in another process say to each other, and how it goes through a socket."""

import os
import pickle
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ..make.task import Outcome

HEAD = struct.Struct("!Q")  # length of a message


@dataclass(frozen=True)
class Assignment:
    """What a worker is to be: the first message that it receives."""

    index: int
    device: str
    work: str
    """`module:name` of a `Work`."""

    @property
    def name(self) -> str:
        """In sentences; asked for in the worker."""
        return worker_name(self.index, os.getpid(), self.device)


@dataclass(frozen=True)
class Ready:
    """The worker can do the work on a device, which is Warp's full name of it."""

    device: str


@dataclass(frozen=True)
class Unfit:
    """It cannot, and why."""

    error: str


@dataclass(frozen=True)
class Progress:
    """A sign of progress: chunks were begun, by their places in the task; None: the same ones go on."""

    places: tuple[int, ...] | None


@dataclass(frozen=True)
class Done:
    """The outcome of the task; the worker then ends if `is_last`."""

    outcome: Outcome
    is_last: bool


@dataclass(frozen=True)
class Warned:
    """A warning, for the user."""

    category: type[Warning]
    text: str


def worker_name(index: int, pid: int, device: str) -> str:
    """A worker in sentences and outcomes."""
    return f"worker {index} (pid {pid}, {device})"


def frame(message: object) -> bytes:
    """A message as it goes through the socket."""
    body = pickle.dumps(message)
    return HEAD.pack(len(body)) + body


class Frames:
    """Messages out of what arrives in any pieces."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def take(self, arrived: bytes) -> Iterator[Any]:
        """Messages that are whole now."""
        self._bytes += arrived
        while len(self._bytes) >= HEAD.size:
            end = HEAD.size + HEAD.unpack_from(self._bytes)[0]
            if len(self._bytes) < end:
                return
            body = bytes(self._bytes[HEAD.size : end])
            del self._bytes[:end]
            yield pickle.loads(body)
