"""Files of frames, read by frame range: focal points and drives that a sweep keeps, and wire bytes of arrays.

docs/formats/sweep-files.md and docs/formats/prepared-frames.md describe them.
"""

from __future__ import annotations

import math
from os import PathLike
from types import TracebackType
from typing import Any, NamedTuple, Self, cast

import numpy as np
from numpy.typing import NDArray

from ..errors import ContourFileError
from ..json_text import parse_json
from ..storage.hdf5 import Hdf5Reader, get_version

FOCAL_POINTS, DRIVES, WIRE_FRAMES = "palpate focal points", "palpate drives", "palpate wire frames"
VERSION_MAJOR = 1
DIGESTS_SINCE = (1, 1)
_SLACK = 1e-5  # by which rounding may lift a level above 1


class _Rows(NamedTuple):
    """A dataset with a row a frame."""

    path: str
    row_rank: int
    """Number of dimensions of a row; one more where a frame has several focal points."""
    width: int | None
    """Of a row's last dimension; None for any."""
    is_level: bool
    """Whether values lie in 0..1."""
    dtype: str = "float32"


_FIELDS: dict[str, tuple[_Rows, ...]] = {
    FOCAL_POINTS: (_Rows("/focus/position", 1, 3, False), _Rows("/focus/intensity", 0, None, True)),
    DRIVES: (_Rows("/drive/delay", 1, None, True), _Rows("/drive/amplitude", 0, None, True)),
    WIRE_FRAMES: (_Rows("/wire/frames", 1, None, False, "uint8"),),
}
_GROUPS = {FOCAL_POINTS: "/focus", DRIVES: "/drive", WIRE_FRAMES: "/wire"}


class FrameReader:
    """A file of focal points, drives or wire bytes opened for reading; use it in a `with`.

    Raises:
        ContourFileError: From every method: missing, truncated, damaged or other files, a newer major version.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self._file = Hdf5Reader(path)
        self.path = self._file.path
        try:
            self.format = self._format()
            """FOCAL_POINTS, DRIVES or WIRE_FRAMES."""
            self._file.require_attributes()
            self._fields = _FIELDS[self.format]
            shapes = [self._shape(own) for own in self._fields]
            levels = shapes[-1][: len(shapes[-1]) - self._fields[-1].row_rank]
            self.frame_count = levels[0]
            """Number of frames."""
            self.foci = math.prod(levels[1:])
            """Focal points of a frame; 1 for drives and wire frames."""
            if shapes[0][: len(levels)] != levels:
                raise ContourFileError(f"{self.path}: {self._fields[0].path} and {self._fields[-1].path} do not fit")
            self._ends = self._array_ends(shapes[0][-1]) if self.format == WIRE_FRAMES else []
            self.update_rate = self._update_rate()
            """[Hz]"""
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def require_unchanged(self) -> None:
        """Refuse to go on with a file that was changed since it was opened."""
        self._file.require_unchanged()

    def focal_points(self, first: int, stop: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Positions [m], shape [frame, 3] or [frame, focus, 3], and intensities 0..1, [frame] or [frame, focus]."""
        if self.format != FOCAL_POINTS:
            raise ContourFileError(f"{self.path} holds {self.format.removeprefix('palpate ')}, no focal points")
        position, intensity = (self._file.read(rows.path, first, stop) for rows in self._fields)
        return position, intensity

    @property
    def frame_bytes(self) -> list[int]:
        """Bytes of a frame of each array; empty where the file holds no wire frames."""
        return np.diff(self._ends, prepend=0).tolist() if self._ends else []

    def wire_frames(self, first: int, stop: int) -> list[NDArray[np.uint8]]:
        """Wire bytes for each array, shape [frame, frame_bytes]."""
        if self.format != WIRE_FRAMES:
            raise ContourFileError(f"{self.path} holds {self.format.removeprefix('palpate ')}, no wire frames")
        return np.split(self._file.read(self._fields[0].path, first, stop), self._ends[:-1], axis=1)

    def described(self, group: str, name: str) -> Any:
        """An attribute that is JSON (`recipe` of "/", `names` of "/array"), as its values; None if it is none."""
        try:
            return parse_json(self._file.text(group, name), allow_nan=True)
        except (ContourFileError, ValueError):
            return None

    def recipe(self) -> dict[str, Any]:
        """The sweep's recipe that the frames are of; empty if the file has none."""
        if self._file.attribute("/", "recipe") is None:
            return {}
        stored = self.described("/", "recipe")
        if not isinstance(stored, dict):
            raise ContourFileError(f"{self.path}: attribute recipe of / is no JSON object")
        return cast("dict[str, Any]", stored)

    def whole(self, group: str, name: str) -> int | None:
        """An attribute that is a whole number; None if it is not there."""
        return self._file.whole(group, name)

    def text(self, group: str, name: str) -> str | None:
        """A text attribute; None if it is not there."""
        value = self._file.attribute(group, name) if group in self._file else None
        return value if isinstance(value, str) else None

    def problems(self) -> list[str]:
        """Problems of the recipe and the datasets, a sentence each; reads all data in blocks. Empty if none."""
        out: list[str] = []
        for require in (self.recipe, self._file.require_attributes, self._file.require_rows):
            try:
                require()
            except ContourFileError as error:
                out.append(str(error))
        for rows in self._fields:
            bad = np.zeros(0, np.int64)
            for first, stop in self._file.row_blocks(rows.path):
                values = self._file.read(rows.path, first, stop)
                is_bad = ~np.isfinite(values)
                if rows.is_level:
                    is_bad |= ~((values >= -_SLACK) & (values <= 1.0 + _SLACK))
                bad = np.append(bad, np.flatnonzero(is_bad.reshape(len(values), -1).any(axis=1)) + first)
            if bad.size:
                what = "not in 0..1" if rows.is_level else "not finite"
                out.append(f"{rows.path}: {what} ({bad.size}, first {bad[0]})")
        return out

    def _array_ends(self, row_bytes: int) -> list[int]:
        """Where the bytes of each array end in a row; refuses a file that is not finished, or was cut."""
        if self._file.digests is None:
            raise ContourFileError(f"{self.path} has no digests of its frames, which version 1.1 has: prepare it again")
        counts = self._file.attribute("/array", "frame_bytes")
        sizes: list[Any] = counts.tolist() if isinstance(counts, np.ndarray) and counts.dtype.kind == "i" else []
        if not sizes or min(sizes) < 1 or sum(sizes) != row_bytes:
            raise ContourFileError(f"{self.path}: frame_bytes of /array are {sizes}, but a row has {row_bytes} bytes")
        return np.cumsum(sizes).tolist()

    def _format(self) -> str:
        found = _format_version(self._file)
        if found is None:
            raise ContourFileError(f"{self.path} holds no focal points, drives or wire frames")
        version, digests = get_version(self._file), self._file.digests
        named = digests is not None and all(own.path in digests.datasets for own in _FIELDS[found])
        if version[0] > VERSION_MAJOR:
            newer = f"newer than this palpate reads ({VERSION_MAJOR}.x)"
            raise ContourFileError(f"{self.path} has version {version[0]}, {newer}")
        if version >= DIGESTS_SINCE and not named:
            raise ContourFileError(f"{self.path} has no digests of its frames: it is not finished, or was changed")
        return found

    def _shape(self, rows: _Rows) -> tuple[int, ...]:
        dtype, shape = self._file.layout(rows.path)
        several = self.format == FOCAL_POINTS and len(shape) == rows.row_rank + 2
        fits = len(shape) == rows.row_rank + 1 + several and rows.width in (None, shape[-1])
        if dtype != rows.dtype or not fits or 0 in shape:
            raise ContourFileError(f"{self.path}: {rows.path} is {dtype} {list(shape)}, which no frames are")
        return shape

    def _update_rate(self) -> float:
        group = _GROUPS[self.format]
        rate = self._file.attribute(group, "update_rate")
        if isinstance(rate, bool) or not isinstance(rate, int | float) or not (np.isfinite(rate) and rate > 0):
            raise ContourFileError(f"{self.path}: attribute update_rate of {group} must be positive, not {rate!r}")
        return float(rate)


def frame_format(path: str | PathLike[str]) -> str | None:
    """FOCAL_POINTS, DRIVES or WIRE_FRAMES by the file's format attribute; None for any other file, or none."""
    try:
        with Hdf5Reader(path) as file:
            return _format_version(file)
    except ContourFileError:
        return None


def _format_version(file: Hdf5Reader) -> str | None:
    found = file.attribute("/", "format")
    return found if isinstance(found, str) and found in _FIELDS else None


def check_frames(path: str | PathLike[str]) -> list[str]:
    """Problems of a file of frames, a sentence each; empty if it is whole. Nothing is raised for a bad file."""
    try:
        with FrameReader(path) as file:
            return file.problems()
    except ContourFileError as error:
        return [str(error)]
