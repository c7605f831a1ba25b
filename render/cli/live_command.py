"""What `live` does."""

import signal
import threading
import time
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path
from typing import Any, cast

from rich.progress import Progress, TextColumn

from ...datasets.counted import counted
from ...device.link import TransportKind
from ...device.playing.signals import ending_on_signals
from ..errors import StrategyError
from ..hands.hand import Palm
from ..intersection.named_inputs import load_solid
from ..live.counts import RunStatistics
from ..live.handle import Live
from ..live.recorder import spool_folder
from ..live.sources.pose_stream import ANY
from ..live.spool import finish_spool
from ..objects.mesh.placement import Placement
from ..objects.solid import Solid
from ..playback.file_playback import Connection
from ..playback.focal_points import sampling_for
from ..playback.placed_arrays import PlacedArray, load_rig
from ..runtime.warp_start import start_warp
from ..sampling.strategy import SamplingStrategy
from ..strategies.intersection_strategy import IntersectionStrategy, load_strategy
from ..terminal import bars, console
from ..terminal.foreign_text import print_message, shows_progress
from ..terminal.keys import pressed_keys
from ..view.served.viewing import LiveViewer, announce
from .array_options import LiveCommand
from .play_commands import drive_of, limits_of
from .shared_options import PlacementOptions

POLL = 0.05  # [s] between looks at the keyboard
LINE_PERIOD = 0.25  # [s]
INTENSITY_STEP = 0.1
KEYS = "keys: o object, s strategy, m sampling, + - intensity, space none, q end"
SHOWN = (
    "seconds", "latency_p50", "latency_p99", "latency_longest", "age_p50", "age_p99", "poses", "superseded",
    "poses_refused",
    "skipped", "frames", "dropped", "dropped_seconds", "stalls", "emission", "realtime", "pose_seconds", "faults",
    "off_confirmed", "files",
)  # fmt: skip


@dataclass
class Choices:
    """What keys choose among; the first of each is what runs at the start."""

    solids: list[Solid]
    strategies: list[IntersectionStrategy]
    samplings: list[SamplingStrategy]


def run_live(job: LiveCommand, *, as_json: bool) -> int:
    """Run until the end of the time, key q, or a signal; report."""
    start_warp()
    arrays = load_rig(job.array, serial=job.serial, calibration=job.calibration, baud=job.baud)
    choices = _choices(job, arrays, as_json=as_json)
    if job.finish:
        return _finish(choices.solids[0], job.record, overwrite=job.overwrite, as_json=as_json)
    # The port may be taken, so that the page is served before the array is opened.
    with LiveViewer(job.port) if job.view else nullcontext() as viewer:
        run, ended_by = _run_until_ended(choices, arrays, job, viewer, quiet=as_json)
    statistics = run.statistics()
    values = statistics.as_dict()
    values["poses_refused"] = values.pop("refused")  # "refused" are focal points, in other tables
    for name in ("latency", "latency_recent", "age"):
        times = values.pop(name)
        values |= {f"{name}_{which}": times[which] for which in ("p50", "p99", "longest")}
    values |= {
        "off_confirmed": run.outcome.get("off_confirmed"),
        "arrays": run.outcome.get("arrays"),
        "files": [str(path) for path in run.files],
        "ended_by": ended_by,
    }
    console.show_values(values, as_json=as_json, title="live", shown_names=SHOWN, unknown=("off_confirmed",))
    console.conclude(_meaning(statistics), as_json=as_json)
    if ended_by in (None, "", "SIGINT"):
        return console.FAILED if statistics.faults and not statistics.poses else console.DONE
    return 128 + signal.Signals[ended_by]


def _run_until_ended(
    choices: Choices,
    arrays: tuple[PlacedArray, ...],
    job: LiveCommand,
    viewer: LiveViewer | None,
    *,
    quiet: bool,
) -> tuple[Live, str | None]:
    """Run until the end of the time, key q, or a signal; the run, and the name of the signal."""
    run = Live(
        choices.solids[0],
        hand=Palm(*job.palm) if job.palm else job.hand,
        strategy=choices.strategies[0],
        sampling=choices.samplings[0],
        source=job.source,
        array=arrays,
        drive=drive_of(job),
        lead=job.lead,
        intensity=job.intensity,
        limits=limits_of(job),
        record=job.record,
        overwrite=job.overwrite,
        realtime=job.realtime,
        told=console.warn,
        side=job.side or ANY,
        alignment=job.alignment,
        prediction=job.prediction,
        smoothing=job.smoothing,
        allow_code=job.allow_code,
        connection=Connection(
            emulate=job.emulate,
            transport=cast("TransportKind", job.transport),
            uncalibrated=job.uncalibrated,
            watchdog=job.watchdog,
        ),
    )
    if job.realtime and not run.statistics().realtime:
        console.warn(
            "no real-time scheduling is permitted, so a busy machine drops more focal points: allow it with the limit "
            "rtprio in /etc/security/limits.conf, or give a longer --lead"
        )
    ended_by = None
    with ending_on_signals():
        try:
            if viewer is not None:
                viewer.follow(run, arrays)
                announce(viewer.address, "the hand that moves now", no_browser=job.no_browser)
            with (
                run,
                _live_line(run, quiet=quiet) as show,
                pressed_keys() as keys,
            ):
                _follow(run, Keys(run, choices), keys, show, job.duration)
        except KeyboardInterrupt as interruption:
            ended_by = str(interruption)
    return run, ended_by


def _finish(solid: Solid, record: Path | None, *, overwrite: bool, as_json: bool) -> int:
    """Make the file of a run that was killed, of the object that it rendered first."""
    if record is None:
        raise StrategyError("--finish needs --record, the file of the run that was killed")
    if not spool_folder(record).exists():
        whole = "is there, so its run was not killed" if record.exists() else "is not there, nor is what a run left"
        raise StrategyError(f"{record} {whole}: there is nothing to finish")
    made = finish_spool(spool_folder(record), record, solid, overwrite=overwrite)
    console.show_values({"files": [] if made is None else [str(made)]}, as_json=as_json, title="live")
    console.conclude("nothing had been drawn." if made is None else f"{made} has what was drawn.", as_json=as_json)
    return console.DONE


def _choices(job: LiveCommand, arrays: tuple[PlacedArray, ...], *, as_json: bool) -> Choices:
    """Everything that keys may choose, loaded before anything runs: an error is told at the start."""
    placement = Placement(**job.part(PlacementOptions))
    solids = []
    for name in job.solids:
        with bars.progress_bar(name, quiet=as_json) as watch:
            solids.append(load_solid(name, placement, watch=watch))
    samplings = [sampling_for(name, arrays) for name in job.sampling or ["stm"]]
    if (rate := job.update_rate) is not None:
        samplings = [replace(own, update_rate=rate) for own in samplings]
    rates = sorted({own.update_rate for own in samplings})
    if len(rates) > 1:
        raise StrategyError(f"--sampling: all must have one update rate, not {rates} Hz; --update-rate sets it")
    return Choices(solids, [load_strategy(name) for name in job.strategy], samplings)


class Keys:
    """What keys do. Another object, strategy or sampling is prepared in a thread, one at a time."""

    def __init__(self, run: Live, choices: Choices) -> None:
        self.is_ended = False
        self._run = run
        self._next = {
            key: (name, cycle(own[1:] + own[:1]), len(own))
            for key, name, own in (
                ("o", "solid", choices.solids),
                ("s", "strategy", choices.strategies),
                ("m", "sampling", choices.samplings),
            )
        }
        self._before = 0.0  # intensity that space takes back
        self._changing: threading.Thread | None = None

    def press(self, key: str) -> None:
        """Do what one key says."""
        intensity = self._run.intensity
        if key == "q":
            self.is_ended = True
        elif key in "+-":
            step = INTENSITY_STEP if key == "+" else -INTENSITY_STEP
            self._run.set_intensity(min(max(round(intensity + step, 3), 0.0), 1.0))
        elif key == " ":
            self._run.set_intensity(0.0 if intensity else self._before or 1.0)
            self._before = intensity
        elif key in self._next:
            self._choose(*self._next[key])

    def _choose(self, name: str, values: Any, count: int) -> None:
        if count == 1:
            print_message(f"there is no other {name}: give several", "note")
        elif self._changing is not None and self._changing.is_alive():
            print_message("still preparing the one before", "note")
        else:
            self._changing = threading.Thread(target=self._change, args=({name: next(values)},), daemon=True)
            self._changing.start()

    def _change(self, fields: dict[str, Any]) -> None:
        try:
            self._run.change(**fields)
        except Exception as error:  # in a thread of its own, whose end nobody looks at: what runs goes on
            console.warn(str(error))

    def finish(self) -> None:
        """Wait for a change that is under way."""
        if self._changing is not None:
            self._changing.join()


def _follow(
    run: Live, keys: Keys, pressed: Callable[[], str], show: Callable[[], object], duration: float | None
) -> None:
    """Until the time is over, a key ends it, or something fails, which is raised."""
    end = float("inf") if duration is None else time.monotonic() + duration
    shown = 0.0
    while not keys.is_ended and (now := time.monotonic()) < end:
        run.wait(min(POLL, end - now))
        for key in pressed():
            keys.press(key)
        if now - shown >= LINE_PERIOD:
            shown = now
            show()
    keys.finish()


@contextmanager
def _live_line(run: Live, *, quiet: bool) -> Any:
    """A line of statistics on standard error, where that is a terminal; yields a function that renews it."""
    if quiet or not shows_progress():
        yield lambda: None
        return
    print_message(KEYS, "note")
    with Progress(TextColumn("{task.description}", markup=False), console=bars.screen(), transient=True) as progress:
        task = progress.add_task("waiting for a hand", total=None)
        yield lambda: progress.update(task, description=_line(run))


def _line(run: Live) -> str:
    own = run.statistics()
    if not own.poses:
        return "waiting for a hand"
    recent = own.latency_recent
    return (
        f"{run.described()}, intensity {run.intensity:g}: {recent.p50 * 1e3:.1f} ms from hand to array "
        f"(99 %: {recent.p99 * 1e3:.1f}), {own.dropped} of {own.frames} frames dropped"
    )


def _meaning(own: RunStatistics) -> str:
    if not own.poses:
        return "no pose could be drawn, so the array was silent."
    met = "" if own.frames_on else " The hand never met the object, so the array was silent."
    where = "a model of the board says" if own.emission == "board" else "the writer estimates"
    return (
        f"{counted(own.poses, 'pose')} in {own.seconds:.3g} s; from the time stamp of a pose to its first focal point "
        f"{own.latency.p50 * 1e3:.1f} ms, for 99 % at most {own.latency.p99 * 1e3:.1f} ms, as {where}; "
        f"{counted(own.dropped, 'frame')} dropped, in {counted(own.dropped_seconds, 'second')}.{met}"
    )
