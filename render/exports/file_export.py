"""Export a contour file, or a range of it, to a file of a format that other programs open."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.focus_files.ptlist import write_ptlist
from ...datasets.storage.durable import NewFile
from ..contour_input import takes_batches
from ..errors import StrategyError
from ..file_kinds import is_point_list
from ..output_file import require_output
from ..playback.focal_points import FocusSource
from ..sampling.strategy import SamplingStrategy
from ..user_warnings import warn_user
from ..validation import choose, refuse_object, require_number, require_path
from .contour_tables import write_csv, write_npz
from .focal_points import (
    FOCUS_FILE,
    FOCUS_WRITERS,
    FocusFormat,
    SamplingFields,
    holds_focus,
    jumps_of,
    open_focus,
    read_whole,
    sample_focus,
    write_focus,
)
from .pose_choice import Ends, Progress, choose_poses
from .vtkhdf import write_vtkhdf

FORMATS = {
    "vtkhdf": ".vtkhdf",
    "csv": ".csv",
    "npz": ".npz",
    "ptlist": ".ptlist",
    "focal-points": ".bin",
}
"""Formats, and the suffixes that stand for them; focal-points has others too (FOCUS_WRITERS)."""

OF_FOCUS = ("ptlist", "focal-points")
"""Formats of focal points; the others hold contours."""

POINT_LIST = FocusFormat("a point list", 10_000_000)  # rows of text; 17 minutes at 10 kHz


class ContourFields(NamedTuple):
    """Options of formats that hold contours."""

    scene: bool
    gzip: int


@takes_batches
def export_file(
    path: str | Path,
    out: str | Path,
    *,
    to: str | None = None,
    poses: Ends = None,
    seconds: Ends = None,
    every: int = 1,
    scene: bool = False,
    gzip: int = 0,
    sampling: SamplingStrategy | str | Path | None = None,
    speed: float | None = None,
    update_rate: float | None = None,
    duration: float | None = None,
    overwrite: bool = False,
    watch: Progress | None = None,
) -> dict[str, Any]:
    """Write a contour file, or a range of it, as a file that other programs open (docs/formats/exports.md).

    Contours: vtkhdf, csv, npz. Focal points, sampled from them or of a file that holds them: ptlist,
    focal-points. Any size is read in bounded memory; the file is whole or not there. Returns what was written, by name.

    to: the format; by default it follows from the suffix of `out` (.vtkhdf .csv .npz .ptlist .bin); with
    "focal-points" .csv and .npz hold focal points, too. poses: "FIRST:STOP" or two numbers, the pose after the last not
    included; either may be left out (None). seconds: the same by time [s]. every: n for each n-th of these poses.
    scene: object and hand, too (vtkhdf). gzip: compress, 0 not, 9 most (vtkhdf, .npz). sampling, speed [m/s],
    update_rate [Hz], duration [s]: as for `RenderedBatch.sample` (focal points). watch: called with how much is done
    and how much there is.
    Raises StrategyError for an unknown format, a range that is none or not done yet, an option of another format, more
    focal points than the format holds, and a file that is there unless `overwrite`; ContourFileError where the file
    cannot be read, or `out` not be written.

    >>> from palpate.render import export_file, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> export_file(path, "cube.csv", overwrite=True)
    {'format': 'csv', 'poses': 1, 'polylines': 1, 'points': 5, 'bytes': 222, 'path': 'cube.csv'}
    """
    path, out = require_path(path, "the file to export"), require_path(out, "the file to write")
    name = format_of(out, to)
    own, asked = ContourFields(scene, gzip), SamplingFields(sampling, speed, update_rate, duration)
    require_number("gzip", own.gzip, 0, 9, whole=True)
    taken = {"scene": ("vtkhdf",), "gzip": ("vtkhdf", "npz"), **dict.fromkeys(asked._fields, OF_FOCUS)}
    if out.suffix.lower() == ".npz":
        taken["gzip"] = (*taken["gzip"], "focal-points")
    for option, value in {**own._asdict(), **asked._asdict()}.items():
        if value not in (None, False, 0) and name not in taken[option]:
            raise StrategyError(f"{option} is for {_listed(taken[option])}, not for {name}")
    require_output(out, overwrite=overwrite, sources=[path])
    if not is_point_list(path):
        refuse_object(path)
    if name in OF_FOCUS:
        target = {"ptlist": POINT_LIST, "focal-points": FOCUS_FILE}[name]
        with _opened_focus(path, (poses, seconds, every), asked, target) as source:
            values = _export_focus(path, source, out, name, gzip, overwrite, watch or _unwatched)
        return values | {"format": name, "path": str(out)}
    if holds_focus(path):
        raise StrategyError(f"{path} holds focal points and no contours: it can be exported to {_listed(OF_FOCUS)}")
    with ContourFile(path) as file:
        chosen = choose_poses(file, poses, seconds, every)
        counts = _written(out, lambda new: _write_contours(name, file, chosen, new, own, watch or _unwatched))
    if not counts["polylines"]:
        warn_user(f"{path} holds no contour in the poses that {out} is of ({len(chosen)})")
    return {"format": name, "poses": len(chosen), **counts, "bytes": out.stat().st_size, "path": str(out)}


def format_of(out: Path, to: str | None) -> str:
    """The format asked for, or that of a suffix; raises StrategyError for an unknown one, and for two that differ."""
    known = {suffix: name for name, suffix in FORMATS.items()}
    meant = known.get(out.suffix.lower())
    if to is None and meant is None:
        raise StrategyError(f"{out}: must end in one of {', '.join(FORMATS.values())}, or say the format with to=NAME")
    if to is None or not isinstance(to, str):
        return meant if to is None and meant is not None else choose("to", str(to), tuple(FORMATS))
    name = choose("to", to, tuple(FORMATS))
    if name == "focal-points":
        if out.suffix.lower() not in FOCUS_WRITERS:
            raise StrategyError(f"{out}: must end in {', '.join(FOCUS_WRITERS)} to hold focal points")
    elif meant not in (None, name):
        raise StrategyError(f"{out}: ends in {out.suffix}, but to={name} asks for another format")
    return name


def _write_contours(
    name: str, file: ContourFile, chosen: range, new: Path, own: ContourFields, watch: Progress
) -> dict[str, Any]:
    if name == "csv":
        return write_csv(file, chosen, new, watch=watch)
    if name == "npz":
        return write_npz(file, chosen, new, gzip=own.gzip, watch=watch)
    return write_vtkhdf(file, chosen, new, gzip=own.gzip, scene=own.scene, watch=watch)


def _export_focus(
    path: Path, source: FocusSource, out: Path, name: str, gzip: int, overwrite: bool, watch: Progress
) -> dict[str, Any]:
    if name == "focal-points":
        _written(out, lambda new: write_focus(source, path, new, out.suffix.lower(), gzip=gzip, watch=watch))
        values = {"samples": source.frame_count, "foci": source.foci, "update_rate": source.update_rate}
        return values | jumps_of(source) | {"bytes": out.stat().st_size}
    focus = read_whole(source, watch)
    write_ptlist(out, focus.position, focus.intensity, source.update_rate, overwrite=overwrite)
    return {"points": len(focus.intensity), "update_rate": source.update_rate, **jumps_of(source)}


@contextmanager
def _opened_focus(
    path: Path, choice: tuple[Ends, Ends, int], asked: SamplingFields, target: FocusFormat
) -> Iterator[FocusSource]:
    poses, seconds, every = choice
    if not holds_focus(path):
        with ContourFile(path) as file:
            yield sample_focus(file, choose_poses(file, poses, seconds, every), asked, target)
        return
    if poses is not None or every != 1:
        raise StrategyError(f"{path} holds focal points, which have no poses: choose them by seconds")
    with open_focus(path, asked, seconds, target) as source:
        yield source


def _written(out: Path, write: Callable[[Path], Any]) -> Any:
    """What a writer returns that writes `out` whole, or not at all."""
    try:
        with NewFile(out) as new:
            return write(new.temporary)
    except OSError as error:
        raise ContourFileError(f"{out}: cannot be written ({error.strerror or error})") from error


def _unwatched(done: int, total: int) -> None:
    """Show nothing."""


def _listed(names: tuple[str, ...]) -> str:
    """Names as part of a sentence."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
