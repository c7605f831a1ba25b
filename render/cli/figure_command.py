"""`palpate figure`: contour files as a picture, or as an animated one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...datasets.contour_file.reader import ContourFile
from ..errors import StrategyError
from ..exports.pose_choice import seconds_of
from ..reports.contour_animation import WIDTH_USUAL, draw_animation
from ..reports.contour_figure import draw_figure
from ..reports.picture_page import font_of, width_of
from ..reports.picture_style import SUFFIXES, require_picture
from ..terminal import bars, console
from ..validation import refuse_object

ANIMATION_ONLY = {"seconds": "--seconds", "frame_rate": "--frame-rate"}


@dataclass(frozen=True)
class FigureJob:
    """All options of `palpate figure`."""

    out: Path
    times: str | None
    view: str
    array: str | None
    no_array: bool
    label: list[str] | None
    animate: bool
    seconds: str | None
    frame_rate: float | None
    width: str | None
    font_size: float | None
    overwrite: bool

    def __post_init__(self) -> None:
        """Raise StrategyError for options that exclude each other, and for an output that cannot be written."""
        if self.animate and (self.no_array or self.array is not None):
            option = "--no-array" if self.no_array else "--array"
            raise StrategyError(f"{option} is of a still picture: --animate shows no array")
        if self.animate and self.times is not None:
            raise StrategyError("--times is of a still picture: --seconds chooses what --animate shows")
        if self.animate and self.font_size is not None:
            raise StrategyError("--font-size is of a still picture: texts of --animate grow with --width")
        if not self.animate:
            width_of(self.width)
            font_of(self.font_size)
        if self.no_array and self.array is not None:
            raise StrategyError("--array and --no-array exclude each other: one shows an array, the other none")
        given = [option for name, option in ANIMATION_ONLY.items() if getattr(self, name) is not None]
        if given and not self.animate:
            raise StrategyError(f"{given[0]} is of an animated picture: add --animate")
        if self.out.suffix.lower() == ".gif" and not self.animate:
            raise StrategyError(f"{self.out}: must end in one of {', '.join(SUFFIXES)}; --animate makes a .gif")
        require_picture(self.out, overwrite=self.overwrite, only=(".gif",) if self.animate else SUFFIXES)

    def moments(self) -> list[float] | None:
        """The times that are asked for; raises StrategyError for what is no list of numbers."""
        if self.times is None:
            return None
        try:
            return [float(text) for text in self.times.split(",")]
        except ValueError:
            raise StrategyError(
                f"--times must be numbers with commas between, as 1.5,7, not {self.times!r:.60}"
            ) from None

    def pixels(self) -> int:
        """Width of an animated picture; raises StrategyError for what is no whole number."""
        if self.width is not None and not (self.width.isascii() and self.width.isdigit() and len(self.width) < 9):
            raise StrategyError(f"--width of an animated picture must be a number of pixels, not {self.width!r:.60}")
        return WIDTH_USUAL if self.width is None else int(self.width)

    def labelled(self, files: Sequence[Path]) -> Sequence[Path] | Mapping[str, Path]:
        """Files by the labels that are asked for, if any; raises StrategyError for too few or equal ones."""
        if not self.label:
            return files
        if len(self.label) != len(files):
            raise StrategyError(f"--label must be given once for each file: {len(self.label)} for {len(files)} files")
        if not all(label.strip() for label in self.label):
            raise StrategyError("--label must be a name, not an empty text")
        if len(set(self.label)) < len(files):
            raise StrategyError(f"--label: two files are named alike, in {self.label}")
        return dict(zip(self.label, files, strict=True))


def run_figure(files: list[Path], options: dict, *, as_json: bool) -> None:
    """Draw."""
    for file in files:
        refuse_object(file)
    job = FigureJob(**options)
    _warn_unfinished(files)
    draw = _animate if job.animate else _draw
    console.show_values({"picture": str(job.out)} | draw(files, job, as_json=as_json), as_json=as_json, title="figure")


def _draw(files: list[Path], job: FigureJob, *, as_json: bool) -> dict:
    with bars.loading_bar(f"drawing {job.out}", quiet=as_json):
        draw_figure(
            job.labelled(files),
            job.out,
            times=job.moments(),
            view=job.view,
            array=None if job.no_array else job.array or "emulator",
            width=job.width,
            font_size=job.font_size,
            overwrite=job.overwrite,
        )
    return {}


def _animate(files: list[Path], job: FigureJob, *, as_json: bool) -> dict:
    start, stop = (None, None) if job.seconds is None else seconds_of(job.seconds)
    with bars.progress_bar(f"drawing {job.out}", quiet=as_json) as bar:
        frames = draw_animation(
            job.labelled(files),
            job.out,
            start=start,
            stop=stop,
            frame_rate=job.frame_rate,
            view=job.view,
            width=job.pixels(),
            overwrite=job.overwrite,
            progress=bar,
        )
    count = len(frames.poses)
    return {
        "frames": count,
        "frame_rate": frames.rate,
        "duration": count / frames.rate,
        "bytes": job.out.stat().st_size,
    }


def _warn_unfinished(files: Sequence[Path]) -> None:
    for path in files:
        with ContourFile(path) as file:
            if not file.sealed:
                done = sum(stop - first for first, stop in file.done)
                console.warn(
                    f"{path} is still being written, or was interrupted: the picture shows {done} of {file.pose_count} "
                    "poses (palpate render --resume goes on)"
                )
