"""The array under acceptance: opened, played to, unplugged and found again; an emulated one on one bus all along."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from types import TracebackType
from typing import Self

from ...device.array_kind import Emulation
from ...device.errors import DeviceError, DeviceNotFoundError, LinkError, PlayInterrupted
from ...device.link import Link
from ...device.playing.player import Player
from ...device.registry import kind_of
from ...device.report import PlayReport
from ..playback.file_playback import CLOCKS, Connection, emulated_bus, require_watchable
from ..playback.placed_arrays import PlacedArray
from ..terminal import console
from .frames import FeltStimulus
from .question import Step

Note = Callable[[str], object]
"""Shows a line to the person."""

PAUSE = 1.0  # [s] of silence before each stimulus: a pause by `Limits`, and time to look up
SETTLING = 1.5  # [s] from finding an array that was plugged in: a pat16 takes frames 1 s after its power is on
PATIENCE = 120.0  # [s] for plugging it in again
RETRY = 0.5  # [s]
AFTER_STOP = 5.0  # [s] of content beyond a stop
UNPLUGGED_AFTER = 1.0  # [s] of content after which an emulated plug is pulled


class BoardSession:
    """One array, opened when its context is entered, closed when it is left; its limits hold across all steps.

    Raises StrategyError for a watchdog of an emulated array, and whatever `Connection.open` raises.
    """

    def __init__(self, placed: PlacedArray, connection: Connection, note: Note) -> None:
        model = placed.model
        self.model = model
        self.emulated = model.embedded or connection.emulate
        self._bus: Emulation | None = None
        if self.emulated and not kind_of(model).emulates_itself:
            if connection.watchdog:
                require_watchable(model, emulated=True)
            self._bus = emulated_bus(placed, CLOCKS[connection.clock]())
            connection = replace(connection, backend=self._bus)
        self._placed, self._connection, self._note = placed, connection, note
        self._stack = ExitStack()
        self._playing: tuple[Link, Player] | None = None

    def __enter__(self) -> Self:
        """Open the array and silence it."""
        self._open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close it."""
        self._stack.close()

    @property
    def link(self) -> Link:
        """The opened array."""
        return self._link_and_player[0]

    @property
    def _link_and_player(self) -> tuple[Link, Player]:
        """Both, while the array is opened; else DeviceNotFoundError."""
        if self._playing is None:
            raise DeviceNotFoundError(f"array {self.model.name} is not opened")
        return self._playing

    def play(self, step: Step, log: list[dict[str, object]]) -> None:
        """Play what a step asks for, adding to a log what was played, also if it fails.

        Raises PlayInterrupted, DeviceError: as `Player.play`, but not for the failure that a pulled plug is to make.
        """
        if step.act == "replug":
            self._reopen()
        for stimulus in step.stimuli:
            try:
                self._play_one(stimulus, step, log)
            except LinkError:
                if step.act != "unplug":
                    raise
                self._note(f"The program says: {log[-1]['error']}.")

    def _play_one(self, stimulus: FeltStimulus, step: Step, log: list[dict[str, object]]) -> None:
        entry: dict[str, object] = {"parameters": stimulus.parameters(self.model), "report": None, "error": None}
        log.append(entry)
        link, player = self._link_and_player
        clock = link.clock
        clock.sleep_until_ns(clock.now_ns() + round(PAUSE * 1e9))
        stops: list[int] = []
        blocks = self._blocks(stimulus, step, stops)
        self._note(f"It plays ({len(log)}).")
        try:
            report = player.play(blocks, update_rate=stimulus.update_rate(self.model))
        except (DeviceError, PlayInterrupted) as error:
            failed = getattr(error, "report", None)
            entry |= {"error": str(error), "report": None if failed is None else failed.as_dict()}
            raise
        ended_ns = clock.now_ns()
        self._note(f"{'It was stopped' if stops else 'Now it has ended'}: {console.off_state(report)}.")
        entry |= {"report": report.as_dict(), "stopped_within": (ended_ns - stops[0]) * 1e-9 if stops else None}
        self._note(counters(report, stimulus.frame_count(self.model), stopped=bool(stops)))

    def _blocks(self, stimulus: FeltStimulus, step: Step, stops: list[int]) -> Iterator[array[int]]:
        """Wire bytes of a stimulus; what the step does in the middle happens while they are taken."""
        if step.act == "stop":
            yield from stimulus.blocks(self.model)
            self._note("Now it is stopped.")
            stops.append(self.link.clock.now_ns())
            self._link_and_player[1].stop()
            yield from replace(stimulus, seconds=AFTER_STOP).blocks(self.model)
        elif step.act == "unplug" and self._bus is not None:
            yield from replace(stimulus, seconds=UNPLUGGED_AFTER).blocks(self.model)
            self._bus.unplug()
            yield from stimulus.blocks(self.model)
        else:
            yield from stimulus.blocks(self.model)

    def _open(self) -> None:
        try:
            (link,) = self._stack.enter_context(self._connection.all_of([self._placed]))
            link.start(link.array.divider_default)  # opening sends nothing, so what a killed player left would play on
        except BaseException:
            self._stack.close()  # else it would be busy when it is opened again
            raise
        self._playing = link, Player(link)

    def _reopen(self) -> None:
        """Close the array, and open it once it is found again, however long a person takes, up to `PATIENCE`."""
        clock = self.link.clock
        self._playing = None
        self._stack.close()
        if self._bus is not None:
            self._bus.unplug()
            self._bus.replug()
        deadline_ns = clock.now_ns() + round(PATIENCE * 1e9)
        self._note(f"Waiting for the array, up to {PATIENCE:g} s: plug it in.")
        while self._playing is None:
            try:
                self._open()
            except LinkError:  # not there yet, or its files do not belong to this user yet
                if clock.now_ns() > deadline_ns:
                    raise
                clock.sleep_until_ns(clock.now_ns() + round(RETRY * 1e9))
        self._note("It is found.")
        clock.sleep_until_ns(clock.now_ns() + round(SETTLING * 1e9))


def counters(report: PlayReport, frame_count: int, *, stopped: bool) -> str:
    """The counters of a playback as one line."""
    of = "" if stopped else f" of {frame_count}"
    board = "" if report.board_underruns is None else f" ({report.board_underruns} by the board's own count)"
    return (
        f"Counters: {report.frames} frames{of} at {report.update_rate:g} Hz, {report.underruns} underruns{board}, "
        f"{report.starved:.3g} s starved, {report.lateness.max * 1e3:.3g} ms late at most."
    )
