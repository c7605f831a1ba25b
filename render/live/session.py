"""A session: an array that stays open, stimuli that are ready, and each of them on it within milliseconds."""

import threading
import time
from array import array as byte_array
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Self, Unpack

import numpy as np

from ...datasets.focus_files.frame_reader import FOCAL_POINTS, WIRE_FRAMES, frame_format
from ...datasets.recordings.alignment import Alignment
from ...device.errors import DeviceBusyError, DeviceTimeoutError
from ...device.playing.limits import Dose, Guard, Limits
from ..errors import StrategyError
from ..hands.hand import Hand, Palm
from ..intersection.named_inputs import solid_of
from ..objects.solid import Solid
from ..playback.drive import Driver, DriveStrategy
from ..playback.file_playback import Connection, ConnectionFields
from ..playback.focal_points import open_focal_points, require_duration, sampling_for
from ..playback.frames import MadeFrames
from ..playback.placed_arrays import PlacedArray, arrays_of, with_points
from ..playback.prepared_frames import PreparedFrames
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy, strategy_of
from ..trust.permission import AllowCode
from .counts import RunStatistics
from .drawing_run import DrawingRun
from .handle import sampling_at
from .held_arrays import HeldArrays
from .moment import LiveMoment, LiveScene
from .recorder import RunRecorder, record_path
from .renderer_process import LiveRendering
from .sources.hand_frame import PoseSource
from .sources.named_sources import settings_and_hand
from .sources.pose_stream import ANY
from .sources.shaping import shaping_of

STOP_TIMEOUT = 5.0  # [s]
ONSET_TIMEOUT = 2.0  # [s] for a stimulus that is stored; a live one waits for a hand
BYTES_MOST = 1 << 32  # of all stored stimuli


@dataclass(frozen=True)
class Stimulus:
    """A contour file, focal points or prepared frames, as `play_file` takes them.

    >>> from palpate.render import Stimulus
    >>> Stimulus("tube-cc.h5", duration=2.0)
    Stimulus(path='tube-cc.h5', sampling=None, drive=None, duration=2.0)
    """

    path: str | Path
    sampling: SamplingStrategy | str | None = None
    drive: DriveStrategy | None = None
    duration: float | None = None
    """Of the playback [s]; needed for a static pose, which has no end."""


@dataclass(frozen=True)
class LiveStimulus:
    """An object that a hand explores for a time, from when it is played.

    >>> from palpate.render import LiveStimulus
    >>> LiveStimulus("tube", duration=7.0, strategy="oc")
    LiveStimulus(solid='tube', duration=7.0, hand='palm', strategy='oc', sampling=None, drive=None)
    """

    solid: Solid | str
    duration: float
    """[s]"""
    hand: Hand | str = "palm"
    strategy: IntersectionStrategy | str = "cc"
    sampling: SamplingStrategy | str | None = None
    drive: DriveStrategy | None = None


class Onset(NamedTuple):
    """When a stimulus began.

    >>> from palpate.render import Onset
    >>> Onset(time=12.5, latency=0.004, is_estimate=False)
    Onset(time=12.5, latency=0.004, is_estimate=False)
    """

    time: float
    """Of its first focal point, on the array's clock [s]: for real arrays and models CLOCK_MONOTONIC, that of
    `time.monotonic()`."""
    latency: float
    """From the call of `play` to then [s]."""
    is_estimate: bool
    """Whether the time is that at which the frame was due, as an array that does not answer cannot say it."""


@dataclass
class _Current:
    """What plays."""

    number: int
    is_live: bool
    begun: threading.Event = field(default_factory=threading.Event)
    stopping: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)
    onset_ns: int = 0
    called: float = 0.0  # when `play` was [s]
    silent_at: float | None = None
    saves_later: bool = False
    recorder: RunRecorder | None = None
    error: BaseException | None = None  # of saving what was recorded


@contextmanager
def opened_frames(
    stimulus: Stimulus, arrays: Sequence[PlacedArray], update_rate: float, *, sized: bool = False
) -> Iterator[MadeFrames | PreparedFrames]:
    """Frames of a stored stimulus for arrays; a sampling by its name takes the update rate [Hz] of the session.

    sized: whether arrays that take focal points have as many a frame as the stimulus, whatever they were given with.
    Raises what `play_file` does for a file that these arrays cannot play.
    """
    form = frame_format(stimulus.path)
    if form == WIRE_FRAMES:
        with PreparedFrames(stimulus.path, repeats=1) as prepared:
            arrays = prepared.sized(arrays) if sized else arrays
            prepared.require_fitting(arrays, stimulus.sampling, stimulus.drive, stimulus.duration)
            yield prepared
        return
    sampling = stimulus.sampling
    if isinstance(sampling, str):
        sampling = sampling_at(sampling, update_rate)
    with open_focal_points(
        Path(stimulus.path), sampling, stimulus.duration, arrays, has_points=form == FOCAL_POINTS
    ) as (points, file):
        arrays = with_points(arrays, points.foci) if sized else arrays
        driver = Driver([placed.model for placed in arrays], stimulus.drive, update_rate=points.update_rate)
        yield MadeFrames(points, driver, file=file)


class Session:
    """An array that stays open: stimuli are loaded once, and each begins within 10 ms of its call.

    A context manager: the array is silent between stimuli, and off when the context is left, whatever ends it. One
    process writes to the array; if this one is killed, it switches the array off and ends.

    Args:
        array: name of an array, a file of several, or placed arrays.
        update_rate: of all stimuli [Hz]; None: the array's usual one.
        foci: most focal points of a sample of any stimulus; an array that takes focal points is opened for so many.
        source: of the hand that live stimuli are explored with, as in `Live`.
        lead: how far ahead of the present frames are written [s], as in `Live`.
        limits: of on-time and duty, across all stimuli; None: the defaults.
        realtime: whether real-time scheduling is asked for.
        told: called with sentences on what goes wrong.
        side, alignment, prediction, smoothing, allow_code: of the source, as in `Live`.
        connection: options of the connection to the arrays; or its fields, such as emulate=True.

    >>> from palpate.render import LiveStimulus, Session, Stimulus, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> with Session("emulator") as session:
    ...     cube, tube = session.load([Stimulus(path, duration=0.2), LiveStimulus("tube", duration=0.3)])
    ...     onset = session.play(cube)
    ...     _ = session.wait()
    ...     _ = session.play(tube)
    ...     _ = session.wait()
    >>> onset.is_estimate  # the emulated board says when it began
    False
    """

    def __init__(
        self,
        array: str | Sequence[PlacedArray] = "emulator",
        *,
        update_rate: float | None = None,
        foci: int = 1,
        source: str | PoseSource = "exploration",
        lead: float | None = None,
        limits: Limits | None = None,
        realtime: bool = True,
        told: Callable[[str], object] | None = None,
        side: str = ANY,
        alignment: Alignment | None = None,
        prediction: float = 0.0,
        smoothing: float = 0.0,
        allow_code: AllowCode = False,
        connection: Connection | None = None,
        **fields: Unpack[ConnectionFields],
    ) -> None:
        if connection is not None and fields:
            raise StrategyError(f"{min(fields)} is a field of connection, which is given, too")
        self._arrays = with_points(arrays_of(array), foci)
        Driver([placed.model for placed in self._arrays])  # arrays that cannot play together are refused
        rate = sampling_for(None, self._arrays).update_rate if update_rate is None else update_rate
        self._source, self._source_options = (
            source,
            {
                "side": side,
                "alignment": alignment,
                "shaper": shaping_of(prediction, smoothing),
                "realtime": realtime,
                "allow_code": allow_code,
            },
        )
        self._stimuli: list[Stimulus | LiveStimulus] = []
        self._numbers: list[int] = []  # of the writer, or of the renderer
        self._run: DrawingRun | None = None
        self._bytes = 0
        self._current: _Current | None = None
        self._unsaved: list[RunRecorder] = []
        self._loaded = threading.Event()
        self._playing = threading.Lock()
        self._realtime = realtime
        self._held = HeldArrays(
            self._arrays,
            connection or Connection(**fields),
            update_rate=rate,
            lead=lead,
            limits=limits,
            realtime=realtime,
            told=told,
            heard=self._hear,
        )
        self._writer = self._held.writer
        self.update_rate = self._writer.update_rate
        """Of all stimuli [Hz]."""

    def __repr__(self) -> str:
        names = ", ".join(placed.model.name for placed in self._arrays)
        return f"Session({names}, {len(self._stimuli)} stimuli at {self.update_rate:g} Hz)"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        try:
            self.close()
        except Exception:
            if error is None:  # else what the user's block raised is told
                raise
        if self._held.error is not None and error is None:
            raise self._held.error

    @property
    def stimuli(self) -> tuple[Stimulus | LiveStimulus, ...]:
        """What was loaded, in the order of their numbers."""
        return tuple(self._stimuli)

    def load(self, stimuli: Sequence[Stimulus | LiveStimulus | str | Path]) -> list[int]:
        """Make stimuli ready; returns the number of each, for `play`. A path stands for a `Stimulus`.

        Live stimuli are prepared together: they are loaded in one call, as a session draws in one process.
        Raises StrategyError for a stimulus of another update rate, and for live ones after others; what `play_file` and
        `Live` raise; then nothing was loaded of this call.
        """
        given = [own if isinstance(own, Stimulus | LiveStimulus) else Stimulus(own) for own in stimuli]
        live = [own for own in given if isinstance(own, LiveStimulus)]
        if live and self._run is not None:
            raise StrategyError("live stimuli are loaded in one call: this session has some already")
        self._held.require_running()
        stored, byte_count = [], self._bytes
        for own in given:
            if isinstance(own, Stimulus):
                stored.append(self._frames_of(own, BYTES_MOST - byte_count))
                byte_count += sum(len(block) for block in stored[-1][0])
        if live:
            self._prepare(live)
        self._bytes = byte_count
        numbers, index = [], iter(range(len(live)))
        rows = iter(stored)
        for own in given:
            numbers.append(len(self._stimuli))
            self._stimuli.append(own)
            if isinstance(own, LiveStimulus):
                self._numbers.append(next(index))
                continue
            self._loaded.clear()
            self._numbers.append(self._writer.load(*next(rows)))
            while not self._loaded.wait(0.1):
                self._held.require_running()
        return numbers

    def play(
        self,
        number: int,
        *,
        repeats: int = 1,
        record: str | Path | None = None,
        saves_later: bool = False,
        timeout: float = ONSET_TIMEOUT,
        is_cancelled: Callable[[], bool] = lambda: False,
    ) -> Onset:
        """Play a stimulus; returns when its first focal point has been played.

        repeats: of a stored one. record: contour file that a live one is saved to at its end; saves_later: only when
        `save_records` is called, as saving takes a tenth of a second that the next stimulus may not have. timeout: how
        long a live one waits for a hand [s]. is_cancelled: asked every 10 ms while it waits; once true, it ends as
        after the time. A hand that comes in that very moment makes it begin, and end at once.
        Raises DeviceBusyError while another one plays, StrategyError for a number that there is not, DeviceTimeoutError
        where none of a live one's poses came in time, and what ended the writer.
        """
        called = time.monotonic()
        if not (isinstance(number, int | np.integer) and 0 <= number < len(self._stimuli)):
            raise StrategyError(
                f"number must be one of the {len(self._stimuli)} stimuli loaded, from 0, not {number!r}"
            )
        if not 1 <= repeats <= 1_000_000:
            raise StrategyError(f"repeats must be 1..1000000, not {repeats!r}")
        self._held.require_running()
        stimulus = self._stimuli[number]
        is_live = isinstance(stimulus, LiveStimulus)
        if record is not None and not is_live:
            raise StrategyError(f"record is for live stimuli: stimulus {number} is stored already")
        path = None if record is None else record_path(record, overwrite=False)
        with self._playing:
            if self._current is not None and not self._current.ended.is_set():
                raise DeviceBusyError(f"stimulus {self._current.number} plays: wait() for it, or stop() it")
            self._current = current = _Current(number, is_live, called=called, saves_later=saves_later)
            if isinstance(stimulus, LiveStimulus) and self._run is not None:
                if path is not None:
                    current.recorder = self._held.recorder_to(path, overwrite=False, source=self._source)
                self._run.begin(self._numbers[number], current.recorder)
                threading.Thread(
                    target=self._end_in_time, args=(current, stimulus.duration), name="palpate-stimulus", daemon=True
                ).start()
            else:
                self._writer.send("play", number=self._numbers[number], repeats=repeats)
        while not current.begun.wait(0.01):
            self._held.require_running()
            if time.monotonic() - called > timeout or is_cancelled():
                is_late = time.monotonic() - called > timeout
                self.stop()
                if current.begun.is_set():
                    break
                if not is_late:
                    raise DeviceTimeoutError(f"stimulus {number} was cancelled before it began")
                reason = "no pose came from the source" if current.is_live else "the array has played nothing"
                raise DeviceTimeoutError(f"stimulus {number} did not begin within {timeout:g} s: {reason}")
        return self._onset_of(current)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until what plays has ended, for `timeout` [s] at most; whether it has."""
        end = float("inf") if timeout is None else time.monotonic() + timeout
        current = self._current
        while current is not None and not current.ended.wait(0.02):
            self._held.require_running()
            if time.monotonic() >= end:
                return False
        if current is not None and current.error is not None:
            error, current.error = current.error, None
            raise error
        return True

    def save_records(self) -> None:
        """Make the files of all records that were to be saved later.

        Raises what keeps one from being made, such as a full disk; then it may be called again. A record with gaps, as
        something kept it from going on, is made, and raises once.
        """
        first: BaseException | None = None
        for recorder in tuple(self._unsaved):
            try:
                recorder.save()
            except Exception as error:
                first = first or error
                if error is not recorder.error:
                    continue
            self._unsaved.remove(recorder)
        if first is not None:
            raise first

    @property
    def lead(self) -> float:
        """How far ahead of the present frames are written [s]."""
        return self._held.lead

    @property
    def last_onset(self) -> Onset | None:
        """Of what was played last, also where `play` was interrupted; None where it has not begun."""
        return None if self._current is None or not self._current.begun.is_set() else self._onset_of(self._current)

    def _onset_of(self, current: _Current) -> Onset:
        onset = current.onset_ns * 1e-9
        return Onset(onset, onset - current.called, self._held.emission == "estimate")

    @property
    def silent_since(self) -> float | None:
        """When the array went silent after what was played last [s of time.monotonic()]; None before that."""
        return None if self._current is None else self._current.silent_at

    def stop(self) -> None:
        """End what plays now; the array is silent when this returns, but for the lead, which is played."""
        current = self._current
        if current is None or current.ended.is_set():
            return
        current.stopping.set()
        if not current.is_live:
            self._writer.send("stop")
        end = time.monotonic() + STOP_TIMEOUT
        while not current.ended.wait(0.02) and self._held.is_running and time.monotonic() < end:
            pass

    def statistics(self) -> RunStatistics:
        """Of all live stimuli so far."""
        return self._held.counts.statistics()

    def scene(self) -> LiveScene | None:
        """What a viewer draws of the live stimulus that plays, or that played last; None where none is loaded."""
        return None if self._run is None else self._run.scene()

    def moment(self) -> LiveMoment | None:
        """What is drawn now of a live stimulus, as `Live.moment`; None while none is drawn."""
        return None if self._run is None else self._run.moment()

    def close(self) -> None:
        """Off, and everything ended."""
        if self._held.is_running:
            self.stop()
        try:
            self._held.close(lambda: None if self._run is None else self._run.end())
        finally:
            self.save_records()

    def _prepare(self, live: Sequence[LiveStimulus]) -> None:
        """A run with a rendering for each live stimulus."""
        first, chosen = live[0], None
        renderings = []
        for own in live:
            require_duration(own.duration)
            sampling = sampling_at(own.sampling or "stm", self.update_rate)
            if sampling.update_rate != self.update_rate:
                raise self._other_rate(f"live stimulus of {own.solid!r}", sampling.update_rate)
            solid = solid_of(own.solid)
            settings, hand = settings_and_hand(self._source, own.hand, solid, **self._source_options)
            if chosen is None:
                chosen = settings
            elif own.hand is not first.hand and not (isinstance(own.hand, str | Palm) and own.hand == first.hand):
                raise StrategyError("live stimuli of one session must have the same hand, as they have one source")
            renderings.append(
                LiveRendering(
                    solid=solid,
                    hand=hand,
                    strategy=strategy_of(own.strategy),
                    sampling=sampling,
                    drive=own.drive or DriveStrategy(),
                )
            )
        assert chosen is not None  # there is one live stimulus at least
        self._run = DrawingRun(
            renderings,
            chosen,
            self._held,
            intensity=1.0,
            realtime=self._realtime,
            is_recorded=True,
        )

    def _frames_of(self, stimulus: Stimulus, room: int) -> tuple[list[memoryview], list[list[Dose]]]:
        """Frames of a stored stimulus for each array, in `room` [byte] at most, and what slices of them do."""
        with opened_frames(stimulus, self._arrays, self.update_rate) as frames:
            if frames.update_rate != self.update_rate:
                raise self._other_rate(str(stimulus.path), frames.update_rate)
            blocks: list[list[Any]] = [[] for _ in self._arrays]
            for row in frames:
                for own, block in zip(blocks, row, strict=True):
                    own.append(block)
                    room -= memoryview(block).nbytes
                if room < 0:
                    raise StrategyError(
                        f"{stimulus.path}: all stimuli of a session may have {BYTES_MOST:,} bytes of frames; a shorter "
                        "duration makes fewer"
                    )
        joined = [memoryview(b"".join(own)) for own in blocks]
        doses = []
        for data, placed in zip(joined, self._arrays, strict=True):
            guard = Guard(Limits(on_time_max=None, duty_max=None), placed.model)
            doses.append(guard.measure(byte_array("B", data), self._writer.slice_frames))
        return joined, doses

    def _other_rate(self, what: str, rate: float) -> StrategyError:
        return StrategyError(
            f"{what}: update_rate is {rate:g} Hz, but this session's array runs at {self.update_rate:g} Hz: give "
            f"Session(update_rate=...), or the sampling that rate"
        )

    def _end_in_time(self, current: _Current, duration: float) -> None:
        """End a live stimulus when its time [s] is over, or `stop` has said so."""
        while not current.begun.wait(0.02) and not current.stopping.is_set() and self._held.is_running:
            pass
        if current.begun.is_set():
            current.stopping.wait(max(current.onset_ns * 1e-9 + duration - time.monotonic(), 0.0))
        try:
            if self._run is not None and self._held.is_running:
                self._run.fade()
                time.sleep(self._held.lead)
                self._writer.send("stop")
            current.silent_at = time.monotonic()  # keeping what was drawn takes longer
            self._held.supervisor.settle()  # what was drawn belongs to this stimulus, not to the next
            if current.recorder is not None:
                self._held.recorder = None
                if current.saves_later:
                    self._unsaved.append(current.recorder)
                else:
                    current.recorder.save()
        except BaseException as error:  # `wait` raises it in the user's thread
            current.error = error
            if self._held.recorder is not None and self._held.recorder is current.recorder:
                self._held.recorder = None
                self._unsaved.append(current.recorder)  # what was drawn until then
        finally:
            current.ended.set()

    def _hear(self, event: str, message: dict[str, Any]) -> None:
        current = self._current
        if event == "loaded":
            self._loaded.set()
        elif event == "began" and current is not None and not current.begun.is_set():
            current.onset_ns = message["onset_ns"]
            current.begun.set()
        elif event == "ended" and current is not None:
            current.silent_at = time.monotonic()
            current.ended.set()
