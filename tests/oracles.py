"""Slow and obvious answers in float64, one for each stage of the geometry."""

from dataclasses import dataclass

import numpy as np
import shapely
import trimesh

SHIFT = 1e-6  # [m]; how near to a degenerate pose float32 may decide otherwise (design, section 5)
COUNTED = 4 * SHIFT  # [m]; shorter polylines are rounding's, on either side


def rotation(quaternion):
    """Rotation matrix of a quaternion xyzw of any norm."""
    x, y, z, w = np.asarray(quaternion, np.float64) / np.linalg.norm(np.asarray(quaternion, np.float64))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def in_palm(vertices, pose):
    """Coordinates along the palm's u, v, n, shape [vertex, 3]."""
    axes = rotation(pose[3:])
    basis = np.stack([axes[:, 0], -axes[:, 2], axes[:, 1]])
    return (np.asarray(vertices, np.float64) - np.asarray(pose[:3], np.float64)) @ basis.T


def section_links(vertices, faces, pose, shift=0.0):
    """Crossing of each cut mesh edge and the edge that follows it: ({edge: point}, {edge: next edge}).

    An edge is (lower, upper) vertex; the solid lies to the left seen from +n; on the plane counts as above.
    """
    local = in_palm(vertices, pose)
    height = local[:, 2] - shift
    point, after = {}, {}
    above = (height >= 0)[np.asarray(faces)]
    for face in np.asarray(faces)[above.any(axis=1) & ~above.all(axis=1)].tolist():
        for a, b in zip(face, face[1:] + face[:1], strict=True):
            edge = (min(a, b), max(a, b))
            if (height[a] >= 0) != (height[b] >= 0):
                t = height[edge[0]] / (height[edge[0]] - height[edge[1]])
                point[edge] = local[edge[0], :2] + t * (local[edge[1], :2] - local[edge[0], :2])
        down = [(a, b) for a, b in zip(face, face[1:] + face[:1], strict=True) if height[a] >= 0 > height[b]]
        up = [(a, b) for a, b in zip(face, face[1:] + face[:1], strict=True) if height[a] < 0 <= height[b]]
        after[(min(down[0]), max(down[0]))] = (min(up[0]), max(up[0]))
    return point, after


def section_steps(edges, height):
    """The same over half-edges, whatever meets at an edge: {half-edge, the lower of its pair: the one that follows}.

    edges: with `faces` and `twin` (negative for none); height of each vertex over the plane, 0 counts as above.
    """
    after = {}
    above = (height >= 0)[edges.faces]
    for face in np.flatnonzero(above.any(axis=1) & ~above.all(axis=1)):
        halves = 3 * face + np.arange(3)
        names = np.where(edges.twin[halves] < 0, halves, np.minimum(halves, edges.twin[halves]))
        up = above[face]
        after[int(names[up & ~np.roll(up, -1)][0])] = int(names[~up & np.roll(up, -1)][0])
    return after


def soup_length(vertices, faces, pose, half):
    """Length [m] of what of a mesh's section lies inside a palm, triangle by triangle: for generic poses only."""
    local = in_palm(vertices, pose)
    segments = []
    above = (local[:, 2] >= 0)[np.asarray(faces)]
    for corners in local[np.asarray(faces)[above.any(axis=1) & ~above.all(axis=1)]]:
        sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        cut = [(a, b) for a, b in sides if (a[2] >= 0) != (b[2] >= 0)]
        segments.append([a[:2] + a[2] / (a[2] - b[2]) * (b[:2] - a[:2]) for a, b in cut])
    if not segments:
        return 0.0
    box = shapely.box(-half[0], -half[1], half[0], half[1])
    return float(shapely.length(shapely.intersection(shapely.linestrings(segments), box)).sum())


def walk(after):
    """Chains of a successor map: list of (nodes, closed), each loop from its smallest node."""
    left, chains = dict(after), []
    for first in sorted(set(after) - set(after.values())):
        chain = [first]
        while chain[-1] in left:
            chain.append(left.pop(chain[-1]))
        chains.append((chain, False))
    while left:
        first = min(left)
        chain = [first]
        while left[chain[-1]] != first:
            chain.append(left.pop(chain[-1]))
        left.pop(chain[-1])
        chains.append((chain, True))
    return chains


@dataclass(frozen=True)
class Cut:
    """What a pose should give: lengths [m] and numbers of polylines."""

    oc_length: float
    cc_length: float
    oc_lines: int
    oc_loops: int
    cc_loops: int


def cut_loops(loops, half):
    """OC and CC of closed planar loops (even-odd) and the rectangle |u| <= half[0], |v| <= half[1], by shapely."""
    region = shapely.Polygon()
    for loop in loops:
        if len(loop) > 2:
            region = region.symmetric_difference(shapely.make_valid(shapely.Polygon(loop)))
    box = shapely.box(-half[0], -half[1], half[0], half[1])
    outline = shapely.MultiLineString([np.vstack([q, q[:1]]) for q in loops if len(q) > 2])
    inside = shapely.difference(shapely.intersection(outline, box), box.boundary)
    lines = [g for g in shapely.get_parts(shapely.line_merge(inside)) if g.geom_type == "LineString" and g.length > 0]
    solid = [g for g in shapely.get_parts(region.intersection(box)) if g.geom_type == "Polygon" and g.area > 0]
    rings = [ring for g in solid for ring in (g.exterior, *g.interiors)]
    return Cut(
        oc_length=float(sum(g.length for g in lines)),
        cc_length=float(sum(ring.length for ring in rings)),
        oc_lines=sum(g.length > COUNTED for g in lines),
        oc_loops=sum(g.is_closed and g.length > COUNTED for g in lines),
        cc_loops=sum(ring.length > COUNTED for ring in rings),
    )


def cut_mesh(vertices, faces, pose, half, *, plane_shift=0.0, side_shift=0.0):
    """OC and CC of a closed mesh: own float64 section, shapely's rectangle."""
    point, after = section_links(vertices, faces, pose, plane_shift)
    loops = [np.array([point[edge] for edge in chain]) for chain, _ in walk(after)]
    return cut_loops(loops, np.asarray(half) + side_shift)


def cut_mesh_trimesh(mesh, pose, half):
    """The same by trimesh's section: for poses in general position only (it has tolerances of its own)."""
    axes = rotation(pose[3:])
    segments = trimesh.intersections.mesh_plane(mesh, axes[:, 1], np.asarray(pose[:3], np.float64))
    flat = (np.asarray(segments) - np.asarray(pose[:3], np.float64)) @ np.stack([axes[:, 0], -axes[:, 2]]).T
    area = shapely.build_area(shapely.MultiLineString(list(np.round(flat, 10))))
    rings = [r for g in shapely.get_parts(area) if g.geom_type == "Polygon" for r in (g.exterior, *g.interiors)]
    return cut_loops([np.asarray(ring.coords)[:-1] for ring in rings], half)


def is_degenerate(vertices, faces, pose, half, near=SHIFT):
    """Whether a vertex lies within `near` of the plane, or a contour vertex within it of a line of the palm's sides."""
    local = in_palm(vertices, pose)
    if np.abs(local[:, 2]).min() <= near:
        return True
    point, _ = section_links(vertices, faces, pose)
    flat = np.array(list(point.values())).reshape(-1, 2)
    return bool(len(flat) and (np.abs(np.abs(flat) - np.asarray(half)).min() <= near))
