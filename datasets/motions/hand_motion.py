"""Hand motions: poses of one palm over time: recorded, given, or made by a synthetic exploration.

Hand frame (OpenXR palm axes; Leap's palm basis is the same): +Y out of the back of the hand, +Z to the wrist, +X by the
right-hand rule; origin in the middle of the palm's skin, which faces -Y. Array frame: +z up out of the array. A pose
transforms the hand frame to the array frame: x y z [m], qx qy qz qw.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import MotionError, RecordingWarning
from ..rigid import NORM_TOLERANCE, POSITION_FARTHEST
from ..user_warnings import warn_user
from .last_pose import end_of_motion, usual_interval
from .motion_file import MotionRows, read_rows, row_place, write_rows
from .suspicious_values import rounding, suspicious_units

PALM_DOWN = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Quaternion xyzw of a hand above the array: palm down, fingers pointing away from the user (+y of the array)."""

_ROWS_AT_ONCE = 65536  # rows are checked in float64 block by block; all at once would take twice the memory
_NORM_ROUNDING = 1e-7  # float32 rounding of a norm; within it quaternions stay, so that rereading a file changes no bit


@dataclass(frozen=True, eq=False)
class HandMotion:
    """Poses of a palm, in the array frame, with or without times.

    The arrays are checked and copied, and are read-only. Raises MotionError for other shapes, no poses, values that are
    not finite, quaternions whose norm differs from 1 by more than 1e-3, and times that do not increase strictly; the
    message names the row, counted from 0, and its values.

    >>> import numpy as np
    >>> from palpate.render import HandMotion, static_pose
    >>> still = HandMotion(np.arange(90) / 30, static_pose([0, 0, 0.2]).pose.repeat(90, axis=0))
    >>> path = still.save("still.csv", overwrite=True)
    >>> HandMotion.load("still.csv")
    HandMotion(90 poses, 3 s at 30 Hz)
    """

    time: NDArray[np.float64] | None
    """[s], shape [pose], starting at 0 and strictly increasing; None for poses without time."""
    pose: NDArray[np.float32]
    """x y z [m] and unit quaternion xyzw, hand frame -> array frame; shape [pose, 7]."""
    offset: float = 0.0
    """The recording clock's value at time 0 [s]; a first time other than 0 is subtracted from `time` and added here."""
    seed: int | None = None
    """Seed of a synthetic motion, otherwise None."""
    inserted: int = 0
    """Number of poses that were interpolated between two poses of the tracker."""
    provenance: Mapping[str, Any] | None = None
    """What made a synthetic motion, as JSON: model, its version, and its options; otherwise None."""

    def __post_init__(self) -> None:
        time, pose, offset = _validate(self.time, self.pose, self.offset, row_place)
        for name, value in (("time", time), ("pose", pose), ("offset", offset)):
            object.__setattr__(self, name, value)
        self._warn_of_units()

    def __repr__(self) -> str:
        """One line: how many poses, for how long."""
        duration, interval = self.duration, self._interval()
        if duration is None or interval is None:
            return f"HandMotion({len(self)} {'pose' if len(self) == 1 else 'poses without times'})"
        return f"HandMotion({len(self)} poses, {duration:.6g} s at {1 / interval:.4g} Hz)"

    def __len__(self) -> int:
        return self.pose.shape[0]

    def __getitem__(self, poses: slice) -> "HandMotion":
        """The motion of consecutive poses first:stop, of one at least; its times begin at 0."""
        if not isinstance(poses, slice):  # pyright: ignore[reportUnnecessaryIsInstance]  # scripts give numbers
            raise MotionError(f"a motion is divided as in motion[0:90], not by {poses!r:.60}; motion.pose has the rows")
        first, stop, step = poses.indices(len(self))
        if step != 1 or stop <= first:
            raise MotionError(f"poses must follow each other, one at least, as in motion[0:90], not {poses}")
        time = None if self.time is None else self.time[first:stop] - self.time[first]
        return HandMotion(time, self.pose[first:stop])

    @property
    def duration(self) -> float | None:
        """Duration of the motion [s]; the last pose lasts one median interval of 1 s at most (`end_of_motion`).

        None without times or with one pose.
        """
        return None if self.time is None or len(self) < 2 else end_of_motion(self.time)

    @property
    def rate(self) -> float | None:
        """Poses per second [Hz]: 1 / median interval. None without times or with one pose."""
        interval = self._interval()
        return None if interval is None else 1.0 / interval

    def _interval(self) -> float | None:
        if self.time is None or len(self) < 2:
            return None
        return usual_interval(self.time)

    def _warn_of_units(self) -> None:
        if self.provenance is None:  # not made here
            for sentence in suspicious_units(self.pose, self.time):
                warn_user(f"motion: {sentence}", RecordingWarning)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "HandMotion":
        """Read a motion from CSV (header `time,x,y,z,qx,qy,qz,qw`, time optional) or HDF5 (/motion, also of contour
        files). The suffix .csv, .h5 or .hdf5 selects the format.

        Raises MotionError, which names the path and, for a CSV, the line. Warns (RecordingWarning) of other units.
        """
        rows = read_rows(Path(path))
        motion = object.__new__(cls)  # skips __post_init__, which would check and copy everything again
        try:
            time, pose, offset = _validate(rows.time, rows.pose, rows.offset, rows.place, copy=False)
        except MotionError as error:
            raise MotionError(f"{path}: {error}") from None
        values = {"time": time, "pose": pose, "offset": offset, "seed": rows.seed, "inserted": 0}
        values |= {"provenance": rows.provenance}
        for name, value in values.items():
            object.__setattr__(motion, name, value)
        if rows.provenance is None:  # not made by palpate
            for sentence in suspicious_units(pose, time):
                warn_user(f"{path}: {sentence}", RecordingWarning)
        return motion

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the motion as CSV or HDF5 by the suffix (.csv, .h5, .hdf5), completely or not at all; returns its path.

        A CSV has the clock's times (time + offset) only; HDF5 has time, offset, seed and provenance. A loaded motion is
        bit-identical when read back. Raises MotionError if the file exists, unless `overwrite`, or writing fails.
        """
        rows = MotionRows(self.time, self.pose, self.offset, self.seed, row_place, self.provenance)
        write_rows(Path(path), rows, overwrite=overwrite)
        return Path(path)


def static_pose(position: ArrayLike, quaternion: ArrayLike = PALM_DOWN) -> HandMotion:
    """Make a motion of one pose without time: position [m], shape [3], and quaternion xyzw, shape [4].

    Without a quaternion the hand is above the array, palm down. Raises MotionError for other shapes, values that are
    not finite and a norm that differs from 1 by more than 1e-3.

    >>> from palpate.render import static_pose
    >>> motion = static_pose([0, 0, 0.2])
    >>> motion, motion.pose[0, :3]
    (HandMotion(1 pose), array([0. , 0. , 0.2], dtype=float32))
    """
    row = [require_shape(position, "position", (3,)), require_shape(quaternion, "quaternion", (4,))]
    return HandMotion(None, np.concatenate(row)[None, :])  # pyright: ignore[reportArgumentType]  # checked, then cast


def require_shape(value: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Numbers as a new array; raises MotionError, by the name, for other values and other shapes."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise MotionError(f"{name} must be numbers of shape {list(shape)}, got {value!r}") from None
    if array.shape != shape:
        raise MotionError(f"{name} must have shape {list(shape)}, got {list(array.shape)}")
    return array


def _validate(
    time: ArrayLike | None, pose: ArrayLike, offset: float, place: Callable[[int], str], *, copy: bool = True
) -> tuple[NDArray[np.float64] | None, NDArray[np.float32], float]:
    """Validate time, pose and offset and convert them for `HandMotion`; copy=False: arrays of the right type are not
    copied."""
    checked_pose = _validate_pose(pose, place, copy=copy)
    if not math.isfinite(offset):
        raise MotionError(f"offset must be finite, got {offset!r} s")
    if time is None:
        return None, checked_pose, float(offset)
    checked_time, shift = _validate_time(time, checked_pose.shape[0], place, copy=copy)
    return checked_time, checked_pose, float(offset) + shift


def _validate_pose(pose: ArrayLike, place: Callable[[int], str], *, copy: bool) -> NDArray[np.float32]:
    try:
        given = np.asarray(pose)
        rows = given if given.dtype.kind == "f" and given.itemsize in (4, 8) else np.array(pose, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise MotionError("pose must be numbers of shape [pose, 7]") from None
    if rows.ndim != 2 or rows.shape[1] != 7:
        raise MotionError(f"pose must have shape [pose, 7], got {list(rows.shape)}")
    if rows.shape[0] == 0:
        raise MotionError("a motion needs at least one pose, got none")
    checked = np.empty(rows.shape, np.float32) if copy or rows.dtype != np.float32 else rows.view(np.float32)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        block = np.array(rows[first : first + _ROWS_AT_ONCE], dtype=np.float64)
        _normalise(block, lambda row, first=first: place(first + row))
        checked[first : first + len(block)] = block
    checked.setflags(write=False)
    return checked


def _normalise(rows: NDArray[np.float64], place: Callable[[int], str]) -> None:
    """Refuse rows that are not poses; divide quaternions by their norm where it is not 1."""
    bad = _first(~(np.abs(rows) <= np.finfo(np.float32).max).all(axis=1))  # a comparison with NaN is false
    if bad is not None:
        raise MotionError(f"{place(bad)}: pose {rows[bad].tolist()} is not finite")
    bad = _first((np.abs(rows[:, :3]) > POSITION_FARTHEST).any(axis=1))
    if bad is not None:
        raise MotionError(
            f"{place(bad)}: position {rows[bad, :3].tolist()} m must lie within {POSITION_FARTHEST:g} m of the array"
        )
    norm: NDArray[np.float64] = np.linalg.norm(rows[:, 3:], axis=1)
    bad = _first(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if bad is not None:
        name = "zero quaternion, which is no rotation" if norm[bad] == 0.0 else f"quaternion norm {norm[bad]:.6g}"
        raise MotionError(f"{place(bad)}: {name}; it must be 1 within {NORM_TOLERANCE:g}{rounding(rows[bad, 3:])}")
    loose = np.abs(norm - 1.0) > _NORM_ROUNDING
    rows[loose, 3:] /= norm[loose, None]


def _validate_time(
    time: ArrayLike, pose_count: int, place: Callable[[int], str], *, copy: bool
) -> tuple[NDArray[np.float64], float]:
    try:
        clock = np.asarray(time, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise MotionError("time must be numbers of shape [pose]") from None
    if clock.shape != (pose_count,):
        raise MotionError(f"time must have shape [{pose_count}], one value a pose, got {list(clock.shape)}")
    bad = _first(~np.isfinite(clock))
    if bad is not None:
        raise MotionError(f"{place(bad)}: time {float(clock[bad])!r} s is not finite")
    shifted = np.ascontiguousarray(clock) if clock[0] == 0.0 and not copy else clock - clock[0]
    bad = _first(shifted[1:] <= shifted[:-1])
    if bad is not None:
        before, after = float(clock[bad]), float(clock[bad + 1])
        name = "repeats" if before == after else "is not after"
        raise MotionError(f"{place(bad + 1)}: time {after!r} s {name} {before!r} s of {place(bad)}")
    shifted.setflags(write=False)
    return shifted, float(clock[0])


def _first(flag: ArrayLike) -> int | None:
    hits = np.flatnonzero(flag)
    return int(hits[0]) if hits.size else None
