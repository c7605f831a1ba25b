"""The process of a paced writer: it opens the arrays, plays what it is told to, and switches them off at its end.

It is told, and tells, in messages of JSON through one socket. When the other end of the socket is closed, whatever for,
the arrays are switched off and the process ends.

| told | |
|---|---|
| `live` | play what comes through the ring from now on |
| `load` | frames of a stimulus: a path, and the doses of its slices |
| `play` | a stimulus, by its number, so many times |
| `stop` | nothing more: off frames, and the arrays stay open |
| `end` | off, and the end of the process |

| tells | |
|---|---|
| `ready` | the arrays are open and silent; how the process is scheduled |
| `began`, `ended` | of a stimulus, or of what comes through the ring: when its first frame was played |
| `poses` | numbers, stamps and times of the first frame of each pose that was played, a few times a second |
| `skipped` | first frame, count and why |
| `state` | counts, a few times a second |
| `warning` | a limit is near |
| `failed` | kind of the error and its sentence; the arrays are switched off |
| `off` | the last message: whether the arrays are off, and the counts |
"""

from __future__ import annotations

import json
import mmap
import os
import pickle
import select
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from ..array import ArrayModel
from ..array_kind import ArrayKind
from ..boards.discovery import emulated_bus, open_link
from ..clock import MonotonicClock
from ..errors import DeviceError
from ..link import Link, TransportKind
from ..playing.limits import Dose, Limits
from ..playing.watchdog import Watchdog
from ..registry import array_kinds, register_array
from ..silence import is_switched_off, wait_silent
from .paced_writer import PacedWriter, WriterPace
from .realtime import WRITER_PRIORITY, enter_realtime, stop_collecting
from .ring import DrawnContent, FrameRing, StoredContent

MESSAGE_MOST: Final = 1 << 17  # [byte]
_STATE_PERIOD: Final = 0.25  # [s]
_RECORDED_FRAMES: Final = 4096  # by a model of a board: 0.1 s at 40 kHz
_READY_NS: Final = 200_000  # from an order to play to the first frame
_SKIPS_MOST: Final = 256  # of a message
_LAST_WORD: Final = 2.0  # [s] that the other side has to make room for it
_NEAR: Final = 0.8  # part of a limit from which on it is warned of


@dataclass(frozen=True, kw_only=True)
class ArrayRequest:
    """One array of a writer, and how it is opened."""

    kind: ArrayKind
    model: ArrayModel
    serial: str | None = None
    emulated: bool = False
    uncalibrated: bool = False
    transport: TransportKind = "auto"
    watchdog: bool = False


@dataclass(frozen=True, kw_only=True)
class WriterSettings:
    """All that the process is started with."""

    arrays: tuple[ArrayRequest, ...]
    divider: int
    pace: WriterPace = field(default_factory=WriterPace)
    limits: Limits = field(default_factory=Limits)
    realtime: bool = True
    control_fd: int
    ring_fd: int
    wake_fd: int
    slice_frames: int
    """Frames of a slice at most."""


class _Process:
    """One run of the process."""

    def __init__(self, settings: WriterSettings) -> None:
        self._settings = settings
        self._control = socket.socket(fileno=settings.control_fd)
        self._control.setblocking(False)
        self._ring = FrameRing(
            [array.model.frame_bytes for array in settings.arrays],
            frame_count=settings.slice_frames,
            fd=settings.ring_fd,
        )
        self._links: list[Link] = []
        self._stimuli: list[tuple[list[memoryview], list[list[Dose]], int]] = []
        self._poses: list[tuple[int, int, int]] = []
        self._skipped: list[tuple[int, int, int]] = []
        self._untold: deque[bytes] = deque()
        self._state_at = 0.0
        self._near: set[str] = set()
        self._playing: int | None = None  # number of the stimulus
        self._awaits_onset = self._is_ending = False

    def run(self) -> None:
        """Open, play, and off on every way out."""
        with ExitStack() as stack:
            try:
                began_ns = self._open(stack)
                self._begin(began_ns)
                self._loop()
            except BaseException as error:  # whatever it is, the arrays are switched off, and the other side is told
                self._tell("failed", kind=type(error).__name__, text=str(error) or type(error).__name__)
            signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a second one would leave arrays on
            self._switch_off()

    def _open(self, stack: ExitStack) -> Callable[[int], int | None] | None:
        """Open and start all arrays; returns what tells when a frame of the first one began, if that is a model."""
        began_ns = None
        for request in self._settings.arrays:
            bus = None
            if request.emulated and not request.kind.emulates_itself:
                bus = emulated_bus(request.model, request.serial, MonotonicClock(), record=_RECORDED_FRAMES)
            link = open_link(
                request.model,
                serial=request.serial,
                backend=bus,
                transport=request.transport,
                uncalibrated=request.uncalibrated or request.emulated,
                emulated=request.emulated,
            )
            stack.callback(link.close)
            if request.watchdog:
                stack.enter_context(Watchdog(link))
            self._links.append(link)
            link.start(self._settings.divider)
            if bus is not None and len(self._links) == 1:
                began_ns = _numbered(bus)
        return began_ns

    def _begin(self, began_ns: Callable[[int], int | None] | None) -> None:
        settings = self._settings
        self._writer = PacedWriter(
            self._links,
            settings.divider,
            pace=settings.pace,
            limits=settings.limits,
            began_ns=began_ns,
            emitted=self._note_emission,
            skipped=lambda first, count, why: self._skipped.append((first, count, why)),
        )
        self._base = [link.status() for link in self._links]
        is_realtime = settings.realtime and enter_realtime(WRITER_PRIORITY, lock_memory=True)
        stop_collecting()
        self._tell(
            "ready",
            realtime=is_realtime,
            emission="estimate" if began_ns is None else "board",
            arrays=[
                {"array": link.array.name, "serial": link.serial, "transport": link.transport} for link in self._links
            ],
        )

    def _loop(self) -> None:
        control, wake = self._settings.control_fd, self._settings.wake_fd
        while not self._is_ending:
            next_ns = self._writer.step()
            was_playing, self._playing = self._playing, None if self._writer.is_idle else self._playing
            if was_playing is not None and self._playing is None:
                self._tell("ended", number=was_playing, **asdict(self._writer.tally))
            if (now := time.monotonic()) >= self._state_at:
                self._tell_state(now)
            wait = max(next_ns - time.monotonic_ns(), 0) * 1e-9
            ready, _, _ = select.select([control, wake], [], [], min(wait, _STATE_PERIOD))
            if wake in ready:
                os.eventfd_read(wake)
            if control in ready:
                self._obey()

    def _obey(self) -> None:
        """Do what the other side says; its end is the order to end."""
        while not self._is_ending:
            try:
                data = self._control.recv(MESSAGE_MOST)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._is_ending = True
                return
            message = json.loads(data)
            getattr(self, f"_do_{message.pop('do')}")(**message)

    def _do_live(self) -> None:
        while self._ring.take() is not None:  # of a run before
            self._ring.done()
        self._playing, self._awaits_onset = None, True
        self._writer.play(DrawnContent(self._ring))

    def _do_load(self, path: str, counts: list[int]) -> None:
        """A stimulus: frames of each array one behind the other, and their doses as (first on, last on, sum, last)."""
        with open(path, "rb") as file:
            mapped = memoryview(mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ))
        with open(f"{path}.doses", "rb") as file:
            doses = [[Dose(*row) for row in own] for own in json.load(file)]
        for name in (path, f"{path}.doses"):  # so that nothing is left where the other side is killed
            os.unlink(name)
        frames: list[memoryview] = []
        start = 0
        for size in counts:
            frames.append(mapped[start : start + size])
            start += size
        for block in frames:  # read now: a page fault would cost a deadline
            for place in range(0, len(block), mmap.PAGESIZE):
                _ = block[place]
        self._stimuli.append((frames, doses, self._settings.slice_frames))
        self._tell("loaded", number=len(self._stimuli) - 1)

    def _do_play(self, number: int, repeats: int = 1) -> None:
        frames, doses, slice_frames = self._stimuli[number]
        content = StoredContent(
            frames,
            [link.array.frame_bytes for link in self._links],
            doses,
            slice_frames=slice_frames,
            repeats=repeats,
            start_ns=max(self._links[0].clock.now_ns(), self._writer.dry_ns) + _READY_NS,
        )
        self._playing, self._awaits_onset = number, True
        self._writer.play(content)

    def _do_stop(self) -> None:
        self._writer.stop()

    def _do_end(self) -> None:
        self._is_ending = True

    def _note_emission(self, is_current: bool, number: int, stamp_ns: int, began_ns: int) -> None:
        if self._awaits_onset and is_current:  # the last poses of a content are often known when the next one plays
            self._awaits_onset = False
            self._tell("began", number=self._playing, onset_ns=began_ns)
        if self._playing is None:
            self._poses.append((number, stamp_ns, began_ns))

    def _tell_state(self, now: float) -> None:
        """Counts and news, a few times a second."""
        self._state_at = now + _STATE_PERIOD
        for name in ("poses", "skipped"):
            news = getattr(self, f"_{name}")
            while news:
                self._tell(name, rows=news[:_SKIPS_MOST])
                del news[:_SKIPS_MOST]
        self._tell("state", **asdict(self._writer.tally))
        self._tell_waiting()
        now_ns = self._links[0].clock.now_ns()
        for guard in self._writer.guards:
            for sentence in guard.near(now_ns, _NEAR):
                if (name := sentence.split()[0]) not in self._near:
                    self._near.add(name)
                    self._tell("warning", text=f"array {guard.model.name}: {sentence}")

    def _switch_off(self) -> None:
        """Off, whatever was before; then the last message."""
        outcomes: list[dict[str, Any]] = []
        for link in self._links:
            outcome: dict[str, Any] = {"array": link.array.name, "serial": link.serial}
            try:
                link.cancel()
                link.clear()
            except Exception:  # whatever one array does, the others are switched off, too
                pass  # what follows switches it off, or says that it may be on
            try:
                outcome["off_sent"] = is_switched_off(link)
                outcome["off_confirmed"] = wait_silent(link, self._settings.divider) if outcome["off_sent"] else False
            except Exception as error:
                outcome |= {"off_sent": False, "off_confirmed": False, "text": str(error)}
            outcomes.append(outcome)
        if hasattr(self, "_writer"):
            writer = self._writer
            for link, outcome, guard, base in zip(self._links, outcomes, writer.guards, self._base, strict=True):
                outcome["on_time"] = guard.on_time_ns * 1e-9
                outcome["board_underruns"] = None
                try:
                    status = link.status()
                except DeviceError:
                    continue
                if status is not None and base is not None:
                    outcome["board_underruns"] = status.underruns - base.underruns
            writer.report_emission()
            self._tell_state(time.monotonic())
            self._tell("off", arrays=outcomes, **asdict(writer.tally))
        else:
            self._tell("off", arrays=outcomes)
        self._control.settimeout(_LAST_WORD)
        self._tell_waiting()

    def _tell(self, event: str, **values: Any) -> None:
        """Tell the other side; while it has no room, all waits in order, but for counts, which come again."""
        if event != "state" or not self._untold:
            self._untold.append(json.dumps({"event": event, **values}).encode())
        self._tell_waiting()

    def _tell_waiting(self) -> None:
        while self._untold:
            try:
                self._control.send(self._untold[0])
            except BlockingIOError:
                return
            except OSError:  # nobody hears any more
                self._untold.clear()
                return
            self._untold.popleft()


def _numbered(bus: object) -> Callable[[int], int | None] | None:
    """When a frame of a model began, counted from now on; None for a model that does not tell."""
    board: Any = getattr(bus, "board", lambda: None)()
    if not hasattr(board, "began_ns"):
        return None
    first: int = board.frames_played
    return lambda number: board.began_ns(first + number)


def main() -> int:
    """Read the settings from standard input, and run."""
    for signum in (signal.SIGINT, signal.SIGHUP):  # the terminal's signals are for the process that started this one
        signal.signal(signum, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)
    # a pipe of our own, from the process that started this one
    kinds, settings = pickle.load(sys.stdin.buffer)
    for kind in kinds:
        if kind not in array_kinds():
            register_array(kind)
    _Process(settings).run()
    return 0


def _end(signum: int, frame: object) -> None:
    raise SystemExit(128 + signum)


if __name__ == "__main__":
    sys.exit(main())
