"""Playing frames to an array: queued, watched, and off on every way out."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from array import array
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from types import TracebackType
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..array import ArrayModel
from ..codec import is_emitting
from ..errors import (
    DeviceBusyError,
    DeviceError,
    DeviceTimeoutError,
    FrameError,
    LinkError,
    PlayInterrupted,
    SafetyLimitError,
    UpdateRateError,
)
from ..link import Link
from ..report import LiveStatistics, PlayReport
from ..silence import is_switched_off
from .limits import Guard, Limits
from .signals import StopSignals
from .writer import Writer


def within_reach(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> Iterable[array[int]]:
    """Blocks of whole frames, which are refused before the first of them is played where that shows soon.

    A burst is gathered, and comes as one block, so that it is sent in one piece. Alternations of one pattern and off
    are looked at block by block, the first one at once.

    Raises `UpdateRateError`, here or from the blocks: they go beyond what the array plays at this divider.
    """
    if divider >= model.divider_sustained:
        return blocks
    if not model.alternates:
        return _burst(blocks, model, divider)
    alternating = _alternating(blocks, model, divider)
    return chain([block for block in (next(alternating, None),) if block is not None], alternating)


def _burst(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> list[array[int]]:
    gathered = array("B")
    for block in blocks:
        gathered += block
        if len(gathered) > model.burst_frames * model.frame_bytes:
            raise UpdateRateError(
                f"array {model.name} cannot keep up {model.update_rate(divider):g} Hz (divider {divider}): beyond "
                f"{model.burst_frames} frames it needs divider {model.divider_sustained} or more, which is "
                f"{model.update_rate(model.divider_sustained):.6g} Hz at most"
            )
    return [gathered] if gathered else []


def _alternating(blocks: Iterable[array[int]], model: ArrayModel, divider: int) -> Iterator[array[int]]:
    pattern: NDArray[np.uint8] | None = None
    first = 0
    for block in blocks:
        frames = np.frombuffer(block, np.uint8).reshape(-1, model.frame_bytes)
        on = np.flatnonzero(is_emitting(frames, array=model))
        if len(on):
            pattern = frames[on[0]].copy() if pattern is None else pattern
            other = on[(frames[on] != pattern).any(axis=1)]
            if len(other):
                raise UpdateRateError(
                    f"array {model.name} plays {model.update_rate(divider):g} Hz only as one pattern switched on and "
                    f"off, such as am of one focal point at rest (pace.kind 'still' at one pose), but frame "
                    f"{first + other[0]} has another pattern; it plays any frames at up to "
                    f"{model.update_rate(model.divider_sustained):.6g} Hz"
                )
        first += len(frames)
        yield block


SWITCH_INTERVAL: Final = 5e-4  # [s]


class PromptThreads:
    """While active, a thread that wants the interpreter's lock gets it after 0.5 ms instead of 5.

    The writer of a playback wants it once in the 5 ms of frames of a transfer or oftener, whatever else computes in
    the process. Several may be active at once; the last one restores what was before the first.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._active = 0
        self._before = 0.0

    def __enter__(self) -> None:
        with self._lock:
            self._active += 1
            if self._active == 1:
                self._before = sys.getswitchinterval()
                sys.setswitchinterval(min(self._before, SWITCH_INTERVAL))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        with self._lock:
            self._active -= 1
            if self._active == 0:
                sys.setswitchinterval(self._before)


PROMPT_THREADS: Final = PromptThreads()


Block: TypeAlias = "array[int] | bytes | bytearray | memoryview | NDArray[np.uint8]"
"""Wire bytes of whole frames. An array("B") is sent without a copy, so it must not be changed once handed over."""

QUEUE_BLOCKS = 8
WATCH_PERIOD = 0.1  # [s] between calls of `watch`


class Player:
    """Plays frames to one array.

    Args:
        link: the opened array. The player uses it, but does not close it.
        limits: bounds of on-time and duty; None takes the defaults of `Limits`. They hold across playbacks.
        queue_blocks: how many blocks wait for their turn. The first is sent when 80 ms of frames are ready, or as many
            blocks as that.
        handle_signals: switch the array off and raise `PlayInterrupted` on SIGINT, SIGTERM and SIGHUP, while playing.
            Python lets only the main thread do so; elsewhere it is the application's to call `stop`.

    >>> from palpate.device import Player, VirtualClock, array_model, encode_frames, open_link
    >>> frames = encode_frames([[0.0] * 256] * 100, [0.5] * 100)  # 100 frames, all in phase at half the pressure
    >>> with open_link(array_model("emulator"), clock=VirtualClock()) as link:
    ...     Player(link).play([frames], update_rate=10e3)
    PlayReport(emulator EMU0001: 100 frames at 10000 Hz, 0 underruns, off)
    """

    def __init__(
        self,
        link: Link,
        *,
        limits: Limits | None = None,
        queue_blocks: int = QUEUE_BLOCKS,
        handle_signals: bool = True,
    ) -> None:
        if queue_blocks < 1:
            raise ValueError(f"queue_blocks is {queue_blocks}, but at least 1 block must fit the queue")
        self.report: PlayReport | None = None
        """Statistics of the last playback, however it ended."""
        self._link = link
        self._guard = Guard(limits or Limits(), link.array)
        self._queue_blocks = queue_blocks
        self._handle_signals = handle_signals
        self._playing = threading.Lock()
        self._writer: Writer | None = None
        self._stop_reason: str | None = None

    def __repr__(self) -> str:
        """One line."""
        return f"Player({self._link!r})"

    def play(
        self,
        blocks: Iterable[Block],
        *,
        update_rate: float,
        progress: Callable[[int], object] | None = None,
        watch: Callable[[LiveStatistics], object] | None = None,
    ) -> PlayReport:
        """Play blocks until they end, and return when the array is off.

        The blocks are taken on the calling thread (where they are made), and sent on another one. A block that is the
        same array("B") as one of the last few costs neither a copy nor a look at its bytes: a short contour's loop.

        Args:
            blocks: wire bytes, each block a whole number of frames.
            update_rate: frames a second [Hz], one that the array has.
            progress: called on the calling thread, now and then, with the count of frames that the array has taken.
            watch: called on the calling thread, at most 10 times a second, with the statistics so far.

        Returns:
            The statistics.

        Raises:
            PlayInterrupted: a signal came; it carries the statistics.
            LinkError: the array failed; `report` holds the statistics. `DeviceLostError` if it is gone.
            SafetyLimitError: a limit was reached; `report` holds the statistics.
            UpdateRateError, FrameError: the array lacks the rate, or keeps it up only for a burst, or for one pattern
                switched on and off, and the blocks are longer, or of several patterns; a block is no whole number of
                frames.
            DeviceBusyError: this player is playing already.

        Whatever else `blocks`, `progress` or `watch` raises passes through, after the array is off; it then carries the
        statistics as `report`.
        """
        if not self._playing.acquire(blocking=False):
            raise DeviceBusyError(f"array {self._link.array.name} is in use: this player is playing already")
        try:
            self.report = self._stop_reason = None
            divider = self._link.array.divider(update_rate)
            with StopSignals(self, enabled=self._handle_signals) as signals, PROMPT_THREADS:
                frames = (whole_frames(block, self._link.array.frame_bytes) for block in signals.iterate(blocks))
                playable = within_reach(frames, self._link.array, divider)  # refused before anything is sent
                self._begin(divider)
                self._writer = writer = Writer(self._link, divider, self._guard, queue_blocks=self._queue_blocks)
                if self._stop_reason is not None:  # while the link was started
                    writer.request_stop(self._stop_reason)
                self._feed(playable, writer, _Ticker(writer, progress, watch))
            return self._conclude(writer, signals)
        finally:
            self._writer = None
            self._playing.release()

    def _begin(self, divider: int) -> None:
        """Start the link; if that fails, switch off what a killed player may have left on, or say that it may be."""
        try:
            self._link.start(divider)
        except LinkError as error:
            if not is_switched_off(self._link):
                error.args = (f"{error}; {may_emit_advice(self._link.array.name)}",)
            raise

    def stop(self, reason: str = "stop") -> None:
        """End the playback under way, from any thread: what is queued is dropped, and `play` returns. Else nothing."""
        self.request_stop(reason)

    def request_stop(self, reason: str) -> None:
        """As `stop`; safe in a signal handler."""
        self._stop_reason = reason  # before the look at the writer, which `play` makes before it looks at this
        if writer := self._writer:
            writer.request_stop(reason)

    def _feed(self, blocks: Iterable[array[int]], writer: Writer, ticker: _Ticker) -> None:
        """Hand over all blocks and see the writer to its end, whatever happens here."""
        try:
            for block in blocks:
                if not writer.put(block, tick=ticker.tick):
                    break
                ticker.tick()
            else:
                writer.put(None, tick=ticker.tick)
            writer.join(tick=ticker.tick)
            ticker.tick(last=True)
        except BaseException as error:
            writer.request_stop("exception")
            writer.join()
            attach_report(error, writer.report())
            raise
        finally:
            writer.join()
            self.report = writer.report()

    def _conclude(self, writer: Writer, signals: StopSignals) -> PlayReport:
        report = self.report or writer.report()
        error = writer.error
        if error is None and report.may_emit:
            error = DeviceTimeoutError(f"array {report.array} did not say that it is off")
        if isinstance(error, (LinkError, SafetyLimitError)):
            error.report = report
        if signals.signum is not None:
            interruption = PlayInterrupted(signals.signum, report)
            tell_emission(interruption, report)
            raise interruption from error
        if error is not None:
            tell_emission(error, report)
            raise error
        return report


def tell_emission(error: BaseException, report: PlayReport) -> None:
    """Have an error say that the array may still be emitting, where it may: in its sentence, or, of others', a note."""
    if not report.may_emit:
        return
    advice = may_emit_advice(report.array)
    if isinstance(error, (DeviceError, PlayInterrupted)):
        error.args = (f"{error}; {advice}",)
    else:
        error.add_note(advice)


def attach_report(error: BaseException, report: PlayReport) -> None:
    """Have an error of others carry what was played until then, as `report`, and say if the array may be emitting."""
    with contextlib.suppress(AttributeError):  # a class with slots has no room for it
        setattr(error, "report", report)  # noqa: B010  # an attribute that the error's class does not declare
    tell_emission(error, report)


def may_emit_advice(array_name: str) -> str:
    """What to do about an array that is not known to be off."""
    return f"array {array_name} may still be emitting, switch it off"


def whole_frames(block: Block, frame_bytes: int) -> array[int]:
    """A block as array("B"), the one type that pyusb sends without an element-wise copy.

    Raises `FrameError` unless it is bytes, and a whole number of frames.
    """
    if not (isinstance(block, array) and block.typecode == "B"):
        try:
            view = block.data if isinstance(block, np.ndarray) else memoryview(block)
        except TypeError:
            raise FrameError(f"a block is a {type(block).__name__}, but frames are bytes") from None
        if view.format != "B" or not view.c_contiguous:
            raise FrameError(f"a block has items of format {view.format!r}, but wire bytes are contiguous uint8")
        block = array("B", view.tobytes())
    if len(block) % frame_bytes:
        raise FrameError(f"a block has {len(block)} bytes, which is no multiple of {frame_bytes}, the size of a frame")
    return block


class _Ticker:
    """Calls whom the caller wants called while it waits."""

    def __init__(
        self,
        writer: Writer,
        progress: Callable[[int], object] | None,
        watch: Callable[[LiveStatistics], object] | None,
    ) -> None:
        self._writer = writer
        self._progress = progress
        self._watch = watch
        self._watch_at = time.monotonic()

    def tick(self, *, last: bool = False) -> None:
        if self._progress is not None:
            self._progress(self._writer.frames)
        if self._watch is not None and (last or time.monotonic() >= self._watch_at):
            self._watch_at = time.monotonic() + WATCH_PERIOD
            self._watch(self._writer.live())
