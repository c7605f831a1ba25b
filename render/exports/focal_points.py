"""Focal points of contours or of a file, and the binary, CSV and NPZ files of them for other programs."""

import shutil
import struct
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.errors import ContourFileError
from ...datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, frame_format
from ...datasets.focus_files.ptlist import read_ptlist
from ...datasets.storage.schema import Arrays
from ..errors import StrategyError
from ..file_kinds import FOCUS_MAGIC
from ..playback.focal_points import ContourSource, FocusSource, PointSource, sampling_of_run
from ..sampling.metrics import FocalPoints
from ..sampling.presets import sampling_of
from ..sampling.sampler import Sampler, joined
from ..sampling.strategy import SamplingStrategy
from .contour_tables import open_member
from .pose_choice import Ends, Progress, ends_of, picked

SAMPLES_A_BLOCK = 1 << 12  # of eight focal points: 40 MB while they are made to text


class SamplingFields(NamedTuple):
    """How contours become focal points."""

    sampling: SamplingStrategy | str | Path | None = None
    """None is the preset "stm"."""
    speed: float | None = None
    """[m/s]; None is the strategy's."""
    update_rate: float | None = None
    """[Hz]; None is the strategy's."""
    duration: float | None = None
    """When to stop, if not at the end of the motion [s]."""


class FocusFormat(NamedTuple):
    """What a format takes."""

    owner: str
    """What holds focal points, for messages: "a point list"."""
    count_most: int
    """Samples."""
    foci_most: int = 1
    """Focal points of a sample."""


def holds_focus(path: Path) -> bool:
    """Whether a file holds focal points instead of contours; raises StrategyError for one of drives or wire
    frames."""
    if path.suffix.lower() == ".ptlist":
        return True
    kind = frame_format(path)
    if kind not in (None, FOCAL_POINTS):
        held = kind.removeprefix("palpate ")
        raise StrategyError(f"{path} holds {held} of one array, which no other format takes; palpate info shows them")
    return kind is not None


@contextmanager
def open_focus(path: Path, asked: SamplingFields, seconds: Ends, target: FocusFormat) -> Iterator[FocusSource]:
    """Focal points of a point list, or of a file that a sweep has kept, which stays open meanwhile.

    Raises StrategyError for more than the format takes, more at once than it takes, and options of sampling.
    """
    if fields := [name for name, value in asked._asdict().items() if value is not None]:
        raise StrategyError(f"{path} holds focal points at a rate of its own, so {fields[0]} cannot be asked for")
    if path.suffix.lower() == ".ptlist":
        points = read_ptlist(path)
        first, stop = _sample_range(path, seconds, len(points.intensity), points.update_rate, target)
        level = (points.intensity * np.float32(points.intensity_peak))[first:stop]
        focus = FocalPoints(points.position[first:stop], level)
        yield PointSource(focus, update_rate=points.update_rate, block=SAMPLES_A_BLOCK)
        return
    with FrameReader(path) as file:
        first, stop = _sample_range(path, seconds, file.frame_count, file.update_rate, target)
        _require_foci(file.foci, target)
        yield PointSource(
            lambda low, high: FocalPoints(*file.focal_points(first + low, first + high)),
            update_rate=file.update_rate,
            frame_count=stop - first,
            foci=file.foci,
            block=SAMPLES_A_BLOCK,
        )


def sample_focus(file: ContourFile, chosen: range, asked: SamplingFields, target: FocusFormat) -> ContourSource:
    """Focal points of the chosen poses, the first of which is at time 0; they are sampled as they are gone through.

    Raises StrategyError for more than the format takes, and more at once than it takes; PoseError for poses without
    times.
    """
    changes = {name: getattr(asked, name) for name in ("speed", "update_rate")}
    run = file.live_run if len(chosen) == file.pose_count else None  # chosen poses are a motion of their own
    default = "stm" if run is None else sampling_of_run(run)
    strategy = sampling_of(default if asked.sampling is None else asked.sampling)
    strategy = replace(strategy, **{name: value for name, value in changes.items() if value is not None})
    _require_foci(strategy.foci, target)
    sampler = Sampler(strategy, revisits=False)
    source = ContourSource(ChosenRows(file, chosen), sampler, asked.duration, block=SAMPLES_A_BLOCK, run=run)
    _require_count(file.path, source.frame_count, strategy.update_rate, target)
    return source


def watched_blocks(source: FocusSource, watch: Progress) -> Iterator[FocalPoints]:
    """Blocks of focal points, and how far they are."""
    done = 0
    for block in source:
        yield block
        done += len(block.intensity)
        watch(done, source.frame_count)


def jumps_of(source: FocusSource) -> dict[str, int]:
    """Jumps of the focal points that were sampled, as part of a result; empty for focal points that were read."""
    return {} if source.count is None else {"jumps": sum(source.count.jumps.values())}


def read_whole(source: FocusSource, watch: Progress) -> FocalPoints:
    """All focal points, for a format that is written at once."""
    return joined(list(watched_blocks(source, watch)))


class ChosenRows:
    """The chosen poses of a file, numbered from 0 and timed from 0, as a sampler reads contours."""

    def __init__(self, file: ContourFile, chosen: range) -> None:
        self._file, self._chosen = file, chosen
        self.path = file.path
        self.pose_count = len(chosen)

    def motion(self, first: int = 0, stop: int | None = None) -> dict[str, np.ndarray]:
        """Poses, and times [s] if there are any."""
        part = self._part(first, stop)
        rows = {name: values[:: part.step] for name, values in self._file.motion(part.start, part.stop).items()}
        if "time" in rows:
            rows["time"] = rows["time"] - self._file.motion(self._chosen.start, self._chosen.start + 1)["time"][0]
        return rows

    def blocks(self, *, point_limit: int) -> Iterator[tuple[int, int]]:
        """Ranges of the chosen poses, in order, of up to so many points."""
        done = 0
        for _, stop in self._file.blocks(point_limit=point_limit):
            end = min(-(-(stop - self._chosen.start) // self._chosen.step), self.pose_count)
            if end > done:
                yield done, end
                done = end

    def contours(self, first: int, stop: int) -> Arrays:
        """Contours of a range."""
        return picked(self._file, self._part(first, stop))

    def _part(self, first: int, stop: int | None) -> range:
        part = self._chosen[first:stop]
        return range(part.start, min(part.stop, self._chosen.stop), part.step)


def _sample_range(path: Path, seconds: Ends, count: int, rate: float, target: FocusFormat) -> tuple[int, int]:
    """First sample of a range of a file that holds so many, and the one after the last."""
    SamplingStrategy(update_rate=rate)  # refuses a rate that no array plays
    low, high = (None, None) if seconds is None else ends_of(seconds, "seconds")
    first = 0 if low is None else max(int(np.ceil(low * rate - 1e-6)), 0)
    stop = count if high is None else min(int(np.ceil(high * rate - 1e-6)), count)
    if first >= stop:
        raise StrategyError(f"seconds {seconds} hold no focal point of {path}, which lasts {count / rate:g} s")
    _require_count(path, stop - first, rate, target)
    return first, stop


def _require_count(path: Path, count: int, rate: float, target: FocusFormat) -> None:
    """Refuse more samples than a format takes."""
    if count > target.count_most:
        most = target.count_most
        raise StrategyError(
            f"{path}: {count} samples ({count / rate:g} s at {rate:g} Hz), but {target.owner} holds {most}: choose at "
            f"most {most / rate:g} s, by seconds or a duration"
        )


def _require_foci(foci: int, target: FocusFormat) -> None:
    """Refuse more focal points a sample than a format takes."""
    if foci > target.foci_most:
        held = "one focal point" if target.foci_most == 1 else f"up to {target.foci_most} focal points"
        raise StrategyError(f"{target.owner} holds {held} at a time, not foci {foci}")


VERSION = 1
FOCI_MOST = 8
ROUNDING = 1e-5  # by which an intensity that another program stored may lie outside 0..1; it is set to the bound

Rows = Iterator[tuple[np.ndarray, np.ndarray]]
"""Blocks of positions [m], float32 [sample, point, 3], and intensities 0..1, float32 [sample, point]."""

FOCUS_FILE = FocusFormat(
    "a file of focal points",
    40_000_000,  # more is rather a mistake: 67 minutes at 10 kHz, 17 at 40 kHz; a .bin of 0.64 GB for each focal point
    FOCI_MOST,
)


def _write_binary(source: FocusSource, rows: Rows, temporary: Path, gzip: int) -> None:
    with temporary.open("wb") as stream:
        stream.write(struct.pack("<8sIIdQ", FOCUS_MAGIC, VERSION, source.foci, source.update_rate, source.frame_count))
        for position, intensity in rows:
            stream.write(np.concatenate([position, intensity[..., None]], axis=-1).astype("<f4").tobytes())


def _write_csv(source: FocusSource, rows: Rows, temporary: Path, gzip: int) -> None:
    """A row for each focal point of each sample; numbers are the shortest that read back to the same bits."""
    several, first = source.foci > 1, 0
    with temporary.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(f"time,{'point,' if several else ''}x,y,z,intensity\n")
        for position, intensity in rows:
            time = (np.arange(first, first + len(intensity)) / source.update_rate).tolist()
            heads = [f"{t!r},{k}," for t in time for k in range(source.foci)] if several else [f"{t!r}," for t in time]
            values = np.concatenate([position, intensity[..., None]], axis=-1).reshape(-1, 4)
            numbers = values.astype(str).tolist()  # of float32: the shortest text of each number
            stream.writelines(f"{head}{','.join(row)}\n" for head, row in zip(heads, numbers, strict=True))
            first += len(intensity)


def _write_npz(source: FocusSource, rows: Rows, temporary: Path, gzip: int) -> None:
    """Arrays `position`, `intensity` and `update_rate`; equal contents make equal files."""
    samples, kind = (source.frame_count, source.foci), np.dtype("<f4")
    method = zipfile.ZIP_DEFLATED if gzip else zipfile.ZIP_STORED
    with (
        zipfile.ZipFile(temporary, "w", method, compresslevel=gzip or None) as archive,
        tempfile.TemporaryFile(
            dir=temporary.parent
        ) as levels,  # without a name; an archive has one member after another
    ):
        with open_member(archive, "position", (*samples, 3), kind) as member:
            for position, intensity in rows:
                member.write(position.astype(kind).tobytes())
                levels.write(intensity.astype(kind).tobytes())
        levels.seek(0)
        with open_member(archive, "intensity", samples, kind) as member:
            shutil.copyfileobj(levels, member)
        with open_member(archive, "update_rate", (), np.dtype("<f8")) as member:
            member.write(struct.pack("<d", source.update_rate))


FOCUS_WRITERS: dict[str, Callable[[FocusSource, Rows, Path, int], None]] = {
    ".bin": _write_binary,
    ".csv": _write_csv,
    ".npz": _write_npz,
}
"""What writes a file of focal points, by its suffix."""


def write_focus(
    source: FocusSource, name: Path, temporary: Path, suffix: str, *, gzip: int = 0, watch: Progress
) -> None:
    """Write focal points in the format of one of FOCUS_WRITERS.

    name: of the file that they come from, for messages. Raises OSError, and ContourFileError for positions that are
    not finite, and intensities outside 0..1.
    """
    FOCUS_WRITERS[suffix](source, _valid_rows(source, name, watch), temporary, gzip)


def _valid_rows(source: FocusSource, name: Path, watch: Progress) -> Rows:
    """Blocks of one shape, with a focal point's axis also where there is one, refused where values are out of range."""
    first = 0
    for block in watched_blocks(source, watch):
        position, intensity = block.position.reshape(-1, source.foci, 3), block.intensity.reshape(-1, source.foci)
        for what, bad in (
            ("a position that is not finite", ~np.isfinite(position).all(axis=-1)),
            ("an intensity outside 0..1", ~((intensity >= -ROUNDING) & (intensity <= 1 + ROUNDING))),
        ):
            if bad.any():
                raise ContourFileError(f"{name}: sample {first + int(bad.any(axis=1).argmax())} has {what}")
        yield position, np.clip(intensity, 0, 1)
        first += len(intensity)
