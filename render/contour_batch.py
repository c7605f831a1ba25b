"""ContourBatch: the contours of many poses, ragged, on the host or on one Warp device."""

import operator
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, overload

import numpy as np
import warp as wp

from ..datasets.counted import counted
from ..datasets.known_names import find_name, unknown_name
from ..kernels.contours import LINE_COLUMNS, POINT_COLUMNS, Contours, measure_contours, with_columns
from ..kernels.one_device import require_one_device
from ..kernels.section.draw import HAND, MADE, OBJECT
from .errors import StrategyError
from .validation import value_text

OTHER_POSES = "[batch[i] for i in numbers] takes any poses, render(..., motion) of them gives a batch"
KINDS = {"object": OBJECT, "hand": HAND, "made": MADE}

Array = Any  # np.ndarray or wp.array; all arrays of a batch are of one type (`ContourBatch.on_device`)


@dataclass(frozen=True, eq=False)
class ContourBatch:
    """Contours of many poses in CSR form, all arrays on the host (NumPy) or all on one Warp device.

    Polylines of a pose are ordered by (patch, key); a pose without contours has an empty range. `len` is the number of
    poses; `batch[i]`, and iteration, give the polylines of a pose as arrays of points [m].

    >>> from palpate.render import MeshObject, Palm, render, static_pose
    >>> batch = render(MeshObject.load("cube"), Palm(), static_pose([0, 0, 0.2]), "cc")
    >>> len(batch), batch[0][0].shape  # one pose; its first polyline is a square, whose last point is the first again
    (1, (5, 3))
    """

    points: Array
    """Vertices of polylines [m], array frame, float32, shape [point, 3] (vec3 [point] on a device)."""
    kind: Array
    """Kind of the segment that starts here: 0 object, 1 hand, 2 made; a last point repeats it; uint8, shape [point]."""
    polyline_start: Array
    """Offsets into points, int64, shape [polyline + 1]."""
    polyline_patch: Array
    """Index of the hand's patch, int32, shape [polyline]."""
    polyline_closed: Array
    """1 for a closed polyline, which also repeats its first point at its end; uint8, shape [polyline]."""
    pose_start: Array
    """Offsets into polylines, int64, shape [pose + 1]."""
    intensity: Array | None = None
    """0..1 at each point, linear in between; None means 1; float32, shape [point]."""
    dwell: Array | None = None
    """Pause of the focal point at each point [s]; None means none; float32, shape [point]."""
    raw_error: float | None = None
    """How far the raw intersection can be from the exact one [m], except for what is thinner than a step
    (docs/develop/geometry.md, "Grids"); see `Scene.raw_error`; None where that is not known.
    It is no array, so `by_name` and `arrays` leave it out."""

    def __repr__(self) -> str:
        """One line: counts, and where the arrays are."""
        start = self.pose_start.numpy() if self.on_device else self.pose_start
        drawn = int(np.count_nonzero(np.diff(start)))
        place = str(self.points.device) if self.on_device else "the host"
        counts = (
            f"{counted(self.pose_count, 'pose')}, {drawn} with contours, {counted(self.polyline_count, 'polyline')}"
        )
        return f"{type(self).__name__}({counts}, {counted(self.point_count, 'point')}, on {place})"

    def __len__(self) -> int:
        """Number of poses."""
        return self.pose_count

    def __bool__(self) -> bool:
        """True, also without poses: a batch is no test for contours, `len` and `point_count` are."""
        return True

    @overload
    def __getitem__(self, index: int) -> list[np.ndarray]: ...

    @overload
    def __getitem__(self, index: slice) -> "ContourBatch": ...

    def __getitem__(self, index: int | slice) -> "list[np.ndarray] | ContourBatch":
        """Polylines of one pose [m], each of shape [point, 3]; or the batch of consecutive poses first:stop."""
        if isinstance(index, slice):
            first, stop, step = index.indices(self.pose_count)
            if step != 1:
                raise IndexError(f"poses must follow each other: the step must be 1, not {step}; {OTHER_POSES}")
            return self.numpy().select(first, max(first, stop))
        try:
            pose = operator.index(None if isinstance(index, bool) else index)  # type: ignore[arg-type]
        except TypeError:
            text = f"an index must be a pose's number or first:stop, not {value_text(index)}; {OTHER_POSES}"
            raise TypeError(text) from None
        if not -self.pose_count <= pose < self.pose_count:
            raise IndexError(f"pose {pose} is outside the batch's {self.pose_count} poses")
        return self.numpy().polylines_of(pose % self.pose_count)

    def __iter__(self) -> Iterator[list[np.ndarray]]:
        """Polylines of each pose."""
        host = self.numpy()
        return (host.polylines_of(pose) for pose in range(host.pose_count))

    @property
    def pose_count(self) -> int:
        """Number of poses."""
        return self.pose_start.shape[0] - 1

    @property
    def polyline_count(self) -> int:
        """Number of polylines."""
        return self.polyline_closed.shape[0]

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.kind.shape[0]

    @property
    def on_device(self) -> bool:
        """Whether the arrays are Warp's."""
        return isinstance(self.points, wp.array)

    @classmethod
    def from_struct(cls, contours: Any, raw_error: float | None = None) -> "ContourBatch":
        """Batch on a device of the contours that kernels gave."""
        batch = cls(**{name: getattr(contours, name) for name in array_names()}, raw_error=raw_error)
        batch.__dict__["struct"] = contours
        return batch

    @classmethod
    def of_sections(cls, contours: Any, patch_count: int) -> "ContourBatch":
        """Batch on a device of contours by section, of which each pose has one on each patch."""
        start = contours.pose_start
        if patch_count > 1:
            contours = with_columns(contours, pose_start=wp.clone(start[::patch_count].contiguous()))
        return cls.from_struct(contours)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray]) -> "ContourBatch":
        """Batch from the arrays of a contour file, which have the names of the fields."""
        return cls(**{name: arrays[name] for name in array_names() if name in arrays})

    def by_name(self) -> dict[str, Array]:
        """Arrays by name, without those that are None; on the host or device as the batch."""
        return {name: value for name in array_names() if (value := getattr(self, name)) is not None}

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name, without those that are None, as NumPy arrays."""
        return self.numpy().by_name()

    def numpy(self) -> "ContourBatch":
        """The same batch on the host."""
        if not self.on_device:
            return self
        host = {name: value.numpy() for name, value in self.by_name().items()}
        return replace(self, **{**host, "points": self.points.numpy().reshape(-1, 3)})

    def to(self, device: str) -> "ContourBatch":
        """The same batch on a Warp device."""
        if self.on_device and str(self.points.device) == device:
            return self
        host = self.numpy()
        values = {name: wp.array(value, device=device) for name, value in host.by_name().items() if name != "points"}
        points = wp.array(np.ascontiguousarray(host.points, np.float32).reshape(-1, 3), dtype=wp.vec3, device=device)
        return replace(self, points=points, **values)

    @cached_property
    def struct(self) -> Any:
        """The columns of a batch on a device as one struct for kernels."""
        require_one_device(batch=self)
        out = Contours()
        for name, value in self.by_name().items():
            setattr(out, name, value)
        return out

    def lengths(self) -> np.ndarray:
        """Length of the segments of each kind [m], float32, shape [pose, 3]."""
        if self.on_device:
            return measure_contours(self.struct).numpy()
        segment = np.linalg.norm(np.diff(self.points.astype(np.float64), axis=0), axis=1)
        first = self.polyline_start[1:-1]
        segment[first[(first > 0) & (first < self.point_count)] - 1] = 0.0  # between polylines
        point_pose = np.repeat(np.arange(self.pose_count), np.diff(self.polyline_start[self.pose_start]))
        out = np.zeros((self.pose_count, 3))
        np.add.at(out, (point_pose[:-1], self.kind[:-1]), segment)
        return out.astype(np.float32)

    def length(self, kind: str | None = None) -> np.ndarray:
        """Length of all contours of a pose, or of those of one kind ("object", "hand", "made") [m], shape [pose]."""
        found = find_name(kind, KINDS)
        if kind is not None and found is None:
            raise StrategyError(unknown_name("kind", kind, KINDS))
        lengths = self.lengths()
        return lengths.sum(axis=1) if found is None else lengths[:, KINDS[found]]

    def polylines_of(self, pose: int) -> list[np.ndarray]:
        """Points of each polyline of one pose [m], each of shape [point, 3]; for a batch on the host."""
        first, stop = self.pose_start[pose], self.pose_start[pose + 1]
        return [self.points[self.polyline_start[i] : self.polyline_start[i + 1]] for i in range(first, stop)]

    def select(self, first: int, stop: int) -> "ContourBatch":
        """Poses first..stop of a batch on the host, offsets starting at 0."""
        stop = max(first, stop)
        line, end = self.pose_start[first], self.pose_start[stop]
        point, last = self.polyline_start[line], self.polyline_start[end]
        return ContourBatch(
            **{name: value[point:last] for name, value in self.by_name().items() if name in POINT_COLUMNS},
            **{name: getattr(self, name)[line:end] for name in LINE_COLUMNS},
            polyline_start=self.polyline_start[line : end + 1] - point,
            pose_start=self.pose_start[first : stop + 1] - line,
            raw_error=self.raw_error,
        )


def array_names() -> list[str]:
    """Names of a batch's arrays."""
    return [f.name for f in fields(ContourBatch) if f.name != "raw_error"]


def largest_error(batches: Sequence[ContourBatch]) -> float | None:
    """The largest `raw_error` of batches [m]; None if one of them is unknown."""
    errors = [batch.raw_error for batch in batches if batch.raw_error is not None]
    return max(errors) if errors and len(errors) == len(batches) else None


def with_values_of_all(batches: Sequence[ContourBatch]) -> list[ContourBatch]:
    """Batches on the host that all have intensities, and pauses, if one of them has: 1, and 0, where one has none."""
    out = list(batches)
    for name, missing in (("intensity", 1.0), ("dwell", 0.0)):
        if any(getattr(batch, name) is not None for batch in out):
            out = [
                replace(batch, **{name: np.full(batch.point_count, missing, np.float32)})
                if getattr(batch, name) is None
                else batch
                for batch in out
            ]
    return out


def join_batches(batches: Sequence[ContourBatch]) -> ContourBatch:
    """Join batches of consecutive poses on the host."""
    if len(batches) == 1:
        return batches[0]
    batches = with_values_of_all(batches)

    def offsets(name: str) -> np.ndarray:
        steps = [np.diff(getattr(b, name)) for b in batches]
        return np.concatenate([[0], np.cumsum(np.concatenate(steps))]).astype(np.int64)

    columns = {
        name: offsets(name) if name.endswith("_start") else np.concatenate([getattr(b, name) for b in batches])
        for name in batches[0].by_name()
    }
    return ContourBatch(**columns, raw_error=largest_error(batches))


def join_polylines(one: ContourBatch, other: ContourBatch) -> ContourBatch:
    """Join two batches of the same poses on the host; for each pose and patch, the polylines of `one` come first."""
    both = join_batches([one, other])
    count = np.concatenate([np.diff(one.pose_start), np.diff(other.pose_start)])
    pose = np.repeat(np.tile(np.arange(one.pose_count), 2), count)
    order = np.lexsort((np.arange(len(pose)), both.polyline_patch, pose))
    size = np.diff(both.polyline_start)[order]
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    points = np.repeat(both.polyline_start[:-1][order] - start[:-1], size) + np.arange(start[-1])
    return replace(
        both,
        **{name: value[points] for name, value in both.by_name().items() if name in POINT_COLUMNS},
        **{name: getattr(both, name)[order] for name in LINE_COLUMNS},
        polyline_start=start,
        pose_start=np.concatenate([[0], np.cumsum(np.bincount(pose, minlength=one.pose_count))]).astype(np.int64),
    )


def object_part(batch: ContourBatch) -> ContourBatch:
    """Only the object's segments of a batch on the host, which makes open contours (OC) from closed ones (CC).

    A closed polyline of object segments alone stays closed. Every other run of object segments becomes an open
    polyline that starts where the run enters the patch.
    """
    closed, patches, counts = [], [], []
    pieces: list[np.ndarray] = []
    for pose in range(batch.pose_count):
        found = []
        for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
            first, last = batch.polyline_start[line], batch.polyline_start[line + 1] - 1
            index = np.arange(first, last + 1)
            own = batch.kind[first:last] == OBJECT
            if own.all():
                found.append((index, batch.polyline_closed[line], batch.polyline_patch[line]))
                continue
            if batch.polyline_closed[line]:
                turn = int(np.flatnonzero(~own)[0])
                index, own = np.concatenate([index[turn:-1], index[: turn + 1]]), np.roll(own, -turn)
            edge = np.flatnonzero(np.diff(np.concatenate([[0], own.astype(np.int8), [0]])))
            for a, b in edge.reshape(-1, 2):
                found.append((index[a : b + 1], 0, batch.polyline_patch[line]))
        for index, is_closed, patch in found:
            pieces.append(index)
            closed.append(is_closed)
            patches.append(patch)
        counts.append(len(found))
    index = np.concatenate(pieces) if pieces else np.zeros(0, np.int64)
    columns = {name: value[index] for name, value in batch.by_name().items() if name in POINT_COLUMNS}
    return ContourBatch(
        **{**columns, "kind": np.zeros(len(index), np.uint8)},
        polyline_start=np.concatenate([[0], np.cumsum([len(p) for p in pieces])]).astype(np.int64),
        polyline_patch=np.array(patches, np.int32),
        polyline_closed=np.array(closed, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        raw_error=batch.raw_error,
    )


def without_empty_polylines(batch: ContourBatch) -> ContourBatch:
    """A batch on the host without the polylines that have no point."""
    kept = np.diff(batch.polyline_start) > 0
    if kept.all():
        return batch
    return replace(
        batch,
        polyline_start=np.append(batch.polyline_start[:-1][kept], batch.polyline_start[-1]),
        polyline_patch=batch.polyline_patch[kept],
        polyline_closed=batch.polyline_closed[kept],
        pose_start=np.append(0, np.cumsum(kept))[batch.pose_start],
    )


def require_finite(batch: ContourBatch, title: str) -> None:
    """Raise StrategyError for a point, intensity or pause of a batch on the host that is no finite number.

    title: begins the error message.
    """
    for name in ("points", "intensity", "dwell"):
        value = getattr(batch, name)
        if value is None or np.isfinite(value).all():
            continue
        k = int(np.argwhere(~np.isfinite(value))[0, 0])
        line = int(np.searchsorted(batch.polyline_start, k, side="right")) - 1
        pose = int(np.searchsorted(batch.pose_start, line, side="right")) - 1
        raise StrategyError(
            f"{title}: {name}[{k}] must be finite, not {value_text(value[k].tolist())} (pose {pose}, polyline {line})"
        )


def require_seams(batch: ContourBatch, title: str) -> None:
    """Raise StrategyError for a closed polyline on the host whose first and last point differ in intensity or dwell.

    They are one place, and sampling passes it once per cycle, so one of two values would be lost.
    title: begins the error message.
    """
    for name in ("intensity", "dwell"):
        value = getattr(batch, name)
        if value is None:
            continue
        line = np.flatnonzero((batch.polyline_closed != 0) & (np.diff(batch.polyline_start) > 0))
        first, last = (value[batch.polyline_start[line]], value[batch.polyline_start[line + 1] - 1])
        differs = np.flatnonzero(first != last)
        if len(differs):
            k = differs[0]
            raise StrategyError(
                f"{title}: polyline {line[k]} is closed, so {name} at its last point must be that at its first, "
                f"{first[k]:g}, not {last[k]:g}"
            )
