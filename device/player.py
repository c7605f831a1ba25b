"""Playing frames to an array: queued, watched, and off on every way out."""

from __future__ import annotations

import signal
import threading
from array import array
from collections.abc import Callable, Iterable, Iterator
from types import FrameType, TracebackType
from typing import Final, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from .errors import DeviceBusyError, DeviceTimeoutError, FrameError, LinkError, PlayInterrupted
from .link import Link
from .report import PlayReport
from .writer import Writer, wait_silent

Block: TypeAlias = "array[int] | bytes | bytearray | memoryview | NDArray[np.uint8]"
"""Wire bytes of whole frames. An array("B") is sent without a copy, so it must not be changed once handed over."""

QUEUE_BLOCKS = 8


class Player:
    """Plays frames to one array.

    Args:
        link: the opened array. The player uses it, but does not close it.
        queue_blocks: how many blocks wait for their turn; as many are made before the first is played.
        handle_signals: switch the array off and raise `PlayInterrupted` on SIGINT, SIGTERM and SIGHUP, while playing.
            Python lets only the main thread do so; elsewhere it is the application's to call `stop`.
    """

    def __init__(self, link: Link, *, queue_blocks: int = QUEUE_BLOCKS, handle_signals: bool = True) -> None:
        if queue_blocks < 1:
            raise ValueError(f"queue_blocks is {queue_blocks}, but at least 1 block must fit the queue")
        self.report: PlayReport | None = None
        """Statistics of the last playback, however it ended."""
        self._link = link
        self._queue_blocks = queue_blocks
        self._handle_signals = handle_signals
        self._playing = threading.Lock()
        self._writer: Writer | None = None

    def play(
        self, blocks: Iterable[Block], *, update_rate: float, progress: Callable[[int], object] | None = None
    ) -> PlayReport:
        """Play blocks until they end, and return when the array is off.

        The blocks are taken on the calling thread (where they are made), and sent on another one.

        Args:
            blocks: wire bytes, each block a whole number of frames.
            update_rate: frames a second [Hz], carrier / n.
            progress: called on the calling thread, now and then, with the count of frames that the array has taken.

        Returns:
            The statistics.

        Raises:
            PlayInterrupted: a signal came; it carries the statistics.
            LinkError: the array failed; `report` holds the statistics. `DeviceLostError` if it is gone.
            UpdateRateError, FrameError: the rate is no carrier / n; a block is no whole number of frames.
            DeviceBusyError: this player is playing already.

        Whatever else `blocks` or `progress` raises passes through, after the array is off.
        """
        if not self._playing.acquire(blocking=False):
            raise DeviceBusyError(f"array {self._link.array.name} is in use: this player is playing already")
        try:
            divider = self._link.array.divider(update_rate)
            self._link.set_divider(divider)
            self._settle(divider)
            self._writer = writer = Writer(self._link, divider, queue_blocks=self._queue_blocks)
            with _StopSignals(writer, enabled=self._handle_signals) as signals:
                self._feed(blocks, writer, signals, progress or _ignore)
            return self._conclude(writer, signals)
        finally:
            self._writer = None
            self._playing.release()

    def stop(self) -> None:
        """End the playback under way, from any thread: what is queued is dropped, and `play` returns. Else nothing."""
        if writer := self._writer:
            writer.request_stop("stop")

    def _settle(self, divider: int) -> None:
        """Silence what a killed player left behind, and complete the frame it left torn."""
        status = self._link.status()
        if status.fifo_frames or status.torn_bytes or status.level:
            self._link.clear()
            self._link.send_off()
            if not wait_silent(self._link, round(divider / self._link.array.carrier * 1e9)):
                raise DeviceTimeoutError(f"array {self._link.array.name} does not fall silent: switch it off and on")

    def _feed(
        self, blocks: Iterable[Block], writer: Writer, signals: _StopSignals, progress: Callable[[int], object]
    ) -> None:
        """Hand over all blocks and see the writer to its end, whatever happens here."""
        try:
            for block in signals.iterate(blocks):
                if not writer.put(whole_frames(block, self._link.array.frame_bytes)):
                    break
                progress(writer.frames)
            else:
                writer.put(None)
            writer.join(tick=lambda: progress(writer.frames))
        except BaseException:
            writer.request_stop("exception")
            raise
        finally:
            writer.join()
            self.report = writer.report()

    def _conclude(self, writer: Writer, signals: _StopSignals) -> PlayReport:
        report = writer.report()
        error = writer.error
        if isinstance(error, LinkError):
            error.report = report
        if signals.signum is not None:
            raise PlayInterrupted(signals.signum, report) from error
        if error is not None:
            raise error
        if not report.off_confirmed:
            lost = DeviceTimeoutError(
                f"array {report.array} did not say that it is off: it may still be emitting, switch it off"
            )
            lost.report = report
            raise lost
        return report


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


class _Interrupted(BaseException):
    """Breaks off the making of blocks; never leaves this module."""


class _StopSignals:
    """While active: the signals that end a process stop the writer instead, and break off the making of blocks.

    The handler only sets attributes: a lock it took could be held by the very code it interrupts. It raises only
    where code of the caller's runs, which may take arbitrarily long; this package's own loops look at the writer.
    """

    def __init__(self, writer: Writer, *, enabled: bool) -> None:
        self.signum: int | None = None
        self._writer = writer
        self._enabled = enabled and threading.current_thread() is threading.main_thread()
        self._breakable = False
        self._previous: dict[int, object] = {}

    def __enter__(self) -> Self:
        for signum in _STOP_SIGNALS if self._enabled else ():
            if signum == signal.SIGHUP and signal.getsignal(signum) == signal.SIG_IGN:
                continue  # nohup
            self._previous[signum] = signal.signal(signum, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for signum, handler in self._previous.items():
            # None: it was not installed from Python, and cannot be put back
            signal.signal(signum, signal.SIG_DFL if handler is None else handler)  # pyright: ignore[reportArgumentType]  # what signal.signal gave

    def iterate(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """The blocks, until a signal comes."""
        try:
            self._breakable = True
            source = iter(blocks)
            self._breakable = False
            while self.signum is None:
                self._breakable = True
                block = next(source)
                self._breakable = False
                yield block
        except (StopIteration, _Interrupted):
            return
        finally:
            self._breakable = False

    def _handle(self, signum: int, frame: FrameType | None) -> None:
        if self.signum is not None:
            return
        self.signum = signum
        self._writer.request_stop(signal.Signals(signum).name)
        if self._breakable:
            self._breakable = False
            raise _Interrupted


def _ignore(frames: int) -> None:
    pass


_STOP_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
