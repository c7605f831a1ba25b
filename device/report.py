"""What a playback was, and what it is while it lasts."""

from __future__ import annotations

from dataclasses import asdict, dataclass

UNDERRUN_EVENTS_MAX = 1000
"""Underruns kept one by one in a report; all are counted."""


@dataclass(frozen=True)
class Underrun:
    """A moment at which the player was late, by its own estimate.

    >>> import time
    >>> from palpate.device import EmulatorBackend, Player, VirtualClock, array_model, open_link
    >>> bus, frames = EmulatorBackend(clock=VirtualClock()), bytes([255] * 512) * 1000  # 0.1 s, every transducer on
    >>> def blocks():
    ...     yield frames
    ...     while bus.board().bytes_received < len(frames):
    ...         time.sleep(1e-3)
    ...     bus.clock.advance(1)  # what makes the next frames takes a second
    ...     yield frames
    >>> with open_link(array_model("emulator"), backend=bus) as link:
    ...     report = Player(link).play(blocks(), update_rate=10e3)
    >>> [(event.frame, event.time, round(event.duration, 3)) for event in report.underrun_events]
    [(1000, 1.0, 0.9)]
    """

    time: float
    """When the late frame was submitted [s], counted from the first submit."""
    frame: int
    """Number of that frame, from 0."""
    duration: float
    """How long the array had been without a new frame by then [s]."""
    submitted_ns: int
    """When it was submitted, on `PlayReport.clock` [ns]."""
    taken_ns: int | None
    """When the player saw that the array had taken it [ns]; None if it never did."""


@dataclass(frozen=True)
class Lateness:
    """How far behind its timetable the array played, by the player's estimate: frame k is due k periods after frame 0.

    Percentiles over all frames submitted [s]. Each time without a new frame puts off all frames after it.

    >>> from palpate.device import Player, VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     Player(link).play([bytes([255] * 512) * 1600], update_rate=10e3).lateness  # in time
    Lateness(p50=0.0, p99=0.0, p999=0.0, max=0.0)
    """

    p50: float
    p99: float
    p999: float
    max: float


@dataclass(frozen=True)
class QueueDepth:
    """Bytes under way on the host's side at submits, once the array made the host wait; 0 if "sync".

    >>> from palpate.device import Player, VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:  # 2048 frames fill it
    ...     report = Player(link).play([bytes([255] * 512) * 3000], update_rate=10e3)
    >>> report.transport, report.queue_depth
    ('sync', QueueDepth(min=0, mean=0.0))
    """

    min: int
    mean: float


@dataclass(frozen=True)
class LiveStatistics:
    """A playback under way, for a line in a terminal.

    >>> from palpate.device import Player, VirtualClock, array_model, open_link
    >>> seen = []
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     report = Player(link).play([bytes([255] * 512) * 100], update_rate=10e3, watch=seen.append)
    >>> seen[-1].frames, seen[-1].underruns
    (100, 0)
    """

    frames: int
    """Whole frames of content that the array is known to have taken."""
    elapsed: float
    """Time since the first submit [s]."""
    queue_bytes: int
    """Bytes under way on the host's side at the last submit."""
    underruns: int
    """The player's estimate, as in `PlayReport`."""
    starved: float
    """The player's estimate of the time without a new frame [s]."""
    lateness: float
    """How far behind its timetable the array is [s]."""


@dataclass(frozen=True)
class PlayReport:
    """Statistics of one playback. Fields that only the board knows are None where it could not be asked.

    >>> from palpate.device import Player, VirtualClock, array_model, open_link
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     report = Player(link).play([bytes([255] * 512) * 100], update_rate=10e3)  # every transducer at full drive
    >>> report
    PlayReport(emulator EMU0001: 100 frames at 10000 Hz, 0 underruns, off)
    >>> report.duration, report.duty, report.stopped_by, report.may_emit
    (0.01, 1.0, 'end', False)
    """

    array: str
    """Name of the array."""
    serial: str | None
    """Its serial number."""
    clock: str
    """Clock of the times here: "monotonic" is real time."""
    transport: str
    """How the bytes went: "sync" (blocking writes), "queued" (several transfers under way), or a board's own way."""
    stopped_by: str
    """"end", "stop", "limit" (of `Limits`), "exception" (in the blocks), "device" (its failure), "exit" (of the
    interpreter), or the name of a signal."""
    frames: int
    """Whole frames of content that the array took, without the off frames."""
    frames_exact: bool
    """Whether `frames` and `bytes` are all that it took; else more may be: a blocking write failed, and the board never
    answers, or is gone."""
    frames_cleared: int | None
    """How many of these a stop cleared before they were played; None: it is not known."""
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
    silenced: float
    """Time amid the content in which the array was silent, because its board had to begin anew after a pause [s]."""
    underrun_events: tuple[Underrun, ...]
    """The first of them, at most UNDERRUN_EVENTS_MAX."""
    lateness: Lateness
    """The player's estimate of how late frames were."""
    queue_depth: QueueDepth | None
    """What was under way; None if the array never made the host wait, so the queue never filled."""
    on_time: float
    """Longest time of emission without a pause of `Limits.pause_min` [s], also from playbacks before this one."""
    duty: float
    """Mean duty of the frames submitted: 1 is every transducer at full drive."""
    board_underruns: int | None
    """The board's own count of times at which it ran dry."""
    board_starved: float | None
    """The board's own time without a new frame [s]."""
    short_writes: int
    """Transfers that took less than was offered, or nothing, and were continued."""
    off_sent: bool
    """The array took all off frames."""
    off_after: float | None
    """Time from the end of the content, or from a stop, until the array had taken all off frames [s]; what it held then
    played before them. None if it did not take them. A pat16 whose count of bytes was lost takes 1.3 s for them."""
    off_confirmed: bool | None
    """The board said that it is silent; None from a board that never answers, or whose driver does not say. If False,
    it may still be emitting."""

    def __repr__(self) -> str:
        """One line: what was played, and what disturbed it."""
        off = {True: "off", False: "not off", None: "off unknown"}[self.off_confirmed]
        return (
            f"PlayReport({self.array} {self.serial}: {self.frames} frames at {self.update_rate:g} Hz, "
            f"{self.underruns} underrun{'s' * (self.underruns != 1)}, {off})"
        )

    @property
    def may_emit(self) -> bool | None:
        """Whether the array may still be emitting, as far as that is known.

        | off_confirmed | off_sent | |
        |---|---|---|
        | True | | False: the board said that it is silent |
        | False | | True: it did not |
        | None | False | True: it has not taken the off frames |
        | None | True | None, not known: it has taken them, and does not say more |
        """
        if self.off_confirmed is not None:
            return not self.off_confirmed
        return None if self.off_sent else True

    @property
    def off_doubt(self) -> str | None:
        """A sentence on why the array may not be off although no error says so; None where it said that it is."""
        if self.may_emit is False:
            return None
        if self.may_emit:
            return f"array {self.array} may still be emitting: switch it off"
        if self.board_underruns is not None:  # something answers for it
            return (
                f"array {self.array} was handed silence through its driver, which does not say whether the array is "
                "silent"
            )
        return (
            f"array {self.array} took the off frames and never answers: it is off if no byte was lost on the way to it "
            "and its firmware is the one that docs/guide/boards.md names"
        )

    @property
    def is_late(self) -> bool:
        """Whether the array ran dry or frames were late, by the player's estimate or the board's own count."""
        return bool(self.underruns or self.lateness.max or self.board_underruns)

    def as_dict(self) -> dict[str, object]:
        """Everything, as JSON takes it."""
        return {**asdict(self), "may_emit": self.may_emit, "off_doubt": self.off_doubt}
