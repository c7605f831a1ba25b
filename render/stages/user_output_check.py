"""What a stage of a user's own gave: judged before the next stage, or a file, takes it."""

from typing import Any

import numpy as np
import warp as wp

from ...kernels.contours import LINE_COLUMNS, POINT_COLUMNS
from ..contour_batch import ContourBatch, require_seams
from ..errors import StrategyError

DTYPES: dict[str, tuple[Any, str, tuple[int, ...]]] = {  # field: dtype, what a row is, further dimensions
    "points": (np.float32, "point", (3,)),
    "kind": (np.uint8, "point", ()),
    "polyline_start": (np.int64, "polyline + 1", ()),
    "polyline_patch": (np.int32, "polyline", ()),
    "polyline_closed": (np.uint8, "polyline", ()),
    "pose_start": (np.int64, "pose + 1", ()),
}
ON_DEVICE = {**POINT_COLUMNS, **LINE_COLUMNS, "polyline_start": wp.int64, "pose_start": wp.int64}
OPTIONAL = (np.float32, "point", ())  # intensity and whatever else a point may have
KIND_LAST = 2
LENGTH_OFF, LENGTH_SHARE = 1e-4, 1e-3  # [m], and of what there was: rounding of a length removed


def checked_batch(
    result: object, title: str, *, pose_count: int, patch_count: int, device: str | None = None
) -> ContourBatch:
    """What a stage gave as a batch of the right types, on the device it ran on; None: on the host.

    title: the stage's name, for errors. patch_count: of the hand. Raises StrategyError for what is no batch.
    """
    on = "host" if device is None else "device"
    if not isinstance(result, ContourBatch):
        raise StrategyError(f"{title} must give a ContourBatch, not {type(result).__name__}")
    given = result.by_name()
    for name in DTYPES:
        if name not in given:
            raise StrategyError(f"{title}: {name} must be an array, not None")
    wrong = [name for name, value in given.items() if isinstance(value, wp.array) != (device is not None)]
    if wrong:
        raise StrategyError(f"{title} must give its arrays on the {on}, as it got them, but {wrong[0]} is elsewhere")
    batch = ContourBatch(**{name: _cast(name, value, title) for name, value in given.items()})
    _check_rows(batch, pose_count, title)
    _check_values(batch, patch_count, title)
    _check_lines(batch, title)
    if device is None:
        return batch
    fits = all(
        value.dtype is ON_DEVICE[name] and value.device == wp.get_device(device) for name, value in given.items()
    )
    return result if fits else batch.to(device)


def _cast(name: str, value: Any, title: str) -> np.ndarray:
    """An array of its field's dtype on the host, of integers from integers; refused if values would be lost."""
    dtype, row, rest = DTYPES.get(name, OPTIONAL)
    try:
        array = value.numpy() if isinstance(value, wp.array) else np.asarray(value)
    except (TypeError, ValueError) as error:  # rows of different lengths
        raise StrategyError(f"{title}: {name} must be an array of {np.dtype(dtype).name}: {error}") from error
    whole = np.issubdtype(dtype, np.integer)
    if array.dtype.kind not in ("iub" if whole else "iubf"):
        raise StrategyError(f"{title}: {name} must be {np.dtype(dtype).name}, not {array.dtype}")
    if array.size == 0 and isinstance(value, wp.array):
        array = array.reshape(0, *rest)  # whatever Warp makes of no vectors
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
    for name, value in batch.by_name().items():
        row = DTYPES.get(name, OPTIONAL)[1]
        wanted = {"point": len(batch.points), "polyline": len(batch.polyline_start) - 1}.get(row)
        if wanted is not None and len(value) != wanted:
            raise StrategyError(f"{title}: {name} must have {wanted} rows, not {len(value)}")


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
    require_seams(batch, title)


def _check_values(batch: ContourBatch, patch_count: int, title: str) -> None:
    """Refuse what is not finite, or out of its range."""
    bad = np.flatnonzero(~np.isfinite(batch.points).all(axis=1))
    if len(bad):
        raise StrategyError(f"{title}: point {bad[0]} is not finite: {batch.points[bad[0]].tolist()}")
    if len(batch.kind) and batch.kind.max() > KIND_LAST:
        raise StrategyError(f"{title}: kind must lie in 0..{KIND_LAST}, not {batch.kind.max()}")
    patch = batch.polyline_patch
    if len(patch) and not 0 <= patch.min() <= patch.max() < patch_count:
        bad = int(patch[np.flatnonzero((patch < 0) | (patch >= patch_count))[0]])
        raise StrategyError(f"{title}: polyline_patch must lie in 0..{patch_count - 1}, the hand's patches, not {bad}")
    for name, value in batch.by_name().items():
        high = 1.0 if name == "intensity" else np.inf
        if name not in DTYPES and not ((value >= 0) & (value <= high) & np.isfinite(value)).all():
            raise StrategyError(f"{title}: {name} must be finite and lie in 0..{high:g}")


def checked_removal(removed: object, gone: np.ndarray, before: np.ndarray, title: str) -> np.ndarray:
    """Lengths that a prune stage says it removed [m], float32, shape [pose]; rounding below 0 becomes 0.

    gone: by how much contours are shorter than before [m]; before: their length [m], both of shape [pose].
    """
    try:
        out = np.asarray(removed, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise StrategyError(f"{title}: the removed length must be an array of numbers, not {removed!r}") from error
    if out.shape != gone.shape:
        raise StrategyError(f"{title}: the removed length must have shape [{len(gone)}], not {list(out.shape)}")
    if not np.isfinite(out).all() or out.min(initial=0.0) < -1e-4:
        raise StrategyError(f"{title}: the removed length must be finite and not negative, not {out.min()}")
    bad = np.flatnonzero(np.abs(out - gone) > LENGTH_OFF + LENGTH_SHARE * before)
    if len(bad):
        raise StrategyError(
            f"{title}: said to have removed {out[bad[0]]:.4g} m of pose {bad[0]} of the batch, whose contours are "
            f"{gone[bad[0]]:.4g} m shorter"
        )
    return np.maximum(out, 0.0).astype(np.float32)
