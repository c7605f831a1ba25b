"""What a player needs of the way to an array."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from .array import ArrayModel
from .clock import Clock


@dataclass(frozen=True)
class BoardStatus:
    """What a board says of itself; the counts run from its power-up."""

    frames_played: int
    underruns: int
    starved_periods: int
    """Frame periods in which it had no new frame while emitting."""
    fifo_frames: int
    """Whole frames that are queued."""
    torn_bytes: int
    """Bytes of a frame whose rest is missing."""
    level: int
    """Highest level in the frame that is playing; 0 is silence."""
    divider: int


class Link(Protocol):
    """A way to one array. Errors are `LinkError`s; every call ends within a bounded time."""

    @property
    def array(self) -> ArrayModel:
        """The array at the other end."""
        ...

    @property
    def serial(self) -> str | None:
        """Its serial number."""
        ...

    @property
    def clock(self) -> Clock:
        """The clock that the array runs by, as far as the host has it."""
        ...

    @property
    def bytes_sent(self) -> int:
        """Bytes that the array is known to have taken since the link was opened."""
        ...

    @property
    def short_writes(self) -> int:
        """Transfers since then that took less than was offered."""
        ...

    def set_divider(self, divider: int) -> None:
        """Set the update rate to carrier / divider."""
        ...

    def write(self, data: array[int], *, abandon: Callable[[], bool]) -> int:
        """Send all bytes, or stop in between once `abandon()` holds; returns how many were taken."""
        ...

    def status(self) -> BoardStatus:
        """Ask the board."""
        ...

    def clear(self) -> None:
        """Drop the whole frames that are queued."""
        ...

    def send_off(self) -> None:
        """Complete a torn frame, its missing part silent, then queue the off frame."""
        ...
