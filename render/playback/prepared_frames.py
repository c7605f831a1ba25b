"""Prepared frames: the wire bytes of a playback as a file, made once, and played by copying them to the player."""

from __future__ import annotations  # array("B") takes no index at run time

import json
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from ...datasets.errors import ContourFileError
from ...datasets.focus_files.frame_file import FrameField, FrameFile
from ...datasets.focus_files.frame_reader import WIRE_FRAMES, FrameReader
from ...datasets.storage.hdf5_opening import Attribute
from ...device.array import POINT_BYTES, POINTS_MOST
from ...device.registry import array_model, array_names
from ..contour_input import takes_batches
from ..errors import StrategyError
from ..output_file import require_output
from ..sampling.metrics import SamplingCount
from ..sampling.strategy import SamplingStrategy
from ..validation import is_number, known_fields, require_path
from .drive import Driver, DriveStrategy
from .focal_points import BLOCK, open_focal_points
from .frames import MadeFrames, Making, counted_values, require_repeats, wire_bytes
from .placed_arrays import PlacedArray, arrays_of, with_points

SUFFIXES = (".h5", ".hdf5")
FRAMES = "/wire/frames"
PACKAGES = ("palpate", "numpy", "warp-lang")  # that decide bytes


@dataclass(frozen=True)
class Preparation:
    """Result of `prepare_frames`."""

    path: Path
    arrays: tuple[str, ...]
    frames: int
    update_rate: float
    """[Hz]"""
    bytes: int
    """Of the file."""
    device: str
    """Where wire bytes were made."""
    making: Making

    def __repr__(self) -> str:
        """One line."""
        names = ", ".join(self.arrays)
        return (
            f"Preparation({self.frames} frames of {names} at {self.update_rate:g} Hz, {self.making.refused} silenced)"
        )

    def as_dict(self) -> dict[str, Any]:
        """Everything, for JSON."""
        made = self.making
        values = {
            "path": str(self.path),
            "arrays": list(self.arrays),
            "frames": self.frames,
            "update_rate": self.update_rate,
            "duration": self.frames / self.update_rate,
            "bytes": self.bytes,
            "refused": made.refused,
            "switched": made.switched,
            "device": self.device,
        }
        if made.sampling is not None and made.count is not None:
            values |= counted_values(made.count, made.sampling)
        return values | {"drive": asdict(made.drive)}


@takes_batches
def prepare_frames(
    path: str | Path,
    out: str | Path,
    *,
    array: str | Sequence[PlacedArray] = "emulator",
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    duration: float | None = None,
    device: str = "cpu",
    overwrite: bool = False,
    watch: Callable[[int, int], object] | None = None,
) -> Preparation:
    """Write the wire bytes that `play_file` would send for a file, so that playing them only copies them.

    Made and written block by block, in bounded memory; the new file is whole or not there
    (docs/formats/prepared-frames.md). They are the bytes that `play_file` sends; a GPU's differ by a step where
    `Driver` says so.

    Args:
        path: contour file, or focal points from a .PTLIST or a sweep.
        out: the file to write, .h5.
        array, sampling, drive, duration: as for `play_file`.
        device: Warp's.
        overwrite: whether a file that is there is replaced.
        watch: called with how many frames are done and how many there are.

    Raises:
        StrategyError, PoseError, DeviceError: as `play_file`; for `out` that is there, or does not end in .h5.
        ContourFileError: the file cannot be read, or `out` not be written.

    >>> from palpate.render import play_file, prepare_frames, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> prepare_frames(path, "frames.h5", duration=0.01, overwrite=True)
    Preparation(100 frames of emulator at 10000 Hz, 0 silenced)
    >>> play_file("frames.h5", clock="virtual")
    Playback(PlayReport(emulator EMU0001: 100 frames at 10000 Hz, 0 underruns, off), 0 jumps, 0 silenced)
    """
    path, out = require_path(path, "the file to prepare"), require_path(out, "the file to write")
    if out.suffix not in SUFFIXES:
        raise StrategyError(f"{out}: a file of frames must end in {' or '.join(SUFFIXES)}")
    require_output(out, overwrite=overwrite, sources=[path])
    arrays = arrays_of(array)
    with open_focal_points(path, sampling, duration, arrays) as (source, file):
        models = [placed.model for placed in with_points(arrays, source.foci)]
        for model in models:
            model.divider(source.update_rate)
        driver = Driver(models, drive, update_rate=source.update_rate, device=device)
        try:
            return _write(MadeFrames(source, driver, file=file), driver, out, watch or _unwatched)
        except OSError as error:
            raise ContourFileError(f"{out}: cannot be written ({error.strerror or error})") from error


def _write(frames: MadeFrames, driver: Driver, out: Path, watch: Callable[[int, int], object]) -> Preparation:
    models = driver.arrays
    sizes = [model.frame_bytes for model in models]
    attributes: dict[str, dict[str, Attribute]] = {
        "/": {
            "format": WIRE_FRAMES,
            "version": np.array([1, 1], np.int32),
            "drive": driver.strategy.to_json(),
            "versions": json.dumps({package: version(package) for package in PACKAGES}),
            "device": driver.device,
        },
        "/wire": {"update_rate": frames.update_rate},
        "/array": {
            "names": json.dumps([model.name for model in models]),
            "identities": json.dumps([model.wire_identity() for model in models]),
            "frame_bytes": np.array(sizes, np.int64),
        },
    }
    field = FrameField(FRAMES, (sum(sizes),), "byte", "|u1")
    with FrameFile(out, [field], frames.frame_count, attributes=attributes) as file:
        done = 0
        for block in frames:
            parts = [np.frombuffer(part, np.uint8).reshape(-1, size) for part, size in zip(block, sizes, strict=True)]
            file.append({FRAMES: parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)})
            done += len(parts[0])
            watch(done, frames.frame_count)
        making = frames.making
        size = file.publish(_counted(making))
    names = tuple(model.name for model in models)
    return Preparation(out, names, frames.frame_count, frames.update_rate, size, driver.device, making)


def _counted(making: Making) -> dict[str, dict[str, Attribute]]:
    """Attributes that are known when all frames are made."""
    wire: dict[str, Attribute] = {"refused": making.refused, "switched": making.switched}
    if making.sampling is None or making.count is None:
        return {"/wire": wire}
    return {"/": {"sampling": making.sampling.to_json()}, "/wire": {**wire, "count": json.dumps(asdict(making.count))}}


def _unwatched(done: int, total: int) -> None:
    """Show nothing."""


class PreparedFrames:
    """The frames of a file by `prepare_frames`, block by block, each verified when it is read; use it in a `with`.

    repeats: how often they come. Raises ContourFileError for a file that is none, is not finished, or is damaged.
    """

    def __init__(self, path: str | Path, *, repeats: int = 1) -> None:
        require_repeats(repeats)
        self._file = FrameReader(path)
        try:
            self.making = _read_making(self._file)
            """How they were made."""
            self._meant = _read_arrays(self._file)
        except BaseException:
            self.close()
            raise
        self.repeats = repeats
        self.foci = self._foci()
        """Focal points of a frame of an array that takes such; else those of its sampling."""
        self.frame_count = self._file.frame_count * repeats
        """Of all repetitions."""
        self.update_rate = self._file.update_rate
        """[Hz]"""

    def close(self) -> None:
        """Close the file; closing twice does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[tuple[array[int], ...]]:
        """Blocks of frames, one array("B") for each array."""
        count = self._file.frame_count
        for _ in range(self.repeats):
            for first in range(0, count, BLOCK):
                self._file.require_unchanged()
                yield tuple(map(wire_bytes, self._file.wire_frames(first, min(first + BLOCK, count))))

    def _foci(self) -> int:
        for (name, _), size in zip(self._meant, self._file.frame_bytes, strict=False):
            if name in array_names() and array_model(name).takes_points:
                return size // POINT_BYTES
        return 1 if self.making.sampling is None else self.making.sampling.foci

    def sized(self, arrays: Sequence[PlacedArray]) -> tuple[PlacedArray, ...]:
        """The arrays, those that take focal points with as many a frame as the file has."""
        sizes = self._file.frame_bytes
        if len(sizes) != len(arrays) or sizes[0] // POINT_BYTES not in range(1, POINTS_MOST + 1):
            return tuple(arrays)  # refused by `require_fitting`, or arrays that take phases
        return with_points(arrays, sizes[0] // POINT_BYTES)

    def require_fitting(
        self,
        arrays: Sequence[PlacedArray],
        sampling: SamplingStrategy | str | None,
        drive: DriveStrategy | None,
        duration: float | None,
    ) -> None:
        """Refuse arrays other than those that the frames are for, and another sampling, drive or duration.

        A field of the drive that has its default asks for nothing. Raises StrategyError.
        """
        path = self._file.path
        found = [(placed.model.name, placed.model.wire_identity()) for placed in arrays]
        if found != self._meant:
            raise StrategyError(
                f"{path}: holds frames for {_listed(self._meant)}, not for {_listed(found)}: kind, pose and board "
                "file must be those that they were prepared for"
            )
        if sampling is not None:
            raise StrategyError(f"{path}: holds frames at {self.update_rate:g} Hz, which no sampling strategy changes")
        if duration is not None:
            raise StrategyError(f"{path}: holds frames, which are played to their end, so duration cannot be asked for")
        if drive is not None and drive != self.making.drive:
            made, asked, default = (asdict(one) for one in (self.making.drive, drive, DriveStrategy()))
            for name in made:
                if asked[name] not in (made[name], default[name]):
                    raise StrategyError(f"{path}: holds frames of drives with {name}={made[name]}, not {asked[name]}")


def _listed(arrays: Sequence[tuple[str, str]]) -> str:
    return " and ".join(f"{name} ({identity[:12]})" for name, identity in arrays)


def _read_arrays(file: FrameReader) -> list[tuple[str, str]]:
    """Name and wire identity of each array."""
    names, identities = file.described("/array", "names"), file.described("/array", "identities")
    for texts in (names, identities):
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            raise ContourFileError(f"{file.path}: attributes names and identities of /array must list texts")
    if len(names) != len(identities):
        raise ContourFileError(f"{file.path}: has {len(names)} names and {len(identities)} identities of arrays")
    return list(zip(names, identities, strict=True))


def _read_making(file: FrameReader) -> Making:
    """Raises ContourFileError for attributes that are not what `prepare_frames` writes."""
    try:
        sampling, drive = file.text("/", "sampling"), file.text("/", "drive")
        count = None if sampling is None else _read_count(file.described("/wire", "count"))
        refused, switched = file.whole("/wire", "refused"), file.whole("/wire", "switched")
        return Making(
            None if sampling is None else SamplingStrategy.from_json(sampling),
            count,
            refused or 0,
            switched or 0,
            DriveStrategy.from_json(drive or ""),
        )
    except StrategyError as error:
        raise ContourFileError(f"{file.path}: {error}") from error


def _read_count(values: object) -> SamplingCount:
    known = known_fields(values, [field.name for field in fields(SamplingCount)], "count")
    for name, default in asdict(SamplingCount()).items():
        value = known.get(name, default)
        numbers = value.values() if isinstance(value, dict) and isinstance(default, dict) else [value]
        if not all(map(is_number, numbers)) or (isinstance(default, dict) and default.keys() != value.keys()):
            raise StrategyError(f"count: {name} is {value!r}")
    return SamplingCount(**known)
