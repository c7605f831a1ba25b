"""Emphasis: what of contours is strong and what is weak, by corners, by kind, by depth; and pauses at corners."""

import math
from collections import OrderedDict
from dataclasses import replace
from threading import Lock

import numpy as np
import warp as wp

from ...kernels.solids.depth import measure_depth, mesh_for_depth
from ...kernels.stages.corner_ramps import pause_at_corners, ramp_rows, weigh_corners
from ...kernels.stages.corners import find_corners
from ...kernels.stages.edges import KindLevels, level_by_kind, measure_runs, ramp_between_levels
from ...kernels.stages.insertion import insert_points
from ..contour_batch import ContourBatch
from ..objects.moving_object import back_to
from ..objects.solid import Solid
from .point_insertion import divide_batch
from .polyline_arrays import times
from .registry import Option, Setting, transform_stage

STRAIGHT = math.radians(5.0)  # a straight edge turns by less from segment to segment
RAMP = 1e-3  # [m] over which intensity changes between segments
MESHES_KEPT = 4  # of objects whose depth was asked last


@transform_stage(
    "corners",
    on="device",
    angle=Option(math.pi / 6, 0.0, math.pi, "rad"),
    window=Option(None, 1e-5, 0.1, "m", widths=0.5),
    reach=Option(None, 1e-5, 0.1, "m", widths=1.0),
    level=Option(0.4, 0.0, 1.0),
    dwell=Option(0.0, 0.0, 10.0, "s"),
)
def emphasise_corners(
    batch: ContourBatch, setting: Setting, *, angle: float, window: float, reach: float, level: float, dwell: float
) -> ContourBatch:
    """Corners at full intensity, the rest weaker; with an option the focal point pauses there.

    A corner is a vertex where the way within `window` [m] behind it turns by more than `angle` [rad] from that within
    `window` before it; of several within a window the sharpest. Rounded corners count, finely drawn arcs do not. From a
    corner the intensity stays at 1 for half of `reach` [m] and falls to `level` over the other half. dwell: pause at
    each corner [s].
    """
    lines = (batch.polyline_start, batch.polyline_closed)
    corners = find_corners(batch.points, *lines, angle=angle, window=window)
    rows = ramp_rows(corners, reach, setting.point_limit)
    weights = {"intensity": batch.intensity, "dwell": batch.dwell}
    new = insert_points(batch.points, batch.kind, batch.polyline_start, *rows, **weights)
    return replace(
        batch,
        points=new.points,
        kind=new.kind,
        polyline_start=new.polyline_start,
        intensity=weigh_corners(new, corners, reach=reach, level=level),
        dwell=new.dwell if dwell == 0 else pause_at_corners(new, corners, dwell),
    )


@transform_stage(
    "edges",
    on="device",
    on_object=Option(1.0, 0.0, 1.0),
    on_hand=Option(0.4, 0.0, 1.0),
    on_made=Option(1.0, 0.0, 1.0),
    curved=Option(0.4, 0.0, 1.0),
    shortest=Option(0.0, 0.0, 1.0, "m"),
)
def emphasise_edges(
    batch: ContourBatch,
    setting: Setting,
    *,
    on_object: float,
    on_hand: float,
    on_made: float,
    curved: float,
    shortest: float,
) -> ContourBatch:
    """Edges of the object at full intensity, those of the hand weaker, or as options say by kind.

    shortest: of the object's contours only straight runs this long [m] have the intensity `on_object`, the others
    `curved`; a run ends where the contour turns by 5 degrees. Between kinds the intensity changes within 1 mm of the
    weaker one.
    """
    lines = (batch.points, batch.kind, batch.polyline_start, batch.polyline_closed)
    run = measure_runs(*lines, math.cos(STRAIGHT)) if shortest > 0 else None
    level = level_by_kind(batch.kind, KindLevels(on_object, on_hand, on_made, curved), run, shortest)
    limits = {"ramp": RAMP, "point_limit": setting.point_limit}
    new = ramp_between_levels(*lines, level=level, intensity=batch.intensity, dwell=batch.dwell, **limits)
    values = {"points": new.points, "kind": new.kind, "intensity": new.intensity, "dwell": new.dwell}
    return replace(batch, polyline_start=new.polyline_start, **values)


_MESHES: OrderedDict[tuple[str, str], wp.Mesh] = OrderedDict()
_LOCK = Lock()


def mesh_of(solid: Solid, device: str) -> wp.Mesh:
    """The object's outline on a device, kept for the next batch."""
    key = (solid.described()["hash"], device)
    with _LOCK:
        mesh = _MESHES.get(key)
        if mesh is None:
            mesh = _MESHES[key] = mesh_for_depth(*solid.outline_mesh(), device)
        _MESHES.move_to_end(key)
        while len(_MESHES) > MESHES_KEPT:
            _MESHES.popitem(last=False)
        return mesh


@transform_stage(
    "depth",
    needs_closed=True,
    at=Option("patch", choices=("point", "patch", "pose")),
    shallow=Option(0.0, 0.0, 1.0, "m"),
    deep=Option(0.02, 1e-6, 1.0, "m"),
    lowest=Option(0.3, 0.0, 1.0),
    grid=Option(9, 2, 65),
    spacing=Option(None, 1e-4, 1.0, "m", widths=0.5),
)
def weigh_by_depth(
    batch: ContourBatch,
    setting: Setting,
    *,
    at: str,
    shallow: float,
    deep: float,
    lowest: float,
    grid: int,
    spacing: float,
) -> ContourBatch:
    """Intensity by how deep the skin is in the object.

    It grows from `lowest` at the depth `shallow` [m] to 1 at `deep` [m]; depth is the distance to the object's surface.
    at "patch": all contours of a patch by the deepest of grid x grid points of it, "pose": by that of the whole hand;
    "point": each point by its own depth, segments divided to at most `spacing` [m]. The object's own contours have the
    depth 0, so "point" is for what runs inside: hand edges, "hatch", "ellipse".
    """
    if deep <= shallow:  # one step, at `shallow`
        deep = shallow + 1e-9
    line_pose = np.repeat(np.arange(batch.pose_count), np.diff(batch.pose_start))
    if at == "point":
        batch = divide_batch(batch, spacing)
        depth = _depth(setting, batch.points, np.repeat(line_pose, np.diff(batch.polyline_start)))
    else:
        deepest = _deepest(setting, grid)
        if at == "pose":
            deepest = np.repeat(deepest.max(axis=1, keepdims=True), deepest.shape[1], axis=1)
        depth = np.repeat(deepest[line_pose, batch.polyline_patch], np.diff(batch.polyline_start))
    share = np.clip((depth.astype(np.float64) - shallow) / (deep - shallow), 0.0, 1.0)
    return times(batch, lowest + (1.0 - lowest) * share)


def _depth(setting: Setting, points: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Depth of points in the object, wherever it is at their poses [m], float32, shape [point]."""
    if setting.object_pose is not None and len(row):
        object_centre = setting.solid.bounds.mean(axis=0) if setting.object_centre is None else setting.object_centre
        points = back_to(setting.object_pose[row], object_centre, points)
    return measure_depth(mesh_of(setting.solid, setting.device), points)


def _deepest(setting: Setting, grid: int) -> np.ndarray:
    """Depth of the deepest of grid x grid points of each patch [m], float32, shape [pose, patch]."""
    frames = setting.frames
    along = np.linspace(-1.0, 1.0, grid)
    a, b = (part.ravel() for part in np.meshgrid(along, along))
    half = frames.half[None, :, None, :]
    u, v = (half[..., 0] * a)[..., None] * frames.u[:, :, None], (half[..., 1] * b)[..., None] * frames.v[:, :, None]
    points = frames.origin[:, :, None] + u + v
    shape = points.shape[:3]
    row = np.broadcast_to(np.arange(shape[0])[:, None, None], shape).ravel()
    there = np.isfinite(points).all(axis=-1)  # a patch may be absent
    depth = _depth(setting, np.nan_to_num(points).reshape(-1, 3), row)
    return np.where(there, depth.reshape(shape), np.float32(0)).max(axis=2)
