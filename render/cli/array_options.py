"""The commands that play to an array, or that measure and compare, as their options."""

# ruff: noqa: RUF009  # option(), switch() and argument() give fields of dataclasses

from dataclasses import dataclass
from pathlib import Path

from ..errors import StrategyError
from ..output_file import require_output
from ..validation import choose
from .inputs import (
    OBJECTS,
    SAMPLINGS,
    STRATEGIES,
    require_contour_files,
    require_end,
    require_object,
    require_sampling,
    require_strategy,
)
from .option_fields import REQUIRED, Command, NamedOptions, argument, option, switch
from .shared_options import (
    AllowCodeOptions,
    BaudOptions,
    ClockOptions,
    DriveOptions,
    DurationOptions,
    HandOptions,
    LimitOptions,
    OpenedArrayOptions,
    OverwriteOptions,
    PageOptions,
    PlacementOptions,
    SamplingOptions,
    SourceOptions,
    TransportOptions,
    UpdateRateOptions,
)

BENCH_STRATEGIES = ("oc", "cc")
"""What `palpate bench` measures: the stages that the kernels of a mesh section do as they go, and no others."""


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PlayCommand(
    Command,
    OpenedArrayOptions,
    SamplingOptions,
    DurationOptions,
    DriveOptions,
    LimitOptions,
    TransportOptions,
    ClockOptions,
):
    """Sample a contour file and stream it to an array; the array is off on every way out."""

    job = ".play_commands:run_play"
    file: Path = argument("FILE", "Contour file, focal points (.PTLIST, or a sweep's), or prepared frames.")
    repeats: int = option("N", "How often to play it.", 1, low=1)
    device: str = option("DEVICE", "For solvers of several focal points: cpu, cuda:0.", "cpu")
    strict: bool = switch("Exit with 1 if late frames, silenced points, or too long steps are warned of.", "--strict")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_contour_files([self.file], takes_points=True)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class PrepareCommand(Command, BaudOptions, SamplingOptions, DurationOptions, DriveOptions, OverwriteOptions):
    """Write the wire bytes that `palpate play` would send, so that playing them costs the host only copying."""

    job = ".play_commands:run_prepare"
    file: Path = argument("FILE", "Contour file, or focal points: .PTLIST, or a sweep's.")
    out: Path = option("FRAMES.h5", "File of wire bytes to write.", REQUIRED, "-o")
    device: str = option("DEVICE", "cpu, or where frames of a pat16 are packed: cuda:0.", "cpu")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_contour_files([self.file], takes_points=True)
        require_output(self.out, overwrite=self.overwrite, sources=[self.file])


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class LiveCommand(
    Command,
    SourceOptions,
    HandOptions,
    OpenedArrayOptions,
    UpdateRateOptions,
    DriveOptions,
    LimitOptions,
    PlacementOptions,
    TransportOptions,
    PageOptions,
    AllowCodeOptions,
    OverwriteOptions,
):
    """Render an object on a hand that moves now; the array is off on every way out.

    Keys, in a terminal: o, s, m the next object, strategy, sampling; + and - more and less intensity; space none, or
    all again; q ends.
    """

    job = ".live_command:run_live"
    solids: list[str] = argument("OBJECT...", "Objects, of which key o chooses the next.", complete=OBJECTS)
    strategy: list[str] = option("NAME|FILE", "Intersection strategy; several for key s.", ["cc"], complete=STRATEGIES)
    sampling: list[str] | None = option(
        "NAME|FILE", "How contours become focal points, by default stm; several for key m.", complete=SAMPLINGS
    )
    duration: float | None = option("SECONDS", "End after this time [s]; else key q or Ctrl-C ends it.")
    intensity: float = option("SHARE", "Of all focal points, 0..1; keys + and -.", 1.0)
    record: Path | None = option("OUT.h5", "Contour file of all that was drawn, with its latency.")
    finish: bool = switch("Make the file --record of a run that was killed, and run nothing.", "--finish")
    view: bool = switch("Show the hand that moves now, and what is drawn on it, in the browser.", "--view")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        if self.duration is not None and not 0 < self.duration < float("inf"):  # a NaN compares false
            raise StrategyError(f"--duration must be above 0 s, not {self.duration}")
        for name in ("port", "no_browser"):
            if getattr(self, name) and not self.view:
                raise StrategyError(f"--{name.replace('_', '-')} is of the page that --view shows")
        if self.record is not None:
            require_end(self.record, (".h5", ".hdf5"), "a contour file")
        for name in self.solids:
            require_object(name)
        for name in self.strategy:
            require_strategy(name)
        for name in self.sampling or ():
            require_sampling(name)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SamplingCommand(Command):
    """List sampling presets, or print one as the JSON that --sampling takes: a start for one of your own."""

    job = ".listing_commands:run_sampling"
    given = ("name",)
    name: str | None = argument("[NAME|FILE]", "A preset, or a JSON file.", None, complete=SAMPLINGS)

    def judge(self) -> None:
        """Refuse a misspelt preset."""
        require_sampling(self.name)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class DevicesCommand(Command):
    """List the arrays that can be played to, and why one cannot be opened."""

    job = ".listing_commands:run_devices"
    given = ("calibration",)
    calibration: list[Path] | None = option(
        "BOARD.pat", "Board file of a pat16, which it recognises by the serial number. May be repeated."
    )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SelftestCommand(NamedOptions, OpenedArrayOptions, ClockOptions, OverwriteOptions):
    """Play a point, a circle and a slow turn for a hand above the array."""

    job = "..selftest.stimuli:run_selftest"
    report: Path | None = option("FILE", "Ask what was felt, and write answers and figures as JSON, to be sent back.")
    height: float = option("METRES", "Of the hand above the array [m].", 0.2)
    duration: float = option("SECONDS", "Of each of the three stimuli [s].", 3.0)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class BenchCommand(Command):
    """Time contours of random palms on this machine: one row for each object and strategy."""

    job = "..bench.speed:run_bench"
    given = ("objects", "strategy", "device", "poses")
    objects: str = option(
        "NAME,...", "Built in, or blob-N of about N triangles (blob-5000).", "cube,tube,sphere,blob-100k"
    )
    strategy: str = option("NAME,...", "oc, cc, or both.", "oc,cc")
    device: str = option("DEVICE", "cpu, cuda:0, ...", "cpu")
    poses: int | None = option("N", "By default half a second of them, on a GPU 4,000,000.", low=1, high=10**8)

    def judge(self) -> None:
        """Refuse strategies of further stages, which are not measured."""
        for name in self.strategy.split(","):
            choose("--strategy", name.strip(), BENCH_STRATEGIES)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class ReproduceCommand(Command, OverwriteOptions):
    """Make the founding paper's evaluation again: its figures and numbers beside palpate's, as HTML and JSON."""

    job = "..reproduction.command:run_reproduce"
    given = ("out", "explorers", "repetitions", "palm", "recording", "overwrite")
    out: Path = option("FOLDER", "Where the report goes; made if it is missing.", Path("palpate-reproduction"), "-o")
    explorers: int = option("N", "How many explore each object.", 18, low=1)
    repetitions: int = option(
        "N", "Explorations of 7 s in each of the two blocks that an explorer has with an object.", 10, low=1
    )
    palm: tuple[float, float] | None = option("WIDTH LENGTH", "Size of the palm [m], by default 0.085 0.085.")
    recording: float = option("SECONDS", "Of each of ten recordings of noise [s]; 0: no noise.", 30.0)
