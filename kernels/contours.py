"""Contours of many poses as kernels take and give them: one struct, whose columns are those of a ContourBatch.

What moves points or polylines from contours to contours is here, once for all columns: a column that is added is added
to `Contours`, to POINT_COLUMNS or LINE_COLUMNS, and to `copy_point` (and `write_point`) or `write_polyline`.
"""

import ctypes

import warp as wp

from .offsets import launch, scan_counts
from .one_device import on_one_device
from .patch import EXACT, to_float32, to_float64

wp.set_module_options(EXACT)


@wp.struct
class Contours:
    """Polylines of many poses, ragged; a column that a batch does not have is None, and of length 0 in kernels."""

    points: wp.array[wp.vec3]  # vertices of polylines [m], array frame, shape [point]
    kind: wp.array[wp.uint8]  # of the segment that starts here: 0 object, 1 hand, 2 made; a last point repeats it
    intensity: wp.array[wp.float32]  # 0..1 at each point, linear in between; without: 1 everywhere
    dwell: wp.array[wp.float32]  # pause of the focal point at each point [s]; without: none
    polyline_start: wp.array[wp.int64]  # offsets into points, shape [polyline + 1]
    polyline_patch: wp.array[wp.int32]  # of the hand, shape [polyline]
    polyline_closed: wp.array[wp.uint8]  # 1: closed, and its last point repeats its first
    pose_start: wp.array[wp.int64]  # offsets into polylines, shape [pose + 1]


POINT_COLUMNS = {"points": wp.vec3, "kind": wp.uint8, "intensity": wp.float32, "dwell": wp.float32}
LINE_COLUMNS = {"polyline_patch": wp.int32, "polyline_closed": wp.uint8}


@wp.func
def segment_length(points: wp.array[wp.vec3], i: wp.int64):
    """Length of the segment that starts at point i [m]."""
    return wp.length(to_float64(points[i + wp.int64(1)]) - to_float64(points[i]))


@wp.func
def point_at(points: wp.array[wp.vec3], i: wp.int64, share: wp.float64):
    """Point of the segment that starts at point i [m]; a share of 0 gives that point bit-identically."""
    x = to_float64(points[i])
    if share > wp.float64(0.0):
        x = x + share * (to_float64(points[i + wp.int64(1)]) - x)
    return x


@wp.func
def copy_point(old: Contours, i: wp.int64, out: Contours, at: wp.int64):
    """Write a point with what it has."""
    out.points[at] = old.points[i]
    out.kind[at] = old.kind[i]
    if out.intensity.shape[0] > 0:
        out.intensity[at] = old.intensity[i]
    if out.dwell.shape[0] > 0:
        out.dwell[at] = old.dwell[i]


@wp.func
def write_point(old: Contours, i: wp.int64, share: wp.float64, out: Contours, at: wp.int64):
    """Write what lies at a share of the segment that starts at point i: linear, without a pause; at 0, the point."""
    copy_point(old, i, out, at)
    if share > wp.float64(0.0):
        out.points[at] = to_float32(point_at(old.points, i, share))
        if out.intensity.shape[0] > 0:
            step = old.intensity[i + wp.int64(1)] - old.intensity[i]
            out.intensity[at] = wp.float32(wp.float64(old.intensity[i]) + share * wp.float64(step))
        if out.dwell.shape[0] > 0:
            out.dwell[at] = wp.float32(0.0)


@wp.func
def write_polyline(old: Contours, line: wp.int64, out: Contours, at: wp.int64):
    """Write what a polyline has beside its points."""
    out.polyline_patch[at] = old.polyline_patch[line]
    out.polyline_closed[at] = old.polyline_closed[line]


@wp.kernel
def _keep_points(old: Contours, place: wp.array[wp.int64], out: Contours):
    """Move the points that stay to their places."""
    i = wp.tid()
    if place[i + 1] > place[i]:
        copy_point(old, wp.int64(i), out, place[i])


@wp.kernel
def _keep_polylines(old: Contours, line_place: wp.array[wp.int64], place: wp.array[wp.int64], out: Contours):
    """Move the polylines that stay to their places."""
    line = wp.tid()
    at = line_place[line]
    if line_place[line + 1] > at:
        write_polyline(old, wp.int64(line), out, at)
        out.polyline_start[at] = place[old.polyline_start[line]]


@wp.kernel
def _list_selected(keep: wp.array[wp.int64], place: wp.array[wp.int64], index: wp.array[wp.int64]):
    """Numbers of the rows that stay."""
    i = wp.tid()
    if keep[i] != wp.int64(0):
        index[place[i]] = wp.int64(i)


@wp.kernel
def _move_offsets(start: wp.array[wp.int64], place: wp.array[wp.int64], moved: wp.array[wp.int64]):
    """Offsets among rows that have gone to their places."""
    i = wp.tid()
    moved[i] = place[start[i]]


@wp.kernel
def _find_poses(pose_start: wp.array[wp.int64], line_pose: wp.array[wp.int32]):
    """Write the pose of each polyline."""
    pose = wp.tid()
    for line in range(int(pose_start[pose]), int(pose_start[pose + 1])):
        line_pose[line] = pose


def room_for(points: int, lines: int, device: wp.Device, *, kind: int = 0, end: int | None = None) -> Contours:
    """Memory for so many points, all of one kind, and so many polylines, which all start at the end."""
    out = Contours()
    out.points = wp.empty(points, dtype=wp.vec3, device=device)
    out.kind = wp.full(points, kind, dtype=wp.uint8, device=device)
    out.polyline_start = wp.full(lines + 1, points if end is None else end, dtype=wp.int64, device=device)
    out.polyline_patch = wp.empty(lines, dtype=wp.int32, device=device)
    out.polyline_closed = wp.empty(lines, dtype=wp.uint8, device=device)
    return out


def with_columns(contours: Contours, **columns: wp.array | None) -> Contours:
    """The same contours with other columns in the place of some."""
    out = Contours()
    ctypes.pointer(out._ctype)[0] = contours._ctype  # a third of the time of `assign`
    vars(out).update({name: value for name, value in vars(contours).items() if name != "_ctype"})
    for name, column in columns.items():
        setattr(out, name, column)
    return out


def with_room(contours: Contours, points: int, lines: int | None = None) -> Contours:
    """Memory for so many points with the columns that contours have, and for so many polylines; None: those it has."""
    device, out = contours.points.device, Contours()
    for name, dtype in POINT_COLUMNS.items():
        if getattr(contours, name) is not None:
            setattr(out, name, wp.empty(points, dtype=dtype, device=device))
    for name, dtype in LINE_COLUMNS.items():
        setattr(out, name, getattr(contours, name) if lines is None else wp.empty(lines, dtype=dtype, device=device))
    if lines is None:
        out.polyline_start = contours.polyline_start
    else:
        out.polyline_start = wp.full(lines + 1, points, dtype=wp.int64, device=device)
    out.pose_start = contours.pose_start
    return out


@on_one_device
def keep_rows(contours: Contours, point_keep: wp.array, polyline_keep: wp.array | None = None) -> Contours:
    """Contours of the points and polylines whose `keep` is 1, as `number_selected` takes it; None: of all polylines."""
    (place, *line_place), totals = scan_counts(point_keep, *(() if polyline_keep is None else (polyline_keep,)))
    out = with_room(contours, *totals)
    launch(_keep_points, contours.points.shape[0], [contours, place], [out])
    if polyline_keep is None:
        out.polyline_start = move_offsets(contours.polyline_start, place)
    else:
        launch(_keep_polylines, contours.polyline_closed.shape[0], [contours, *line_place, place], [out])
        out.pose_start = move_offsets(contours.pose_start, *line_place)
    return out


def number_selected(keep: wp.array) -> tuple[wp.array, wp.array]:
    """Numbers of the rows whose `keep` is 1, int64, and how many of them come before each row, int64 [row + 1].

    keep: 1 or 0, int64, shape [row + 1]; the last must be 0.
    """
    (place,), (total,) = scan_counts(keep)
    index = wp.empty(total, dtype=wp.int64, device=keep.device)
    launch(_list_selected, place.shape[0] - 1, [keep, place], [index])
    return index, place


@on_one_device
def move_offsets(start: wp.array, place: wp.array) -> wp.array:
    """Offsets into rows after each row has gone to its `place`, int64 [row + 1]."""
    moved = wp.empty_like(start)
    launch(_move_offsets, moved.shape[0], [start, place], [moved])
    return moved


def find_poses(contours: Contours) -> wp.array:
    """Pose of each polyline, int32, shape [polyline]."""
    line_pose = wp.empty(contours.polyline_patch.shape[0], dtype=wp.int32, device=contours.points.device)
    launch(_find_poses, contours.pose_start.shape[0] - 1, [contours.pose_start], [line_pose])
    return line_pose


def full_intensity(contours: Contours) -> wp.array:
    """Intensity at each point, float32, a copy: 1 where contours have none."""
    if contours.intensity is not None:
        return wp.clone(contours.intensity)
    return wp.full(contours.points.shape[0], 1.0, dtype=wp.float32, device=contours.points.device)


@wp.kernel
def _measure_contours(c: Contours, length: wp.array2d[wp.float32]):
    """Sum the segments of each pose, in float64; length: [m], shape [pose, kind]."""
    pose = wp.tid()
    total = wp.vec3d()
    for line in range(int(c.pose_start[pose]), int(c.pose_start[pose + 1])):
        base = c.polyline_start[line]
        for k in range(int(c.polyline_start[line + 1] - base) - 1):
            i = base + wp.int64(k)
            d = c.points[i + wp.int64(1)] - c.points[i]
            e = wp.vec3d(wp.float64(d[0]), wp.float64(d[1]), wp.float64(d[2]))
            total[int(c.kind[i])] = total[int(c.kind[i])] + wp.length(e)
    for k in range(3):
        length[pose, k] = wp.float32(total[k])


def measure_contours(contours: Contours) -> wp.array:
    """Length of each pose's segments by kind [m], float32, shape [pose, 3]."""
    pose_count = contours.pose_start.shape[0] - 1
    length = wp.zeros((pose_count, 3), dtype=wp.float32, device=contours.points.device)
    launch(_measure_contours, pose_count, [contours], [length])
    return length
