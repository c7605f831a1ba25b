"""What a playback was."""

from __future__ import annotations

from dataclasses import asdict, dataclass

UNDERRUN_EVENTS_MAX = 1000
"""Underruns kept one by one in a report; all are counted."""


@dataclass(frozen=True)
class Underrun:
    """A moment at which the player was late, by its own estimate."""

    time: float
    """When the late frame was submitted [s], counted from the first submit."""
    frame: int
    """Number of that frame, from 0."""
    duration: float
    """How long the array had been without a new frame by then [s]."""


@dataclass(frozen=True)
class PlayReport:
    """Statistics of one playback. Fields that only the board knows are None where it could not be asked."""

    array: str
    """Name of the array."""
    serial: str | None
    """Its serial number."""
    clock: str
    """Clock of the times here: "monotonic" is real time."""
    stopped_by: str
    """"end", "stop", "exception" (in the blocks), "device" (its failure), or the name of a signal."""
    frames: int
    """Whole frames of content that the array took, without the off frames."""
    frames_cleared: int | None
    """How many of these a stop cleared before they were played."""
    bytes: int
    """Bytes of content that the array took; a stop may tear the last frame."""
    update_rate: float
    """Frames a second [Hz]."""
    duration: float
    """Playing time of the frames that were played [s], without starved periods."""
    elapsed: float
    """Time from the first submit until the array was off, on `clock` [s]."""
    underruns: int
    """The player's estimate: submits that came after the frames before them had run out."""
    starved: float
    """The player's estimate of the time without a new frame [s]."""
    underrun_events: tuple[Underrun, ...]
    """The first of them, at most UNDERRUN_EVENTS_MAX."""
    board_underruns: int | None
    """The board's own count of times at which it ran dry."""
    board_starved: float | None
    """The board's own time without a new frame [s]."""
    short_writes: int
    """Transfers that took less than was offered, or nothing, and were continued."""
    off_confirmed: bool
    """The board said that it is silent. If not, it may still be emitting."""

    def as_dict(self) -> dict[str, object]:
        """Everything, as JSON takes it."""
        return asdict(self)
