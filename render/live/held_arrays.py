"""Arrays that a writer's process holds open, and one thread of the parent that hears all processes of a live run."""

import os
import select
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...device.errors import DeviceError
from ...device.live.paced_writer import WriterPace
from ...device.live.writer_handle import WriterHandle, error_of
from ...device.live.writer_process import ArrayRequest
from ...device.playing.limits import Limits
from ...device.registry import kind_of
from ..errors import StrategyError
from ..playback.file_playback import Connection, require_watchable
from ..playback.placed_arrays import PlacedArray
from ..validation import require_number
from .counts import LiveCounts
from .recorder import RunRecorder

LEAD = 6e-3  # [s]
LEAD_RANGE = (2e-3, 0.1)  # [s]
LEAD_PERIODS = 4  # frames that a lead must have
AGAIN = 5.0  # [s] until a sentence is told again


class Supervisor:
    """A thread that calls functions when something can be read; each until it returns False."""

    def __init__(self) -> None:
        self._watched: dict[int, Callable[[], object]] = {}
        self._poll = select.epoll()  # `select` refuses descriptors from 1,024 on, and those that are closed meanwhile
        self._wake = os.eventfd(0, os.EFD_NONBLOCK)
        self._poll.register(self._wake, select.EPOLLIN)
        self._is_ending = False
        self._lock = threading.RLock()  # held while a function runs, so that nobody closes what it reads
        self.error: BaseException | None = None
        """What a function raised; it is not called again."""
        self._thread = threading.Thread(target=self._run, name="palpate-live", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._is_ending = True
        os.eventfd_write(self._wake, 1)
        if threading.current_thread() is not self._thread:  # a function may end what watches it
            self._thread.join()
            self._poll.close()
            os.close(self._wake)

    def watch(self, descriptor: int, heard: Callable[[], object]) -> None:
        """Call a function in the thread whenever the descriptor can be read."""
        with self._lock:
            self._watched[descriptor] = heard
            self._poll.register(descriptor, select.EPOLLIN)

    def forget(self, descriptor: int) -> None:
        """Watch it no more; it may be closed once this returns."""
        with self._lock:
            if self._watched.pop(descriptor, None) is not None:
                self._poll.unregister(descriptor)

    def settle(self, timeout: float = 2.0) -> None:
        """Wait until all that can be read now has been heard, for `timeout` [s] at most."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            with self._lock:
                poll = select.poll()
                for descriptor in self._watched:
                    poll.register(descriptor, select.POLLIN)
                if not poll.poll(0):
                    return
            time.sleep(1e-3)

    def _run(self) -> None:
        while not self._is_ending:
            for descriptor, _ in self._poll.poll():
                if descriptor == self._wake:
                    os.eventfd_read(self._wake)
                    continue
                with self._lock:
                    heard = self._watched.get(descriptor)  # None: forgotten since
                    try:
                        goes_on = heard is None or heard() is not False
                    except BaseException as error:  # the thread lives on for others; `error` says what happened
                        self.error = self.error or error
                        goes_on = False
                    if not goes_on:
                        self.forget(descriptor)


class HeldArrays:
    """Arrays open until `close`, silent while nothing plays.

    lead: how far ahead of the present frames are written [s]; None: 6 ms, or four frames where those take longer. told:
    called with sentences for people. heard: called with the name of a message of the writer, and its values.
    Raises StrategyError for a lead out of its range, and for options that a live run has not; DeviceError where an
    array cannot be opened.
    """

    def __init__(
        self,
        arrays: Sequence[PlacedArray],
        connection: Connection,
        *,
        update_rate: float,
        lead: float | None = None,
        limits: Limits | None = None,
        realtime: bool = True,
        told: Callable[[str], object] | None = None,
        heard: Callable[[str, dict[str, Any]], object] = lambda event, message: None,
    ) -> None:
        if not update_rate * LEAD_RANGE[1] >= LEAD_PERIODS:  # a NaN compares false
            least_rate = LEAD_PERIODS / LEAD_RANGE[1]
            raise StrategyError(f"update_rate of a live run must be {least_rate:g} Hz or more, not {update_rate}")
        least = max(LEAD_RANGE[0], LEAD_PERIODS / update_rate)
        bound = f"s ({LEAD_PERIODS} frames at {update_rate:g} Hz at least)"
        lead = max(LEAD, least) if lead is None else lead
        require_number("lead", lead, least, LEAD_RANGE[1], unit=bound)
        requests = [_request_for(placed, connection) for placed in arrays]
        self.names = ", ".join(placed.model.name for placed in arrays)
        self.lead = lead
        self.error: BaseException | None = None
        """What ended the run: of the writer, of the process that draws, or of the user's function."""
        self.outcome: dict[str, Any] = {}
        """What the writer reported at its end: counts, and of each array whether it is off."""
        self.recorder: RunRecorder | None = None
        """Gets what is reported of poses and frames."""
        self._told, self._heard = told or (lambda sentence: None), heard
        self._told_at: dict[str, float] = {}
        self._is_closed = False
        self.writer = WriterHandle(
            requests, update_rate=update_rate, pace=WriterPace(lead=lead), limits=limits, realtime=realtime
        )
        ready = self.writer.ready
        self.emission: str = ready["emission"]
        """Where times of focal points come from: "board", as a model of it says, or "estimate"."""
        self.counts = LiveCounts(period=1.0 / self.writer.update_rate, emission=self.emission)
        self.counts.realtime = ready["realtime"]
        self.supervisor = Supervisor()
        self.supervisor.watch(self.writer.fileno(), self._hear)

    def recorder_to(self, path: Path, *, overwrite: bool, source: object) -> RunRecorder:
        """A recorder of what is reported of poses and frames from now on."""
        self.recorder = RunRecorder(
            path,
            overwrite=overwrite,
            source=str(source),
            array=self.names,
            lead=self.lead,
            realtime=self.counts.realtime,
            emission=self.emission,
        )
        return self.recorder

    @property
    def is_running(self) -> bool:
        """Whether the writer runs."""
        return self.error is None and self.supervisor.error is None and not self.outcome

    def require_running(self) -> None:
        """Raise what ended the run."""
        if (error := self.error or self.supervisor.error) is not None:
            raise error
        if self.outcome:
            raise DeviceError(f"array {self.names} is not held any more: it was switched off")

    def tell(self, sentence: str) -> None:
        """Tell people a sentence, the same one again after a while only."""
        now = time.monotonic()
        if self.recorder is not None:
            self.recorder.add_event(now, "told", sentence)
        if now - self._told_at.get(sentence, -AGAIN) >= AGAIN:
            self._told_at[sentence] = now
            try:
                self._told(sentence)
            except BaseException as error:  # of the user's function: it ends the run, in the user's thread
                self.fail(error)

    def fail(self, error: BaseException) -> None:
        """Let the run end with an error, unless another one has ended it."""
        self.error = self.error or error

    def close(self, ended: Callable[[], object] = lambda: None) -> None:
        """Off; then `ended` is called, all that was told is heard, and the memory is let go."""
        if self._is_closed:
            return
        self._is_closed = True
        self.writer.close()
        ended()
        self.supervisor.settle()
        self.supervisor.close()
        self.writer.release()

    def _hear(self) -> bool:
        for message in self.writer.messages():
            event = message.pop("event")
            match event:
                case "poses":
                    self.counts.add_poses(message["rows"])
                    if self.recorder is not None:
                        self.recorder.add_poses(message["rows"])
                case "skipped":
                    self.counts.add_skipped(message["rows"])
                    if self.recorder is not None:
                        self.recorder.add_skipped(message["rows"])
                case "state":
                    self.counts.set_counts(message)
                case "warning":
                    self.tell(message["text"])
                case "failed":
                    self.error = error_of(message)
                case "off":
                    arrays = message["arrays"]
                    self.counts.set_counts({name: value for name, value in message.items() if name != "arrays"})
                    known = [own["off_confirmed"] for own in arrays]
                    confirmed = False if False in known else None if None in known else True
                    self.outcome = message | {"off_confirmed": confirmed}
                case "gone":
                    if not self.outcome:
                        self.error = self.error or DeviceError(
                            f"the process that writes to array {self.names} ended without a word: the array may be "
                            "emitting, switch it off"
                        )
                    return False
            self._heard(event, message)
        return True


def _request_for(placed: PlacedArray, connection: Connection) -> ArrayRequest:
    model = placed.model
    if (reason := kind_of(model).not_live) is not None:
        raise StrategyError(reason)
    if connection.clock != "monotonic":
        raise StrategyError(f"clock={connection.clock} is not for live runs, whose poses come in real time")
    if connection.backend is not None:
        raise StrategyError("backend is not for live runs: another process opens the array")
    emulated = model.embedded or connection.emulate
    if connection.watchdog:
        require_watchable(model, emulated=emulated)
    return ArrayRequest(
        kind=kind_of(model),
        model=model,
        serial=placed.serial,
        emulated=emulated,
        uncalibrated=connection.uncalibrated,
        transport=connection.transport,
        watchdog=connection.watchdog and kind_of(model).watches_itself is None,
    )
