"""Intensity of contours by how deep the skin is inside a mesh.

The distance from the surface changes by no more than the distance of two points. So a patch's deepest grid point is
found without asking the mesh about most of them, and a point is on the side of the point before it where the surface is
too far from both to lie between them. Neither changes a bit of the depth.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from ..contours import Contours, find_poses
from ..offsets import count_then_fill, launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float32, to_float64
from ..solids.distance import distance_within, is_within
from ..stages.prune import Patches, turn_by

wp.set_module_options(EXACT)

MARGIN = wp.constant(wp.float32(1e-5))  # [m]; more than float32 rounds distances by
RUN = wp.constant(wp.int64(16))  # points of a polyline that one thread measures, one after the other
CELLS_MOST = 32  # of a grid that wait to be divided: 3 for each of 8 halvings of 129 points, and more
CellStack = wp.types.vector(length=CELLS_MOST, dtype=wp.int32)
GRID_MOST = 128  # points along a side


@wp.struct
class Body:
    """A closed mesh, and where it is at each pose."""

    mesh: wp.uint64
    pose: wp.array[wp.transform]  # of its centre [m], shape [pose]; empty: it stands still
    centre: wp.vec3d  # of the mesh as it was placed [m]


@wp.struct
class Ramp:
    """Intensity by depth: `lowest` up to the depth `shallow`, from there linear to 1 at `deep`."""

    shallow: wp.float64  # [m]
    deep: wp.float64  # [m]
    lowest: wp.float64


@wp.func
def strength_at(ramp: Ramp, depth: float):
    """Intensity at a depth."""
    share = (wp.float64(depth) - ramp.shallow) / (ramp.deep - ramp.shallow)
    share = wp.clamp(share, wp.float64(0.0), wp.float64(1.0))
    return ramp.lowest + (wp.float64(1.0) - ramp.lowest) * share


@wp.func
def weaken(c: Contours, i: wp.int64, strength: wp.float64):
    """A point's intensity times a strength."""
    if c.intensity.shape[0] > 0:
        strength = strength * wp.float64(c.intensity[i])
    return wp.float32(wp.clamp(strength, wp.float64(0.0), wp.float64(1.0)))


@wp.func
def farthest_asked(ramp: Ramp):
    """Distance [m] above `deep` from which on all are alike."""
    return wp.float32(ramp.deep) + MARGIN


@wp.func
def seen_from_body(body: Body, row: int, x: wp.vec3d):
    """A point where it is on the mesh as placed, as `render.objects.moving_object.back_to` has it."""
    if body.pose.shape[0] > 0:
        q = wp.transform_get_rotation(body.pose[row])
        a = to_float64(wp.vec3(q[0], q[1], q[2]))
        w = wp.float64(q[3])
        size = wp.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + w * w)
        back = wp.vec3d(-(a[0] / size), -(a[1] / size), -(a[2] / size))
        to = to_float64(wp.transform_get_translation(body.pose[row]))
        x = -turn_by(back, w / size, to) + turn_by(back, w / size, x) + body.centre
    return to_float32(x)


@wp.func
def cell_of(i: int, k: int, j: int, m: int):
    """The cell of a grid's columns i..k and rows j..m, each below GRID_MOST, as a number."""
    return i + 128 * (k + 128 * (j + 128 * m))


@wp.func
def divide_cell(cells: CellStack, waiting: int, i0: int, i1: int, j0: int, j1: int):
    """The stack with the four parts of a cell around its middle point, those that are not empty."""
    i = (i0 + i1) // 2
    j = (j0 + j1) // 2
    if i0 < i:
        cells[waiting] = cell_of(i0, i - 1, j0, j)
        waiting += 1
    if j < j1:
        cells[waiting] = cell_of(i0, i, j + 1, j1)
        waiting += 1
    if i < i1:
        cells[waiting] = cell_of(i + 1, i1, j, j1)
        waiting += 1
    if j0 < j:
        cells[waiting] = cell_of(i, i1, j0, j - 1)
        waiting += 1
    return cells, waiting


@wp.func
def deepest_in(
    body: Body, patches: Patches, along: wp.array[wp.float64], ramp: Ramp, pose: int, patch: int, best: float
):
    """Depth of the deepest point of a grid over a patch [m], if it is deeper than `best`.

    A cell of the grid is left out where no point of it can be deeper than the best one yet: by the depth of its middle
    and the distance from there to its corners.
    """
    origin = patches.origin[pose, patch]
    half = patches.half[patch]
    if not wp.isfinite(origin[0] + origin[1] + origin[2]):  # the patch is not there
        return best
    last = along.shape[0] - 1
    step_u = 2.0 * wp.float32(half[0]) / wp.float32(last)
    step_v = 2.0 * wp.float32(half[1]) / wp.float32(last)
    cells = CellStack()
    cells[0] = cell_of(0, last, 0, last)
    waiting = int(1)
    while waiting > 0 and wp.float64(best) < ramp.deep:
        waiting -= 1
        cell = cells[waiting]
        i0 = cell % 128
        i1 = (cell // 128) % 128
        j0 = (cell // 16384) % 128
        j1 = cell // 2097152
        i = (i0 + i1) // 2
        j = (j0 + j1) // 2
        x = origin + (half[0] * along[i]) * patches.u[pose, patch] + (half[1] * along[j]) * patches.v[pose, patch]
        point = seen_from_body(body, pose, x)
        to_u = step_u * wp.float32(wp.max(i - i0, i1 - i))
        to_v = step_v * wp.float32(wp.max(j - j0, j1 - j))
        reach = wp.sqrt(to_u * to_u + to_v * to_v) + MARGIN
        distance = distance_within(body.mesh, point, farthest_asked(ramp) + reach)
        if distance + reach > best:
            most = reach - distance
            if is_within(body.mesh, point):
                best = wp.max(best, distance)
                most = reach + distance
            if most > best:
                cells, waiting = divide_cell(cells, waiting, i0, i1, j0, j1)
    return best


@wp.kernel
def _mark_patches(c: Contours, drawn: wp.array2d[wp.uint8]):
    """Mark the patches of a pose that have contours; drawn: zero-initialised, shape [pose, patch]."""
    pose = wp.tid()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        drawn[pose, c.polyline_patch[line]] = wp.uint8(1)


@wp.kernel
def _find_deepest(
    # In:
    body: Body,
    patches: Patches,
    along: wp.array[wp.float64],  # -1..1, the grid's points along a side
    ramp: Ramp,
    c: Contours,
    drawn: wp.array2d[wp.uint8],
    whole: int,  # 1: of all patches of a pose together
    # Out:
    depth: wp.array2d[wp.float32],  # [m], shape [pose, patch], or [pose, 1] of the whole hand
):
    """Find the deepest point of a patch, or of a pose, that has contours; nothing above `Ramp.shallow` is looked at."""
    pose, patch = wp.tid()
    best = wp.max(wp.float32(ramp.shallow) - MARGIN, 0.0)
    if whole == 0:
        if drawn[pose, patch] != wp.uint8(0):
            best = deepest_in(body, patches, along, ramp, pose, patch, best)
    elif c.pose_start[pose + 1] > c.pose_start[pose]:
        for k in range(patches.half.shape[0]):
            best = deepest_in(body, patches, along, ramp, pose, k, best)
    depth[pose, patch] = best


@wp.kernel
def _weigh_patches(c: Contours, depth: wp.array2d[wp.float32], ramp: Ramp, intensity: wp.array[wp.float32]):
    """Write the intensity of all points of a pose; depth: [m], shape [pose, patch], or [pose, 1]."""
    pose = wp.tid()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        strength = strength_at(ramp, depth[pose, wp.min(c.polyline_patch[line], depth.shape[1] - 1)])
        i = c.polyline_start[line]
        while i < c.polyline_start[line + 1]:
            intensity[i] = weaken(c, i, strength)
            i += wp.int64(1)


@wp.kernel
def _count_runs(c: Contours, count: wp.array[wp.int64]):
    """Count the runs of points that a polyline is divided into."""
    line = wp.tid()
    size = c.polyline_start[line + 1] - c.polyline_start[line]
    count[line] = (size + RUN - wp.int64(1)) / RUN


@wp.kernel
def _write_runs(c: Contours, run_start: wp.array[wp.int64], run_line: wp.array[wp.int32]):
    """Write the polyline of each of its runs."""
    line = wp.tid()
    for run in range(int(run_start[line]), int(run_start[line + 1])):
        run_line[run] = line


@wp.kernel
def _weigh_points(
    # In:
    c: Contours,
    run_start: wp.array[wp.int64],
    run_line: wp.array[wp.int32],
    line_pose: wp.array[wp.int32],
    body: Body,
    ramp: Ramp,
    # Out:
    intensity: wp.array[wp.float32],
):
    """Write the intensity of a run of points, each by its own depth."""
    run = wp.tid()
    line = run_line[run]
    i = c.polyline_start[line] + (wp.int64(run) - run_start[line]) * RUN
    end = wp.min(i + RUN, c.polyline_start[line + 1])
    most = farthest_asked(ramp)
    free = float(-1.0e30)  # the surface is at least so far from the point before: there is none before the first
    within = bool(False)  # whether that is inside
    before_point = wp.vec3()
    while i < end:
        x = seen_from_body(body, line_pose[line], to_float64(c.points[i]))
        distance = distance_within(body.mesh, x, most)
        if wp.length(x - before_point) + MARGIN >= distance + free:  # the surface may lie between
            within = is_within(body.mesh, x)
        depth = float(0.0)
        if within:
            depth = distance
        intensity[i] = weaken(c, i, strength_at(ramp, depth))
        free = distance
        before_point = x
        i += wp.int64(1)


@lru_cache(maxsize=8)
def _grid_lines(grid: int, device: str) -> wp.array:
    """Where a grid's points lie along a side, -1..1."""
    return wp.array(np.linspace(-1.0, 1.0, grid), dtype=wp.float64, device=device)


def place_body(mesh: wp.Mesh, pose: wp.array | None = None, centre: np.ndarray | None = None) -> Any:
    """A closed mesh, which the caller keeps, and where it is at each pose, `Body`.

    pose: position of its centre [m] and rotation at each pose, wp.transform, shape [pose]; None: it stands still.
    centre: of the mesh as it was placed [m], shape [3].
    """
    body = Body()
    body.mesh = mesh.id
    body.pose = wp.empty(0, dtype=wp.transform, device=mesh.device) if pose is None else pose
    body.centre = wp.vec3d(*map(float, np.zeros(3) if centre is None else centre))
    return body


def make_ramp(shallow: float, deep: float, lowest: float) -> Any:
    """Intensity by depth, `Ramp`: `lowest` up to the depth `shallow` [m], from there linear to 1 at `deep` [m]."""
    ramp = Ramp()
    ramp.shallow, ramp.deep, ramp.lowest = wp.float64(shallow), wp.float64(deep), wp.float64(lowest)
    return ramp


@on_one_device
def find_deepest(contours: Contours, body: Any, patches: Any, ramp: Any, *, grid: int, whole: bool) -> wp.array:
    """Depth of the deepest of grid x grid points of each patch with contours [m], float32 [pose, patch].

    whole: of all patches of each pose with contours, float32 [pose, 1]. As far as the ramp tells depths apart: up to
    `shallow` they are too shallow by any amount, from `deep` on too deep or not deep enough to be told from `deep`.
    patches: `Patches`; grid: 2..GRID_MOST.
    """
    if not 2 <= grid <= GRID_MOST:
        raise ValueError(f"grid must lie between 2 and {GRID_MOST}, not {grid}")
    device, (pose_count, patch_count) = contours.points.device, patches.origin.shape
    drawn = wp.zeros((pose_count, patch_count), dtype=wp.uint8, device=device)
    launch(_mark_patches, pose_count, [contours], [drawn])
    depth = wp.empty((pose_count, 1 if whole else patch_count), dtype=wp.float32, device=device)
    inputs = [body, patches, _grid_lines(grid, str(device)), ramp, contours, drawn, int(whole)]
    launch(_find_deepest, depth.shape, inputs, [depth])
    return depth


@on_one_device
def weigh_by_patch(contours: Contours, depth: wp.array, ramp: Any) -> wp.array:
    """Intensity of points by the depth of their patch, or of their pose, times their own; float32 [point].

    depth: [m], float32, shape [pose, patch] or [pose, 1].
    """
    out = wp.empty(contours.points.shape[0], dtype=wp.float32, device=contours.points.device)
    launch(_weigh_patches, contours.pose_start.shape[0] - 1, [contours, depth, ramp], [out])
    return out


@on_one_device
def weigh_by_point(contours: Contours, body: Any, ramp: Any) -> wp.array:
    """Intensity of points by their own depth, times their own; float32, shape [point]."""
    device, line_count = contours.points.device, contours.polyline_closed.shape[0]
    (run_line,), (run_start,) = count_then_fill(
        _count_runs,
        _write_runs,
        line_count,
        [contours],
        lambda total: [wp.empty(total, dtype=wp.int32, device=device)],
        rows=line_count,
    )
    out = wp.empty(contours.points.shape[0], dtype=wp.float32, device=device)
    inputs = [contours, run_start, run_line, find_poses(contours), body, ramp]
    launch(_weigh_points, run_line.shape[0], inputs, [out])
    return out
