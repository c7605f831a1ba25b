"""Slow and obvious answers in float64, one for each stage of the geometry."""

from dataclasses import dataclass
from itertools import pairwise

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


def default_flush(vertices, pose):
    """What a strategy without `flush` takes [m]: three float32 spacings of the largest coordinate, at most 1 mm."""
    return min(3 * 2.0**-23 * max(np.abs(vertices).max(), np.abs(pose[:3]).max()), 1e-3)


def section_links(vertices, faces, pose, shift=0.0, flush=0.0, lift=0.0):
    """Crossing of each cut mesh edge and the edge that follows it: ({edge: point}, {edge: next edge}).

    An edge is (lower, upper) vertex; the solid lies to the left seen from +n; on the plane counts as above, and what
    is below it by `flush` [m] at most counts as on it, at the height `lift` [m].
    """
    local = in_palm(vertices, pose)
    height = local[:, 2] - shift
    height = np.where((height < 0) & (height >= -flush), lift, height)
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
    half = np.asarray(half)
    region = shapely.Polygon()
    for loop in loops:
        if len(loop) > 2:
            region = region.symmetric_difference(shapely.make_valid(shapely.Polygon(loop)))
    box = shapely.box(-half[0], -half[1], half[0], half[1])
    outline = shapely.MultiLineString([np.vstack([q, q[:1]]) for q in loops if len(q) > 2])
    inside = shapely.difference(shapely.intersection(outline, box), box.boundary)
    merged = [g for g in shapely.get_parts(shapely.line_merge(inside)) if g.geom_type == "LineString" and g.length > 0]
    lines = [part for line in merged for part in parted_at_sides(line, half)]
    solid = [g for g in shapely.get_parts(region.intersection(box)) if g.geom_type == "Polygon" and g.area > 0]
    rings = [ring for g in solid for ring in (g.exterior, *g.interiors)]
    return Cut(
        oc_length=float(sum(g.length for g in lines)),
        cc_length=float(sum(ring.length for ring in rings)),
        oc_lines=sum(g.length > COUNTED for g in lines),
        oc_loops=sum(g.is_closed and g.length > COUNTED for g in lines),
        cc_loops=sum(ring.length > COUNTED for ring in rings),
    )


def parted_at_sides(line, half):
    """Parts of a line between its points on a rectangle's sides, which count as outside where it only touches them."""
    x = np.asarray(line.coords)
    on = (np.abs(x) >= half).any(axis=1)
    if line.is_closed and on[:-1].any():
        turn = int(np.flatnonzero(on[:-1])[0])
        x = np.concatenate([x[turn:-1], x[: turn + 1]])
        on = (np.abs(x) >= half).any(axis=1)
    ends = [0, *(np.flatnonzero(on[1:-1]) + 1).tolist(), len(x) - 1]
    return [shapely.LineString(x[a : b + 1]) for a, b in pairwise(ends)]


def cut_mesh(vertices, faces, pose, half, *, plane_shift=0.0, side_shift=0.0, flush=0.0, lift=0.0):
    """OC and CC of a closed mesh: own float64 section, shapely's rectangle.

    flush: a vertex below the plane, or a contour vertex inside a side, by this at most is on it [m]; lift: above the
    plane by this, for slivers to have an area [m].
    """
    point, after = section_links(vertices, faces, pose, plane_shift, flush, lift)
    side = np.asarray(half) + side_shift
    loops = [brought_to_sides(np.array([point[edge] for edge in chain]), side, flush) for chain, _ in walk(after)]
    return cut_loops(loops, side)


def brought_to_sides(loop, half, flush):
    """Points of which those inside the lines of a rectangle's sides by `flush` at most lie on them."""
    near = (np.abs(loop) < half) & (np.abs(loop) >= half - flush)
    return np.where(near, np.copysign(half, loop), loop)


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
