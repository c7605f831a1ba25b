"""`palpate figure`: contour files as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from ...datasets.contour_file.reader import ContourFile
from ..errors import StrategyError
from ..reports.contour_figure import draw_figure
from ..terminal import bars, console
from .contour_options import FigureCommand


def moments(job: FigureCommand) -> list[float] | None:
    """The times that are asked for; raises StrategyError for what is no list of numbers."""
    if job.times is None:
        return None
    try:
        return [float(text) for text in job.times.split(",")]
    except ValueError:
        raise StrategyError(f"--times must be numbers with commas between, as 1.5,7, not {job.times!r:.60}") from None


def labelled(job: FigureCommand) -> Sequence[Path] | Mapping[str, Path]:
    """Files by the labels that are asked for, if any; raises StrategyError for too few or equal ones."""
    if not job.label:
        return job.files
    if len(job.label) != len(job.files):
        raise StrategyError(f"--label must be given once for each file: {len(job.label)} for {len(job.files)} files")
    if not all(label.strip() for label in job.label):
        raise StrategyError("--label must be a name, not an empty text")
    if len(set(job.label)) < len(job.files):
        raise StrategyError(f"--label: two files are named alike, in {job.label}")
    return dict(zip(job.label, job.files, strict=True))


def run_figure(job: FigureCommand, *, as_json: bool) -> None:
    """Draw."""
    _warn_unfinished(job.files)
    with bars.progress_bar(f"drawing {job.out}", quiet=as_json):
        draw_figure(
            labelled(job),
            job.out,
            times=moments(job),
            view=job.view,
            array=None if job.no_array else job.array or "emulator",
            width=job.width,
            font_size=job.font_size,
            overwrite=job.overwrite,
        )
    console.show_values({"picture": str(job.out)}, as_json=as_json, title="figure")


def _warn_unfinished(files: Sequence[Path]) -> None:
    for path in files:
        with ContourFile(path) as file:
            if not file.sealed:
                done = sum(stop - first for first, stop in file.done)
                console.warn(
                    f"{path} is still being written, or was interrupted: the picture shows {done} of {file.pose_count} "
                    "poses (palpate render --resume goes on)"
                )
