"""Emphasis by depth: contours are the stronger the deeper the skin is in the object."""

from collections import OrderedDict
from threading import Lock

import numpy as np
import warp as wp

from ...kernels.contours import with_columns
from ...kernels.emphasis.depth import find_deepest, make_ramp, place_body, weigh_by_patch, weigh_by_point
from ...kernels.solids.distance import mesh_for_depth
from ...kernels.stages.insertion import divide_contours
from ..contour_batch import ContourBatch
from ..objects.solid import Solid
from .registry import Option, transform_stage
from .setting import Setting

CACHE_SIZE = 4  # meshes, of the objects whose depth was asked last
_MESHES: OrderedDict[tuple[str, str], wp.Mesh] = OrderedDict()
_LOCK = Lock()


def mesh_of(solid: Solid, device: str) -> wp.Mesh:
    """The object's outline on a device, cached for the next batch."""
    key = (solid.described()["hash"], device)
    with _LOCK:
        mesh = _MESHES.get(key)
        if mesh is None:
            mesh = _MESHES[key] = mesh_for_depth(*solid.outline_mesh(), device)
        _MESHES.move_to_end(key)
        while len(_MESHES) > CACHE_SIZE:
            _MESHES.popitem(last=False)
        return mesh


@transform_stage(
    "depth",
    on="device",
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
    ramp, mesh = make_ramp(shallow, deep, lowest), mesh_of(setting.solid, setting.device)
    pose, centre = setting.object_pose, setting.object_centre
    if pose is not None:
        pose = wp.array(np.ascontiguousarray(pose, np.float32), dtype=wp.transform, device=setting.device)
        centre = setting.solid.bounds.mean(axis=0) if centre is None else centre
    body = place_body(mesh, pose, centre)
    if at == "point":
        contours = divide_contours(batch.struct, spacing, setting.point_limit)
        intensity = weigh_by_point(contours, body, ramp)
    else:
        contours = batch.struct
        depth = find_deepest(contours, body, setting.patches, ramp, grid=grid, whole=at == "pose")
        intensity = weigh_by_patch(contours, depth, ramp)
    return ContourBatch.from_struct(with_columns(contours, intensity=intensity))
