"""Visibility of contour parts from the array: sight lines from both their ends to points of the array's face.

A sight line is blocked where it passes through the inside of a patch of the hand, or through the hand's mesh. What is
nearer than CLEAR does not count, so skin does not block its own contours.
"""

import numpy as np
import warp as wp

from ..contours import Contours, find_poses, point_at
from ..offsets import launch
from ..one_device import on_one_device
from ..patch import EXACT, to_float32
from .cut import Parts, parts_of, share_end
from .prune import Patches

wp.set_module_options(EXACT)

CLEAR = wp.constant(wp.float64(1e-3))  # [m]; what is this near to the skin does not block: the skin itself


@wp.struct
class Aperture:
    """Points spread over the array's face."""

    middle: wp.vec3d  # [m]
    u: wp.vec3d  # from one point to the next, along one side [m]
    v: wp.vec3d
    count: int  # along a side


@wp.func
def face_point(aperture: Aperture, k: int):
    """Point k of the array's face [m]."""
    half = wp.float64(0.5) * wp.float64(aperture.count - 1)
    i = wp.float64(k % aperture.count) - half
    j = wp.float64(k // aperture.count) - half
    return aperture.middle + i * aperture.u + j * aperture.v


@wp.func
def is_blocked(patches: Patches, pose: int, x: wp.vec3d, ray: wp.vec3d):
    """Whether a ray from x, as long as its vector, passes through a patch, beyond CLEAR; a NaN patch blocks nothing."""
    for patch in range(patches.half.shape[0]):
        d = x - patches.origin[pose, patch]
        n = patches.n[pose, patch]
        fall = wp.dot(n, ray)
        if fall != wp.float64(0.0):
            t = -wp.dot(n, d) / fall
            if t * wp.length(ray) > CLEAR and t < wp.float64(1.0):
                y = d + t * ray
                p = wp.abs(wp.dot(patches.u[pose, patch], y))
                q = wp.abs(wp.dot(patches.v[pose, patch], y))
                if p < patches.half[patch][0] and q < patches.half[patch][1]:
                    return True
    return False


@wp.func
def part_end(points: wp.array[wp.vec3], parts: Parts, part: wp.int64, which: int):
    """Start (0) or end (1) of a part [m]."""
    share = parts.share[part]
    if which == 1:
        share = share_end(parts, part)
    return point_at(points, parts.segment[part], share)


@wp.func
def count_past_patches(x: wp.vec3d, patches: Patches, pose: int, aperture: Aperture):
    """Number of points of the array's face that x sees past the hand's patches."""
    seen = int(0)
    for p in range(aperture.count * aperture.count):
        if not is_blocked(patches, pose, x, face_point(aperture, p) - x):
            seen += 1
    return seen


@wp.func
def count_past_mesh(x: wp.vec3d, mesh: wp.uint64, back: wp.transform, aperture: Aperture):
    """Number of points of the array's face that x sees past the hand's mesh."""
    clear = wp.float32(CLEAR)
    a = wp.transform_point(back, to_float32(x))
    seen = int(0)
    for p in range(aperture.count * aperture.count):
        ray = wp.transform_point(back, to_float32(face_point(aperture, p))) - a
        reach = wp.length(ray)
        ray = ray / wp.max(reach, clear)
        hit = wp.mesh_query_ray(mesh, a + clear * ray, ray, reach - clear)
        if not hit.result:
            seen += 1
    return seen


@wp.kernel
def _see_past_patches(
    # In:
    c: Contours,
    line_pose: wp.array[wp.int32],
    parts: Parts,
    patches: Patches,
    aperture: Aperture,
    least: int,  # sight lines
    # Out:
    keep: wp.array[wp.uint8],
):
    """Keep parts from both ends of which enough of the array's face is seen past the hand's patches."""
    line = wp.tid()
    pose = line_pose[line]
    first, count = parts_of(parts, c, line)
    before = count_past_patches(part_end(c.points, parts, first, 0), patches, pose, aperture)
    for k in range(count):
        part = first + wp.int64(k)
        after = count_past_patches(part_end(c.points, parts, part, 1), patches, pose, aperture)
        keep[part] = wp.uint8(int(wp.min(before, after) >= least))
        before = after


@wp.kernel
def _see_past_mesh(
    # In:
    c: Contours,
    line_pose: wp.array[wp.int32],
    first_line: int,
    parts: Parts,
    mesh: wp.uint64,  # in the hand's frame
    pose: wp.array[wp.transform],  # hand frame -> array frame
    aperture: Aperture,
    least: int,  # sight lines
    # Out:
    keep: wp.array[wp.uint8],
):
    """Keep parts from both ends of which enough of the array's face is seen past the hand's mesh."""
    line = first_line + wp.tid()
    back = wp.transform_inverse(pose[line_pose[line]])
    first, count = parts_of(parts, c, line)
    before = count_past_mesh(part_end(c.points, parts, first, 0), mesh, back, aperture)
    for k in range(count):
        part = first + wp.int64(k)
        after = count_past_mesh(part_end(c.points, parts, part, 1), mesh, back, aperture)
        keep[part] = wp.uint8(int(wp.min(before, after) >= least))
        before = after


@on_one_device
def see_past_patches(contours: Contours, parts: Parts, patches: Patches, aperture: Aperture, least: int) -> wp.array:
    """Whether parts see at least so many points of the aperture past the hand's patches, uint8 [part]."""
    keep = wp.empty(parts.segment.shape[0], dtype=wp.uint8, device=contours.points.device)
    inputs = [contours, find_poses(contours), parts, patches, aperture, least]
    launch(_see_past_patches, contours.polyline_closed.shape[0], inputs, [keep])
    return keep


@on_one_device
def see_past_mesh(
    contours: Contours,
    parts: Parts,
    vertices: np.ndarray,
    faces: np.ndarray,
    pose: np.ndarray,
    aperture: Aperture,
    least: int,
) -> wp.array:
    """Whether parts see at least so many points of the aperture past the hand's mesh, uint8 [part].

    vertices: [m], hand frame, float32, shape [1 or pose, vertex, 3]; faces: int32, shape [face, 3]; pose: hand frame ->
    array frame, float32, shape [pose, 7]. A rigid hand's mesh is made once; another one is refitted for every pose.
    """
    device, line_count = contours.points.device, contours.polyline_closed.shape[0]
    keep = wp.empty(parts.segment.shape[0], dtype=wp.uint8, device=device)
    line_pose = find_poses(contours)
    shapes = wp.array(np.ascontiguousarray(vertices, np.float32), dtype=wp.vec3, device=device)
    corners = wp.array(np.ascontiguousarray(faces, np.int32).ravel(), dtype=wp.int32, device=device)
    mesh = wp.Mesh(points=wp.clone(shapes[0]), indices=corners)
    poses = wp.array(np.ascontiguousarray(pose, np.float32), dtype=wp.transform, device=device)
    lines = [0, line_count] if len(vertices) == 1 else contours.pose_start.numpy().tolist()
    for k in range(len(lines) - 1):
        if lines[k] == lines[k + 1]:
            continue
        if k > 0:
            wp.copy(mesh.points, shapes[k])
            mesh.refit()
        inputs = [contours, line_pose, lines[k], parts, mesh.id, poses, aperture, least]
        launch(_see_past_mesh, lines[k + 1] - lines[k], inputs, [keep])
    return keep
