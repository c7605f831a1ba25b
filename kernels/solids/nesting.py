"""Bodies of a mesh around a point: exact signed crossings, for each body, of the ray that runs up from the point.

A face above the point counts +1 if it looks up there, -1 if it looks down; the sum over a closed body is its winding
number at the point. Whether the ray passes through a face is asked edge by edge, with one answer for both its faces.
"""

import numpy as np
import warp as wp

from ..offsets import launch
from ..patch import SELDOM
from .crossing import Triangles, corner_of, corners_of, project_along, upload_triangles
from .orientation import line_side, plane_side

wp.set_module_options(SELDOM)

FAR = wp.constant(4.0)  # above every box: scaled, they lie within 1
POINTS = 2**16  # a launch
HITS = 2**20  # room of a launch at first
HITS_LARGEST = 2**24  # fewer points are tested at once where there are more


@wp.func
def edge_turn(a: wp.vec2d, b: wp.vec2d, x: wp.vec2d):
    """Whether an edge passes x on its right side: 1 going up, -1 going down, 0 not."""
    if (a[1] > x[1]) == (b[1] > x[1]):
        return 0
    if b[1] > x[1]:
        return wp.where(line_side(a, b, x) > 0, 1, 0)
    return wp.where(line_side(b, a, x) > 0, -1, 0)


@wp.kernel
def _cross_upwards(
    # In:
    triangles: Triangles,
    point: wp.array[wp.vec3d],
    box: wp.array[wp.vec3],  # the points scaled as the boxes are
    first: int,  # point of the first thread
    # Out:
    hit: wp.array[wp.vec3i],  # point, face, 1 if it looks up or -1; in any order
    count: wp.array[wp.int32],  # their number, also beyond the room; zero-initialised, shape [1]
):
    """Find the faces straight above each point. Stop where room is short: the count of all may overflow."""
    own = first + wp.tid()
    x = point[own]
    foot = project_along(x, 2)
    query = wp.bvh_query_aabb(triangles.tree, box[own], wp.vec3(box[own][0], box[own][1], FAR))
    face = int(0)
    while wp.bvh_query_next(query, face):
        t = corners_of(triangles, triangles.face[face])
        turn = int(0)
        for k in range(3):
            turn += edge_turn(project_along(corner_of(t, k), 2), project_along(corner_of(t, k + 1), 2), foot)
        if turn != 0 and plane_side(t.a, t.b, t.c, x) == turn:
            place = wp.atomic_add(count, 0, 1)
            if place >= hit.shape[0]:
                return
            hit[place] = wp.vec3i(own, face, turn)


def wind_bodies(
    vertices: np.ndarray, faces: np.ndarray, body: np.ndarray, points: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Winding numbers of closed bodies around points: the point, the body and the number, where that is not 0.

    vertices: float64, shape [vertex, 3]; faces: int, shape [face, 3]; body: number of each face's, shape [face].
    points: float64, shape [point, 3], on no face. Sorted by point, then body.
    """
    triangles, tree = upload_triangles(vertices, faces, device)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    scaled = np.clip((points - 0.5 * (low + high)) / (np.max(high - low) or 1.0), -2.0, 2.0).astype(np.float32)
    point, box = wp.array(points, dtype=wp.vec3d, device=device), wp.array(scaled, dtype=wp.vec3, device=device)
    bodies, most = int(body.max()) + 1, max(HITS_LARGEST, len(faces))
    pairs, numbers = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    first, step, room = 0, POINTS, HITS
    while first < len(points):
        count = min(step, len(points) - first)
        hit = wp.empty(room, dtype=wp.vec3i, device=device)
        found = wp.zeros(1, dtype=wp.int32, device=device)
        launch(_cross_upwards, count, [triangles, point, box, first], [hit, found])
        hit_count = int(found.numpy()[0])
        if hit_count > room:
            step, room = (count // 2, room) if room >= most else (count, min(4 * room, most))
            continue
        first += count
        hits = hit.numpy()[:hit_count].astype(np.int64)
        pair, index = np.unique(hits[:, 0] * bodies + body[hits[:, 1]], return_inverse=True)
        pairs.append(pair)
        numbers.append(np.bincount(index, hits[:, 2], minlength=len(pair)).astype(np.int64))
    del tree  # the kernels' hierarchy, until here
    pair, number = np.concatenate(pairs), np.concatenate(numbers)
    pair, number = pair[number != 0], number[number != 0]
    return pair // bodies, pair % bodies, number
