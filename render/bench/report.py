"""`palpate bench`: palpate and published libraries on the same poses, in turns, beside the speed of memory."""

import platform
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import warp as wp
from rich.console import Console

from ...datasets.known_names import unknown_name
from ..errors import StrategyError
from ..runtime.span_workers import warp_device
from ..runtime.warp_start import start_warp
from ..strategies.intersection_strategy import PRESETS
from ..terminal import bars, console
from ..terminal.foreign_text import plain
from .cases import MOTIONS, bench_object
from .curves import FREQUENCIES, POSE_COUNTS, Curve, pose_curve, triangle_curve
from .first_use import FirstUse, measure_first_use
from .peers import find_peers, one_core, peer_names
from .rows import Row, measure_row
from .tables import show_curve, show_first_use, show_rows
from .turns import BenchOptions

SCREEN_WIDTH = 130  # columns that the tables need; a narrower terminal wraps them
PACKAGES = ("palpate", "warp-lang", "numpy", "shapely")


@dataclass(frozen=True)
class BenchJob:
    """Options of `palpate bench`."""

    device: str
    objects: str
    """Names separated by commas, or none."""
    strategies: str
    poses: int | None
    repeats: int
    peers: str
    motion: str
    one_core: bool
    curve: bool
    first_use: bool

    def __post_init__(self) -> None:
        """Refuse, before anything is measured, what would fail later."""
        if self.poses is not None and self.poses < 1:
            raise StrategyError(f"poses must be at least 1, not {self.poses}")
        if self.repeats < 1:
            raise StrategyError(f"repeats must be at least 1, not {self.repeats}")
        if self.motion not in MOTIONS:
            raise StrategyError(unknown_name("motion", self.motion, MOTIONS))
        peer_names(self.peers)
        for name in names_in(self.strategies):
            if name not in PRESETS:
                raise StrategyError(unknown_name("strategy", name, PRESETS))

    def options(self) -> BenchOptions:
        """How rows are measured."""
        return BenchOptions(
            device=warp_device(self.device),
            poses=self.poses,
            motion=self.motion,
            repeats=self.repeats,
            one_core=self.one_core,
        )


@dataclass(frozen=True)
class BenchReport:
    """Every figure, and what made it."""

    date: str
    machine: dict
    versions: dict
    options: dict
    core: int | None
    """Which one the process was kept to."""
    rows: tuple[Row, ...]
    curves: tuple[Curve, ...]
    first_use: FirstUse | None


def names_in(text: str) -> list[str]:
    """Names separated by commas, each once; none is no name."""
    return [] if text == "none" else list(dict.fromkeys(name.strip() for name in text.split(",")))


def run_bench(options: dict, *, as_json: bool) -> int:
    """Measure and report; the options are those of `BenchJob`."""
    job = BenchJob(**options)
    start_warp()
    report = measure(job, quiet=as_json)
    if as_json:
        console.show_values(asdict(report), as_json=True, title="")
        return console.DONE
    screen = Console(highlight=False, soft_wrap=True, width=max(Console().width, SCREEN_WIDTH))
    if report.rows:
        show_rows(report.rows, screen)
    for curve in report.curves:
        show_curve(curve, screen)
    if report.first_use:
        show_first_use(report.first_use, screen)
    screen.print(plain(f"{report.date}, {report.machine['cpu']}, {report.machine['device']}"))
    return console.DONE


def measure(job: BenchJob, *, quiet: bool = True) -> BenchReport:
    """Everything that the job asks for, with a bar of the rows and points done.

    Raises StrategyError for unknown names, before anything is measured.
    """
    options, names, strategies = job.options(), names_in(job.objects), names_in(job.strategies)
    things = {name: bench_object(name) for name in names}
    total = len(names) * len(strategies) + job.curve * (len(FREQUENCIES) + len(POSE_COUNTS)) + job.first_use
    done = 0
    with bars.progress_bar("bench", quiet=quiet) as bar:

        def row_done() -> None:
            nonlocal done
            done += 1
            bar(done, total)

        first = measure_first_use(options.device) if job.first_use else None  # on all cores, as a user has it
        with one_core(job.one_core) as core:
            found, absent = find_peers(job.peers)
            rows = []
            for name, mesh in things.items():
                for strategy in strategies:
                    rows.append(measure_row(name, mesh, strategy, found, absent, options))
                    row_done()
            curves = (triangle_curve(options, done=row_done), pose_curve(options, done=row_done)) if job.curve else ()
    return BenchReport(
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        machine=machine_facts(options.device),
        versions=package_versions(),
        options=asdict(job),
        core=core,
        rows=tuple(rows),
        curves=curves,
        first_use=first,
    )


def machine_facts(device: str) -> dict:
    """Names of the processor and the device."""
    target = wp.get_device(device)
    facts = {"cpu": _processor(), "device": target.name if target.is_cuda else "cpu", "system": platform.platform()}
    if target.is_cuda:
        facts["cuda_driver"] = ".".join(str(part) for part in wp.get_cuda_driver_version() or ())
    return facts


def package_versions() -> dict:
    """Versions of palpate and what it stands on; peers tell theirs in their rows."""
    facts = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            facts[package] = version(package)
        except PackageNotFoundError:
            continue
    return facts


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()
