"""Play a contour file, or focal points: contours -> focal points -> drives -> frames -> the player."""

from __future__ import annotations  # array("B") takes no index at run time

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TypedDict, Unpack, get_args

from ...datasets.focus_files.frame_reader import FOCAL_POINTS, WIRE_FRAMES, frame_format
from ...device.array import ArrayModel
from ...device.array_kind import Emulation
from ...device.boards.discovery import open_link
from ...device.clock import Clock, MonotonicClock, VirtualClock
from ...device.errors import CalibrationError
from ...device.link import Link, TransportKind
from ...device.playing.ensemble import play_together
from ...device.playing.limits import Limits
from ...device.playing.watchdog import Watchdog, is_watchable
from ...device.registry import emulated_backend, kind_of
from ...device.report import LiveStatistics, PlayReport
from ...device.transports.pyusb import Backend
from ...device.transports.serial_line import SerialPorts
from ...kernels import FOCUS_STAGES, uncompiled
from ..contour_input import takes_batches
from ..errors import StrategyError
from ..runtime.kernel_compiling import compile_now
from ..sampling.metrics import SamplingCount
from ..sampling.strategy import SamplingStrategy
from ..validation import choose
from .drive import Driver, DriveStrategy
from .focal_points import ContourRows, FocusSource, contour_source, open_focal_points
from .frames import MadeFrames, Making, WireFrames, counted_values
from .placed_arrays import PlacedArray, arrays_of, with_points
from .prepared_frames import PreparedFrames

CLOCKS: dict[str, Callable[[], Clock]] = {"monotonic": MonotonicClock, "virtual": VirtualClock}


@dataclass(frozen=True)
class Playback:
    """Result of playing a file."""

    reports: tuple[PlayReport, ...]
    """The player's report on each array."""
    making: Making
    """How its frames were made, and the counts of the first repetition."""
    repeats: int = 1
    """Requested number of repetitions."""
    first_frame_seconds: float | None = field(default=None, compare=False)
    """Real time from the call until the first frames were ready for arrays that had been started [s]. It differs
    from call to call, so it is neither compared nor in `as_dict`."""

    def __repr__(self) -> str:
        """One line: the report of each array, jumps and silenced focal points."""
        jumps = "" if self.count is None else f", {sum(self.count.jumps.values())} jumps"
        return f"Playback({', '.join(map(repr, self.reports))}{jumps}, {self.refused} silenced)"

    @property
    def sampling(self) -> SamplingStrategy | None:
        """None for focal points that were read from a file."""
        return self.making.sampling

    @property
    def count(self) -> SamplingCount | None:
        """Counts of the sampler; of the first repetition if there were several."""
        return self.making.count

    @property
    def refused(self) -> int:
        """Focal points of the first repetition that were silenced: out of reach of all arrays, or invalid."""
        return self.making.refused

    @property
    def switched(self) -> int:
        """Frames of the first repetition that an array without amplitude control played with amplitude 0 or 1."""
        return self.making.switched

    @property
    def drive(self) -> DriveStrategy:
        """How focal points became drives."""
        return self.making.drive

    @property
    def underruns(self) -> int:
        """How often the first array ran out of frames, by the player's estimate."""
        return self.played.underruns

    @property
    def frames(self) -> int:
        """Frames that the first array took."""
        return self.played.frames

    @property
    def draw_frequency(self) -> float | None:
        """Mean draw frequency while something is drawn [Hz]; None if nothing is, and for focal points of a file."""
        if self.count is None or self.sampling is None:
            return None
        return self.count.draw_frequency(self.sampling.update_rate)

    @property
    def played(self) -> PlayReport:
        """The player's report on the first array."""
        return self.reports[0]

    def as_dict(self) -> dict:
        """All that was played, for JSON: the player's report, the sampler's counts, the strategies."""
        values = {**self.played.as_dict(), "repeats": self.repeats, "refused": self.refused, "switched": self.switched}
        if len(self.reports) > 1:
            values["arrays"] = [report.as_dict() for report in self.reports]
        if self.sampling is not None and self.count is not None:
            values |= counted_values(self.count, self.sampling)
        return values | {"drive": asdict(self.drive)}


@dataclass(frozen=True, kw_only=True)
class Connection:
    """Options of the connection to the arrays of a playback.

    The array "emulator" is always emulated, others only with `emulate`. backend: of pyusb, for tests. clock: of
    emulated arrays, "monotonic" (real time) or "virtual" (as fast as possible), which an autd3 does not have.

    >>> from palpate.render import Connection, play_file, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> model = Connection(emulate=True, clock="virtual")  # of the board, where none is at hand
    >>> report = play_file(path, array="pat16", duration=0.01, connection=model).played
    >>> report.array, report.clock, report.frames
    ('pat16', 'virtual', 100)
    """

    emulate: bool = False
    clock: str = "monotonic"
    backend: Backend | SerialPorts | Emulation | None = None
    transport: TransportKind = "auto"
    uncalibrated: bool = False
    """Play on a real pat16 without its board file."""
    watchdog: bool = False
    """Whether a second process switches the array off if this one is killed."""

    def __post_init__(self) -> None:
        """Raise StrategyError for an unknown clock or transport."""
        object.__setattr__(self, "clock", choose("clock", self.clock, tuple(CLOCKS)))
        object.__setattr__(self, "transport", choose("transport", self.transport, get_args(TransportKind)))

    def open(self, placed: PlacedArray) -> Link:
        """The link to one array."""
        model = placed.model
        emulated = self.backend is None and (model.embedded or self.emulate)
        if self.watchdog:
            require_watchable(model, emulated=emulated)
        if self.clock == "virtual" and self.backend is None and (not emulated or kind_of(model).emulates_itself):
            reason = "whose emulation keeps real time" if emulated else "which is real (emulate=True plays to a model)"
            raise StrategyError(f"clock=virtual is not for {model.name}, {reason}: leave the clock out")
        bus = emulated_bus(placed, CLOCKS[self.clock]()) if emulated else None
        try:
            return open_link(
                model,
                serial=placed.serial,
                backend=self.backend if bus is None else bus,
                transport=self.transport,
                uncalibrated=self.uncalibrated or emulated,
                emulated=emulated,
            )
        except CalibrationError as error:
            advice = "" if model.calibrated else " (calibration=BOARD.pat, emulate=True or uncalibrated=True)"
            raise StrategyError(f"{error}{advice}") from error

    @contextmanager
    def all_of(self, arrays: Sequence[PlacedArray]) -> Iterator[list[Link]]:
        """Links to all arrays, closed at the end of the context."""
        with ExitStack() as stack:
            links = []
            for placed in arrays:
                link = self.open(placed)
                stack.callback(link.close)
                if self.watchdog and kind_of(link.array).watches_itself is None:
                    stack.enter_context(Watchdog(link))
                links.append(link)
            yield links


def emulated_bus(placed: PlacedArray, clock: Clock) -> Emulation | None:
    """A bus with a model of one board, of the serial number and the UART's rate that are asked for.

    None for an array whose link emulates it by itself.
    """
    model = placed.model
    if kind_of(model).emulates_itself:
        return None
    serial = placed.serial or model.serial
    serials = None if serial is None else (serial,)
    return emulated_backend(model.name, clock=clock, serials=serials, baud=model.baud)


def require_watchable(model: ArrayModel, *, emulated: bool) -> None:
    """Raise StrategyError for an array that no watchdog can switch off, and that does not do so by itself."""
    if emulated:
        raise StrategyError(f"a watchdog is for real arrays, not for {model.name}, which is emulated here")
    if kind_of(model).watches_itself is None and not is_watchable(model):
        raise StrategyError(f"a watchdog is for arrays on USB or at a serial port, not for {model.name} on a network")


class ConnectionFields(TypedDict, total=False):
    """Fields of a `Connection`, as arguments of what plays."""

    emulate: bool
    clock: str
    transport: TransportKind
    uncalibrated: bool
    watchdog: bool


class _Preparation:
    """What comes before the first frame: kernels that must be compiled, and the time that it takes.

    compiling: called before kernels are compiled, with the number of their modules.
    """

    def __init__(self, compiling: Callable[[int], object] | None) -> None:
        self._began = perf_counter()
        self._compiling = compiling
        self._stages: tuple[str, ...] = ()
        self._device_stages: tuple[str, tuple[str, ...]] = ("cpu", ())
        self.first_frame_seconds: float | None = None

    def need(self, source: FocusSource, driver: Driver) -> None:
        """Note the kernels of a playback: of sampling, on the CPU, and of drives, on a device."""
        self._stages = () if source.sampling is None else FOCUS_STAGES
        self._device_stages = driver.device, driver.kernel_stages(source.foci)

    def compile(self) -> None:
        """Compile what is missing, so that an array that has been started waits for no compiler."""
        device, others = self._device_stages
        stages = (*self._stages, *others) if device == "cpu" else self._stages
        if missing := uncompiled(stages):
            if self._compiling is not None:
                self._compiling(len(missing))
            compile_now(missing)
        if device != "cpu":
            compile_now(others, device)

    def timed(self, blocks: Iterable[tuple[array[int], ...]]) -> Iterator[tuple[array[int], ...]]:
        """The blocks, the first of which ends the preparation."""
        for block in blocks:
            if self.first_frame_seconds is None:
                self.first_frame_seconds = perf_counter() - self._began
            yield block


@takes_batches
def play_file(
    path: str | Path,
    *,
    array: str | Sequence[PlacedArray] = "emulator",
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    duration: float | None = None,
    repeats: int = 1,
    limits: Limits | None = None,
    connection: Connection | None = None,
    device: str = "cpu",
    watch: Callable[[LiveStatistics, int], object] | None = None,
    compiling: Callable[[int], object] | None = None,
    **fields: Unpack[ConnectionFields],
) -> Playback:
    """Play a contour file, focal points from a .PTLIST or a sweep, or prepared frames; afterwards the arrays are off.

    Args:
        path: the file. Prepared frames (`prepare_frames`) are played as they are: on the arrays that they were made
            for, at their rate, to their end, with the counts of their making.
        array: name of an array, or several placed arrays (`load_rig`).
        sampling: conversion of contours to focal points; its update rate is that of the playback. A file of focal
            points has its own rate and takes none.
        drive: conversion of focal points to drives.
        duration: of the playback [s]; needed for a static pose, which has no end.
        repeats: number of repetitions, for each of which the file is read again.
        limits: of on-time and duty cycle; None: the defaults.
        connection: options of the connection to the arrays; or its fields, such as clock="virtual".
        device: Warp device on which frames are made.
        watch: called regularly with live statistics of the first array and the number of all frames.
        compiling: called before kernels are compiled, which takes seconds once on a machine, with the number of their
            modules.

    Raises:
        ContourFileError, PoseError, StrategyError, DeviceError: before anything is sent.
        ContourFileError: the file was truncated or changed while it played; the array is off.
        DeviceError (with `report`), PlayInterrupted: while playing.

    >>> from palpate.render import play_file, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> play_file(path, duration=0.01, clock="virtual")
    Playback(PlayReport(emulator EMU0001: 100 frames at 10000 Hz, 0 underruns, off), 0 jumps, 0 silenced)
    """
    preparation, arrays = _Preparation(compiling), arrays_of(array)
    if connection is not None and fields:
        raise StrategyError(f"{min(fields)} is a field of connection, which is given, too")
    connection = connection or Connection(**fields)
    form = frame_format(path)
    if form == WIRE_FRAMES:
        with PreparedFrames(path, repeats=repeats) as prepared:
            arrays = prepared.sized(arrays)
            prepared.require_fitting(arrays, sampling, drive, duration)
            return _play(prepared, arrays, limits, connection, watch, preparation)
    with open_focal_points(Path(path), sampling, duration, arrays, has_points=form == FOCAL_POINTS) as (source, file):
        arrays = with_points(arrays, source.foci)
        driver = _driver_of(arrays, drive, source, device)
        preparation.need(source, driver)
        return _play(
            MadeFrames(source, driver, repeats=repeats, file=file), arrays, limits, connection, watch, preparation
        )


def play_contours(
    contours: ContourRows,
    *,
    array: str | Sequence[PlacedArray] = "emulator",
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    duration: float | None = None,
    repeats: int = 1,
    limits: Limits | None = None,
    connection: Connection | None = None,
    device: str = "cpu",
    watch: Callable[[LiveStatistics, int], object] | None = None,
) -> Playback:
    """Play contours that are in memory; arguments and errors as for `play_file`."""
    preparation, arrays = _Preparation(None), arrays_of(array)
    source = contour_source(contours, sampling, duration, arrays)
    arrays = with_points(arrays, source.foci)
    driver = _driver_of(arrays, drive, source, device)
    preparation.need(source, driver)
    frames = MadeFrames(source, driver, repeats=repeats)
    return _play(frames, arrays, limits, connection or Connection(), watch, preparation)


def _driver_of(arrays: Sequence[PlacedArray], drive: DriveStrategy | None, source: FocusSource, device: str) -> Driver:
    models = [placed.model for placed in arrays]
    return Driver(models, drive, update_rate=source.update_rate, device=device)


def _play(
    frames: WireFrames,
    arrays: Sequence[PlacedArray],
    limits: Limits | None,
    connection: Connection,
    watch: Callable[[LiveStatistics, int], object] | None,
    preparation: _Preparation,
) -> Playback:
    """Play frames, whatever they are made of: the player's limits and the watchdogs hold for all."""
    for placed in arrays:
        placed.model.divider(frames.update_rate)
    with connection.all_of(arrays) as links:
        preparation.compile()  # an array that cannot be reached is refused before, and none has been started yet
        reports = play_together(
            links,
            preparation.timed(frames),
            update_rate=frames.update_rate,
            limits=limits,
            watch=None if watch is None else lambda live: watch(live, frames.frame_count),
        )
    return Playback(tuple(reports), frames.making, frames.repeats, preparation.first_frame_seconds)
