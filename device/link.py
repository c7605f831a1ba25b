"""What a player needs of the way to an array, whatever the board."""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Literal, Self

from .array import ArrayModel
from .clock import Clock

TransportKind = Literal["auto", "sync", "queued"]
"""How bytes go to a USB endpoint: by blocking writes, or several transfers under way; "auto" queues through libusb."""


def never() -> bool:
    """An `abandon` that never holds."""
    return False


@dataclass(frozen=True)
class BoardStatus:
    """What a board says of itself; the counts run from its power-up.

    >>> from array import array
    >>> from palpate.device import VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     link.start(4)  # 10 kHz
    ...     link.write(array("B", bytes([255] * 512) * 30))  # 30 frames, every transducer on
    ...     link.status()  # they wait in its FIFO, as no time has passed
    BoardStatus(frames_played=0, underruns=0, starved_periods=0, fifo_frames=30, torn_bytes=0, level=0, divider=4)
    """

    frames_played: int
    underruns: int
    starved_periods: int
    """Frame periods in which it had no new frame while emitting."""
    fifo_frames: int
    """Whole frames that are queued."""
    torn_bytes: int
    """Bytes of a frame whose rest is missing."""
    level: int | None
    """Highest level in the frame that is playing; 0 is silence. None: it cannot say, as a driver stands between."""
    divider: int


class Link(ABC):
    """A way to one array; a context manager that closes it. Errors are `LinkError`s; every call ends in bounded time.

    Not for several threads at once; a player uses it from one. `abandon` is asked at least every 50 ms while a call
    waits; once it holds, the call returns without having done all.

    >>> from palpate.device import Link, VirtualClock, array_model, open_link
    >>> link: Link = open_link(array_model("emulator"), clock=VirtualClock())
    >>> with link:
    ...     link.start(4)  # 40 kHz / 4: 10 kHz
    ...     link.send_off()
    ...     link.transport, link.bytes_sent  # blocking writes; one off frame
    ('sync', 512)
    """

    array: ArrayModel
    """The array at the other end."""
    serial: str | None
    """Its serial number."""
    clock: Clock
    """The clock that the array runs by, as far as the host has it."""
    off_frames: int = 1
    """How many frames `off_bytes` are: 1, or more where one could be missed."""

    def __repr__(self) -> str:
        """One line."""
        return f"{type(self).__name__}({self.array.name!r}, serial={self.serial!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    @property
    @abstractmethod
    def transport(self) -> str:
        """Name of the transport, for reports: "sync", "queued", or a board's own."""

    @property
    @abstractmethod
    def bytes_sent(self) -> int:
        """Bytes that the array is known to have taken since the link was opened, those that resynchronise it too."""

    @property
    @abstractmethod
    def bytes_under_way(self) -> int:
        """Bytes handed over by `write` whose fate is not known yet; looks for what has arrived in the meantime."""

    @property
    def queue_frames(self) -> int | None:
        """Frames that wait in the array's own queue, by its word of the last 20 ms; None: it is short, or says nothing.

        A writer that is paced by another clock than the array's leaves frames out where it grows.
        """
        return None

    @property
    def short_writes(self) -> int:
        """Transfers since the link was opened that took less than was offered, or nothing, and were continued."""
        return 0

    @property
    def is_exact(self) -> bool:
        """Whether `bytes_sent` is exact once nothing is under way; else it is a lower bound: a write failed."""
        return True

    @property
    @abstractmethod
    def off_bytes(self) -> bytes:
        """Wire bytes that end a content: the array is off once they have played."""

    @property
    def hold_ns(self) -> int:
        """How long what is written first after `start` waits in the board until it plays [ns]; 0 for most."""
        return 0

    @abstractmethod
    def start(self, divider: int) -> None:
        """Resynchronise, silence what a killed player left, set the update rate.

        Afterwards no frame is torn, and the array is silent. Raises `UpdateRateError` for a divider that it lacks.
        """

    def refresh(self) -> bool:
        """Make a board that forgets in a pause take whole frames again: True if that was needed, and took its time."""
        return False

    @abstractmethod
    def write(self, data: array[int], *, abandon: Callable[[], bool] = never) -> None:
        """Send whole frames: return once they are under way, or taken; wait while there is no room for them."""

    @abstractmethod
    def drain(self, *, abandon: Callable[[], bool] = never) -> bool:
        """Wait until nothing is under way; False if abandoned."""

    @abstractmethod
    def cancel(self) -> None:
        """End what is under way; then `bytes_sent` is exact, and the last frame may be torn."""

    def status(self) -> BoardStatus | None:
        """Ask the board; None from a board that never answers."""
        return None

    def clear(self) -> bool:
        """Drop the whole frames that are queued in the board; False if it cannot."""
        return False

    @abstractmethod
    def send_off(self) -> None:
        """Off now: cancel what is under way, complete a torn frame, its missing part silent, then `off_bytes`.

        A stall that an earlier call met is ended first, so that it may be tried again. Returns when the array has taken
        all of it; what its FIFO holds before the off frame still plays.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of the array; nothing happens if it is gone. What it plays, it goes on playing."""
