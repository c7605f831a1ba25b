"""`palpate figure`: contour files as a picture."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...datasets.contour_file.reader import ContourFile
from ..errors import StrategyError
from ..reports.contour_figure import draw_figure
from ..reports.picture_page import font_of, width_of
from ..reports.picture_style import require_picture
from ..terminal import bars, console
from ..validation import refuse_object


@dataclass(frozen=True)
class FigureJob:
    """All options of `palpate figure`."""

    out: Path
    times: str | None
    view: str
    array: str | None
    no_array: bool
    label: list[str] | None
    width: str | None
    font_size: float | None
    overwrite: bool

    def __post_init__(self) -> None:
        """Raise StrategyError for options that exclude each other, and for an output that cannot be written."""
        width_of(self.width)
        font_of(self.font_size)
        if self.no_array and self.array is not None:
            raise StrategyError("--array and --no-array exclude each other: one shows an array, the other none")
        require_picture(self.out, overwrite=self.overwrite)

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
