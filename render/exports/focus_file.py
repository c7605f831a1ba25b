"""Files of focal points as CSV, NPZ and the binary file of docs/formats/focal-points.md, written block by block."""

import shutil
import struct
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ...datasets.errors import ContourFileError
from ..file_kinds import FOCUS_MAGIC
from ..playback.focal_points import FocusSource
from ..sampling.strategy import SamplingStrategy
from .focal_points import FocusFormat, watched_blocks
from .npz_file import open_member
from .pose_choice import Progress

VERSION = 1
FOCI_MOST = 8
ROUNDING = 1e-5  # by which an intensity that another program stored may lie outside 0..1; it is set to the bound

Rows = Iterator[tuple[np.ndarray, np.ndarray]]
"""Blocks of positions [m], float32 [sample, point, 3], and intensities 0..1, float32 [sample, point]."""

FOCUS_FILE = FocusFormat(
    "a file of focal points",
    40_000_000,  # more is rather a mistake: 67 minutes at 10 kHz, 17 at 40 kHz; a .bin of 0.64 GB for each focal point
    lambda rate: SamplingStrategy(update_rate=rate),
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
