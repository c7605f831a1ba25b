"""What the commands do: read, render or play, and say what came of it."""

from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter

from ...datasets.contour_file.blocks import work_folder
from ...datasets.contour_file.check import check_file, unproven_content
from ...datasets.contour_file.reader import ContourFile
from ...datasets.counted import counted
from ...datasets.errors import ContourFileError, name_nothing
from ...datasets.focus_files.frame_reader import check_frames, frame_format
from ...datasets.known_names import likely_file, likely_name
from ...datasets.motions.hand_motion import HandMotion
from ...datasets.shapes.built_in import shape_names
from ...datasets.sweeps.merging import check_store, is_store
from ...kernels import PLAYING_STAGES
from ..coordinate_spacing import apart_text, joining_place
from ..errors import StrategyError
from ..intersection.file_recording import record
from ..intersection.named_inputs import is_recording, load_hand_and_motion, load_solid, refuse_options, simplified
from ..intersection.scene import method_of
from ..objects.mesh.placement import Placement
from ..objects.mesh.summary import is_mesh_name, mesh_facts
from ..playback.pose_insertion import insert_poses
from ..reports.file_summary import summarise, summarise_frames
from ..runtime.kernel_compiling import CompilingAhead
from ..runtime.warp_start import start_warp
from ..runtime.worker_devices import worker_devices
from ..strategies.intersection_strategy import load_strategy
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from ..validation import refuse_object

SUFFIXES = (".h5", ".hdf5")
FUSED_MOST = 0.2  # share of contours nearer than a focal width to another, from which a rendering is warned of
VOXELISED_KINDS = ("distance", "occupancy")
SHOWN_OF_RENDERING = ("poses", "poses_drawn", "polylines", "length_mean", "r", "bytes", "poses_rendered", "seconds")


@dataclass(frozen=True)
class RenderJob:
    """All options of `palpate render`."""

    source: str
    motion: str
    out: Path
    strategy: str
    step: float | None
    flush: float | None
    hand: str
    palm: tuple[float, float] | None
    volume: dict
    mesh: dict
    bounds: tuple[float, ...] | None
    simplify: float | None
    object_motion: str | None
    side: str | None
    alignment: Path | None
    placement: dict
    exploration: dict
    interpolate: float | None
    device: str
    workers: str
    memory: int | None
    gzip: int
    allow_code: bool
    resume: bool
    overwrite: bool
    strict: bool


def worker_count(text: str) -> int | None:
    """A number of workers, None for "auto"; raises StrategyError for what is neither."""
    if text == "auto":
        return None
    if not text.isdecimal():
        raise StrategyError(f"--workers must be a number or auto, not {text!r}")
    return int(text)


def warn_removed(removed_mean: dict[str, float]) -> None:
    """Warn that nothing is left to draw, with the stages that removed it."""
    removed = ", ".join(f"{stage} {length:.3g} m" for stage, length in removed_mean.items() if length)
    console.warn(f"the prune stages removed every contour (mean a pose: {removed})")


def run_render(options: dict, *, as_json: bool) -> int:
    """Render, write, summarise; the options are those of `RenderJob`."""
    job = RenderJob(**options)
    if job.resume and job.overwrite:
        raise StrategyError("--resume and --overwrite exclude each other")
    if job.out.suffix not in SUFFIXES:
        raise StrategyError(f"{job.out}: a contour file must end in {' or '.join(SUFFIXES)}")
    start_warp()
    devices = worker_devices(job.device, worker_count(job.workers))
    strategy = load_strategy(job.strategy, allow_code=job.allow_code)
    if job.step is not None:
        strategy = replace(strategy, step=job.step)
    if job.flush is not None:
        strategy = replace(strategy, flush=job.flush)
    with bars.loading_bar(job.source, quiet=as_json) as watch:
        options = {"volume": job.volume, "mesh": job.mesh, "bounds": job.bounds}
        placement = Placement(**job.placement)
        whole = load_solid(job.source, placement, **options, allow_code=job.allow_code, watch=watch)
    solid, detail = simplified(whole, job.simplify)
    if strategy.needs_closed:
        solid.require_closed()
    with bars.loading_bar(job.motion, quiet=as_json) as watch:
        hand, motion = load_hand_and_motion(
            job.hand,
            job.palm,
            job.motion,
            solid,
            exploration_options=job.exploration,
            side=job.side,
            alignment=job.alignment,
            watch=watch,
        )
    if job.step is not None and method_of(solid, hand, strategy) == "cut":
        raise StrategyError(f"--step is of a grid on the skin, but {solid.name} is a mesh, cut exactly by {job.hand}")
    object_pose = None
    if job.object_motion is not None:
        with bars.loading_bar(job.object_motion, quiet=as_json):
            object_pose = HandMotion.load(job.object_motion)
    started = perf_counter()
    if job.interpolate is not None:
        motion = insert_poses(
            solid, hand, motion, strategy, distance=job.interpolate, object_pose=object_pose, device=devices[0]
        )
    ahead = CompilingAhead(PLAYING_STAGES)
    try:
        with ahead, bars.progress_bar("poses rendered, saved every 10 s", quiet=as_json) as bar:
            recording = record(
                job.out,
                solid,
                hand,
                motion,
                strategy,
                object_pose=object_pose,
                mode="resume" if job.resume else "overwrite" if job.overwrite else "create",
                devices=devices,
                memory=job.memory,
                gzip=job.gzip,
                progress=bar,
            )
    except KeyboardInterrupt:
        message = f"interrupted: {poses_saved(job.out)} of {len(motion)} poses are saved, --resume goes on"
        return console.fail(message, console.FAILED, as_json)
    seconds = perf_counter() - started
    for repair in recording.repairs:
        console.warn(repair)
    with bars.loading_bar(f"reading {job.out}", quiet=as_json):
        summary = summarise(job.out)
    summary |= {"poses_rendered": recording.rendered, "seconds": seconds}
    if detail is not None:
        summary |= {"detail": asdict(detail)}
    is_empty = not summary["poses_drawn"]
    console.show_values(summary, as_json=as_json, title=str(job.out), shown_names=SHOWN_OF_RENDERING)
    if is_empty and any(summary.get("removed_mean", {}).values()):  # they met
        warn_removed(summary["removed_mean"])
    elif is_empty and object_pose is not None:
        console.warn(f"no pose has a contour of the object, which {job.object_motion} moves; see --object-motion")
    elif is_empty:
        tracked = is_recording(job.motion) and job.alignment is None
        moving = f"--at {joining_place(motion.pose)} moves the object into the middle of the motion, --scale its size"
        way = "see --alignment: the recording is in its tracker's frame" if tracked else moving
        console.warn(f"{apart_text(solid.bounds, motion.pose)}; {way}. The same command replaces this empty file")
    elif (share := summary["fused_share"] or 0.0) > FUSED_MOST:
        console.warn(
            f"{100 * share:.0f} % of the contours' length is nearer than a focal width (10 mm at a height of 0.2 m) to "
            "another contour, and a hand feels both as one band. Thicker walls, scale=FACTOR or the prune stage "
            "close-together make them distinct"
        )
    with suppress(KeyboardInterrupt), bars.loading_bar("compiling kernels for palpate play", quiet=as_json):
        ahead.wait()  # for the module under way, as results are complete; Ctrl-C leaves it, too
    return console.FAILED if is_empty and job.strict else console.DONE


def run_info(files: list[Path], options: dict, pressure: bool, *, as_json: bool) -> None:
    """Summarise files, one after the other; none if one is missing."""
    for file in files:
        if not _is_begun(file) and not is_mesh_name(str(file)):
            meant = likely_name(str(file), shape_names()) or likely_file(file)
            raise name_nothing(ContourFileError(f"{file} does not exist{meant}"))
        if is_store(file):
            raise StrategyError(f"{file} is a sweep's store: palpate sweep status {file} shows it")
    for file in files:
        show_info(file, options, pressure, as_json=as_json)


def poses_saved(file: Path) -> int:
    """Poses of a rendering that was stopped which its folder holds, or the file if it is whole; 0 if neither is read.

    The folder goes first: beside it, the file is the old one that the rendering would have replaced.
    """
    folder = work_folder(file)
    try:
        with ContourFile(folder if folder.is_dir() else file) as contours:
            return sum(stop - first for first, stop in contours.done)
    except ContourFileError:
        return 0


def _is_begun(file: Path) -> bool:
    """Whether a file is there, or the folder in which it is being written."""
    return file.exists() or work_folder(file).exists()


def show_info(file: Path, options: dict, pressure: bool, *, as_json: bool) -> None:
    """Summarise: contours, frames that a sweep keeps, or what loading finds in a mesh with the given options."""
    if pressure and (is_mesh_name(str(file)) or frame_format(file) is not None):
        raise StrategyError(f"--pressure is of contour files, and {file} is none")
    if is_mesh_name(str(file)):
        start_warp()
        with bars.loading_bar(str(file), quiet=as_json) as watch:
            facts = mesh_facts(str(file), options, watch)
        facts = {name: console.worded(value) if isinstance(value, str) else value for name, value in facts.items()}
        names = [name for name, value in facts.items() if value not in (0, "")]
        console.show_values(facts, as_json=as_json, title=str(file), shown_names=names)
        return
    refuse_options(options, "of a mesh", str(file))
    refuse_object(file)
    if frame_format(file) is not None:
        console.show_values(summarise_frames(file), as_json=as_json, title=str(file))
        return
    with bars.loading_bar(f"reading {file}", quiet=as_json):
        summary = summarise(file)
    if not summary["sealed"]:
        console.warn(
            f"{file} is still being written, or was interrupted: "
            f"{summary['poses_done']} of {summary['poses']} poses are done (palpate render --resume goes on)"
        )
    if pressure:
        summary["pressure"] = pressure_summary(file, as_json=as_json)
    console.show_values(summary, as_json=as_json, title=str(file))
    if run := summary.get("live"):
        console.conclude(live_text(run), as_json=as_json)


def live_text(run: dict) -> str:
    """A sentence on the live run that a file is the recording of; run: as `summarise_run` gives it."""
    p50, p99 = run["latency_p50"], run["latency_p99"]
    latency = "its latency is not known" if p50 is None else f"latency p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms"
    dropped = f"{run['samples'] - run['emitted']} of {counted(run['samples'], 'sample')} were not played as drawn"
    return f"The recording of a live run of {run['duration']:.6g} s: {latency}, {dropped}."


def pressure_summary(file: Path, *, as_json: bool) -> dict:
    """Pressure of a sample of a file's poses, by the names of `PressureMetrics`."""
    from ..acoustics.field_metrics import pressure_metrics  # it starts Warp, which other summaries do without

    start_warp()
    with bars.progress_bar("poses", quiet=as_json) as bar:
        return pressure_metrics(file, progress=bar).as_dict()


def run_check(files: list[Path], *, as_json: bool) -> int:
    """Check files, one after the other; 0 all are whole, 1 not."""
    for file in files:
        if not _is_begun(file):
            refuse_object(file)
            raise name_nothing(ContourFileError(f"{file} does not exist{likely_file(file)}"))
    return max(check_one(file, as_json=as_json) for file in files)


def check_one(file: Path, *, as_json: bool) -> int:
    """Check; 0 whole, 1 not."""
    with bars.loading_bar(f"checking {file}", quiet=as_json):
        if is_store(file):
            problems, unproven = check_store(file), []
        else:
            refuse_object(file)
            problems = check_file(file) if frame_format(file) is None else check_frames(file)
            unproven = unproven_content(file)
    if as_json:
        result = {"path": str(file), "whole": not problems, "problems": problems}
        console.show_values(result | ({"unproven": unproven} if unproven else {}), as_json=True, title="")
        return console.FAILED if problems else console.DONE
    for problem in problems:
        print_message(problem, "error")
    if not problems:
        console.show_values(
            {"whole": "yes", "without digests": "; ".join(unproven) or None}, as_json=False, title=str(file)
        )
    return console.FAILED if problems else console.DONE
