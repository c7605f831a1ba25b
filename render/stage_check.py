"""What a stage of a user's own gave: judged before the next stage, or a file, takes it."""

from dataclasses import fields
from typing import Any

import numpy as np

from .contours import ContourBatch
from .errors import StrategyError

DTYPES: dict[str, tuple[Any, str, tuple[int, ...]]] = {  # field: dtype, what a row is, further dimensions
    "points": (np.float32, "point", (3,)),
    "kind": (np.uint8, "point", ()),
    "polyline_start": (np.int64, "polyline + 1", ()),
    "polyline_patch": (np.int32, "polyline", ()),
    "polyline_closed": (np.uint8, "polyline", ()),
    "pose_start": (np.int64, "pose + 1", ()),
}
OPTIONAL = (np.float32, "point", ())  # intensity and whatever else a point may have
KIND_LAST = 2


def checked_batch(result: object, before: ContourBatch, on: str, title: str) -> ContourBatch:
    """What a stage gave as a batch of the right types, on the host or the device as `on` says.

    before: what the stage got: the poses must be as many. title: the stage's name, for errors.
    Raises StrategyError for what is no batch.
    """
    if not isinstance(result, ContourBatch):
        raise StrategyError(f"{title} must give a ContourBatch, not {type(result).__name__}")
    if result.on_device != (on == "device"):
        raise StrategyError(f"{title} must give its arrays on the {on}, as it got them")
    host = result.numpy()
    arrays = {name: _cast(name, value, title) for name, value in host.by_name().items()}
    batch = ContourBatch(**arrays)
    _check_rows(batch, before.pose_count, title)
    _check_lines(batch, title)
    _check_values(batch, title)
    return result if result.on_device else batch


def _cast(name: str, value: Any, title: str) -> np.ndarray:
    """An array of its field's dtype, of integers from integers; refused if values would be lost."""
    dtype, row, rest = DTYPES.get(name, OPTIONAL)
    array = np.asarray(value)
    whole = np.issubdtype(dtype, np.integer)
    if array.dtype == object or (whole and not np.issubdtype(array.dtype, np.integer) and array.dtype != bool):
        raise StrategyError(f"{title}: {name} must be {np.dtype(dtype).name}, not {array.dtype}")
    if array.ndim != 1 + len(rest) or array.shape[1:] != rest:
        shape = ", ".join([row, *map(str, rest)])
        raise StrategyError(f"{title}: {name} must have shape [{shape}], not {list(array.shape)}")
    with np.errstate(over="ignore", invalid="ignore"):  # what does not fit is found below, or not finite
        out = np.ascontiguousarray(array, dtype=dtype)
    if whole and not np.array_equal(out, array):
        raise StrategyError(f"{title}: {name} has values beyond {np.dtype(dtype).name}")
    return out


def _check_rows(batch: ContourBatch, pose_count: int, title: str) -> None:
    """Refuse arrays that do not go together."""
    if batch.pose_count != pose_count:
        raise StrategyError(f"{title}: pose_start must stand for {pose_count} poses, not {batch.pose_count}")
    ends = (("polyline_start", len(batch.points)), ("pose_start", len(batch.polyline_closed)))
    for name, count in ends:
        start = getattr(batch, name)
        if len(start) == 0 or start[0] != 0 or start[-1] != count or (np.diff(start) < 0).any():
            raise StrategyError(f"{title}: {name} must be offsets from 0 to {count} that never fall")
    for field in fields(batch):
        value = getattr(batch, field.name)
        row = DTYPES.get(field.name, OPTIONAL)[1]
        wanted = {"point": len(batch.points), "polyline": len(batch.polyline_start) - 1}.get(row)
        if value is not None and wanted is not None and len(value) != wanted:
            raise StrategyError(f"{title}: {field.name} must have {wanted} rows, not {len(value)}")


def _check_lines(batch: ContourBatch, title: str) -> None:
    """Refuse polylines that are none."""
    start = batch.polyline_start
    short = np.flatnonzero(np.diff(start) < 2)
    if len(short):
        count = start[short[0] + 1] - start[short[0]]
        raise StrategyError(f"{title}: polyline {short[0]} must have two points at least, not {count}")
    if (batch.polyline_closed > 1).any():
        raise StrategyError(f"{title}: polyline_closed must be 0 or 1, not {batch.polyline_closed.max()}")
    closed = np.flatnonzero(batch.polyline_closed)
    apart = closed[(batch.points[start[closed]] != batch.points[start[closed + 1] - 1]).any(axis=1)]
    if len(apart):
        raise StrategyError(f"{title}: polyline {apart[0]} is closed, so it must end with its first point again")


def _check_values(batch: ContourBatch, title: str) -> None:
    """Refuse what is not finite, or out of its range."""
    bad = np.flatnonzero(~np.isfinite(batch.points).all(axis=1))
    if len(bad):
        raise StrategyError(f"{title}: point {bad[0]} is not finite: {batch.points[bad[0]].tolist()}")
    if len(batch.kind) and batch.kind.max() > KIND_LAST:
        raise StrategyError(f"{title}: kind must lie in 0..{KIND_LAST}, not {batch.kind.max()}")
    for name, value in batch.by_name().items():
        high = 1.0 if name == "intensity" else np.inf
        if name not in DTYPES and not ((value >= 0) & (value <= high) & np.isfinite(value)).all():
            raise StrategyError(f"{title}: {name} must be finite and lie in 0..{high:g}")


def checked_removal(removed: object, pose_count: int, title: str) -> np.ndarray:
    """Lengths that a prune stage says it removed [m], float32, shape [pose]; rounding below 0 becomes 0."""
    try:
        out = np.asarray(removed, np.float64)
    except (TypeError, ValueError) as error:
        raise StrategyError(f"{title}: the removed length must be an array of numbers, not {removed!r}") from error
    if out.shape != (pose_count,):
        raise StrategyError(f"{title}: the removed length must have shape [{pose_count}], not {list(out.shape)}")
    if not np.isfinite(out).all() or out.min(initial=0.0) < -1e-4:
        raise StrategyError(f"{title}: the removed length must be finite and not negative, not {out.min()}")
    return np.maximum(out, 0.0).astype(np.float32)
