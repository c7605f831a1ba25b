"""Arrays that a writer's process holds open, and one thread that hears it: what `Live` and `Session` stand on."""

import time
from collections.abc import Callable, Sequence
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
from .supervisor import Supervisor

LEAD = 6e-3  # [s]
LEAD_RANGE = (2e-3, 0.1)  # [s]
LEAD_PERIODS = 4  # frames that a lead must have
AGAIN = 5.0  # [s] until a sentence is told again


class HeldArrays:
    """Arrays open until `close`, silent while nothing plays.

    lead: how far ahead of the present frames are written [s]; None: 6 ms, or four frames where those take longer. told:
    called with sentences for people. heard: called
    with the name of a message of the writer, and its values.
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
        self.supervisor.__enter__()
        self.supervisor.watch(self.writer.fileno(), self._hear)

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
        self.supervisor.__exit__()
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
