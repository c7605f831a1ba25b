"""`palpate info` and `palpate check`: what files hold, and whether they are whole."""

from pathlib import Path

from ...datasets.contour_file.check import check_file, unproven_content
from ...datasets.counted import counted
from ...datasets.focus_files.frame_reader import check_frames, frame_format
from ...datasets.sweeps.merging import check_store, is_store
from ..errors import StrategyError
from ..intersection.named_inputs import refuse_options
from ..objects.mesh.solid_mesh import is_mesh_name, mesh_facts
from ..reports.file_summary import summarise, summarise_frames
from ..runtime.warp_start import start_warp
from ..terminal import bars, console
from ..terminal.foreign_text import print_message
from ..validation import refuse_object
from .contour_options import CheckCommand, InfoCommand
from .shared_options import MeshOptions


def run_info(job: InfoCommand, *, as_json: bool) -> None:
    """Summarise files, one after the other; none if one is missing."""
    for file in job.files:
        if is_store(file):
            raise StrategyError(f"{file} is a sweep's store: palpate sweep status {file} shows it")
    for file in job.files:
        show_info(file, job, as_json=as_json)


def show_info(file: Path, job: InfoCommand, *, as_json: bool) -> None:
    """Summarise: contours, frames that a sweep keeps, or what loading finds in a mesh with the given options."""
    options = {"scale": job.scale, **job.part(MeshOptions)}
    if job.pressure and (is_mesh_name(str(file)) or frame_format(file) is not None):
        raise StrategyError(f"--pressure is of contour files, and {file} is none")
    if is_mesh_name(str(file)):
        start_warp()
        with bars.progress_bar(str(file), quiet=as_json) as watch:
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
    with bars.progress_bar(f"reading {file}", quiet=as_json):
        summary = summarise(file)
    if not summary["sealed"]:
        console.warn(
            f"{file} is still being written, or was interrupted: "
            f"{summary['poses_done']} of {summary['poses']} poses are done (palpate render --resume goes on)"
        )
    if job.pressure:
        from ..acoustics.field_metrics import pressure_metrics  # it starts Warp, which other summaries do without

        start_warp()
        with bars.progress_bar("poses", quiet=as_json) as bar:
            summary["pressure"] = pressure_metrics(file, progress=bar).as_dict()
    console.show_values(summary, as_json=as_json, title=str(file))
    if run := summary.get("live"):
        console.conclude(live_text(run), as_json=as_json)


def live_text(run: dict) -> str:
    """A sentence on the live run that a file is the recording of; run: as `summarise_run` gives it."""
    p50, p99 = run["latency_p50"], run["latency_p99"]
    latency = "its latency is not known" if p50 is None else f"latency p50 {1e3 * p50:.1f} ms, p99 {1e3 * p99:.1f} ms"
    dropped = f"{run['samples'] - run['emitted']} of {counted(run['samples'], 'sample')} were not played as drawn"
    return f"The recording of a live run of {run['duration']:.6g} s: {latency}, {dropped}."


def run_check(job: CheckCommand, *, as_json: bool) -> int:
    """Check files, one after the other; 0 all are whole, 1 not."""
    return max(check_one(file, as_json=as_json) for file in job.files)


def check_one(file: Path, *, as_json: bool) -> int:
    """Check; 0 whole, 1 not."""
    with bars.progress_bar(f"checking {file}", quiet=as_json):
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
