"""Skins and solids to cross, and the curves between them worked out face by face."""

from functools import lru_cache

import numpy as np
import warp as wp
from depth_oracle import windings
from mesh_cases import MESHES
from section_oracle import rotation, walk

from palpate.kernels.fields.mesh_inside import mesh_field
from palpate.kernels.section.half_edges import HalfEdges, upload_surface
from palpate.kernels.skin.curves import skin_contours
from palpate.render.contour_batch import ContourBatch


@lru_cache
def solid_on(name, device):
    """A closed mesh by name: its field on a device, and its bounds."""
    vertices, faces = MESHES[name]()
    bounds = np.stack([vertices.min(axis=0), vertices.max(axis=0)]).astype(np.float64)
    return mesh_field(upload_surface(HalfEdges(vertices, faces), device), bounds), bounds


def drawn(hand, name, poses, device, *, closes, limit=None, step=None, first=0):
    """Contours of a solid by name on a MeshHand, on the host."""
    field, bounds = solid_on(name, device)
    pose = wp.array(np.asarray(poses, np.float32)[:, None], dtype=wp.transform, device=device)
    vertex = hand.vertices_on(device, first, first + len(poses))
    skin = hand.skin_on(device, step)
    return ContourBatch.of_sections(
        skin_contours(field, pose, skin, vertex, closes=closes, bounds=bounds, limit=limit), 1
    ).numpy()


def grid_skin(count=7, size=0.085, bump=0.01):
    """A square of skin facing -Y, `count` vertices a side, arched, its diagonals this way and that."""
    axis = np.linspace(-size / 2, size / 2, count)
    x, z = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
    vertices = np.stack([x, bump * np.cos(3 * x / size) * np.cos(2 * z / size) - bump, z], axis=1)
    k = np.arange(count * count).reshape(count, count)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    even = (np.arange(len(a)) % 2 == 0)[:, None]
    one = np.where(even, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1))
    two = np.where(even, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1))
    return vertices.astype(np.float32), np.concatenate([one, two])


def crossing_between(vertices, faces, one, two):
    """Where the way between two points leaves a simple solid, from the end that is inside; every face is asked."""
    inner, outer = (one, two) if windings(vertices, faces, [one])[0] > 0.5 else (two, one)
    d = outer - inner
    a, b, c = (vertices[faces[:, k]].astype(np.float64) - inner for k in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.einsum("ij,ij->i", normal, a) / (normal @ d)
    sides = np.stack([np.cross(c, b) @ d, np.cross(a, c) @ d, np.cross(b, a) @ d])
    met = ((sides >= -1e-18).all(axis=0) | (sides <= 1e-18).all(axis=0)) & (share >= 0) & (share <= 1)
    return inner + share[met].min() * d


def oracle_lines(place, faces, solid, *, closes):
    """Curves on a skin: [(points, kinds of segments, closed)], the inside to the left seen from inside the hand.

    place: vertices in the array's frame, shape [vertex, 3]; faces: the region's; solid: (vertices, faces), closed.
    """
    inside = windings(*solid, place) > 0.5
    after, kind, start = {}, {}, {}

    def add(node, following, its_kind):
        assert node not in after
        after[node], kind[node] = following, its_kind

    directed = {
        (a, b): k for k, face in enumerate(faces.tolist()) for a, b in zip(face, face[1:] + face[:1], strict=True)
    }
    for face in faces.tolist():
        for a, b in sides_of(face):
            if not inside[a] and inside[b]:  # into the face here, out of it where inside goes to outside
                start[face[0], face[1], face[2]] = frozenset((a, b))
        for a, b in sides_of(face):
            if inside[a] and not inside[b]:
                add(start[face[0], face[1], face[2]], frozenset((a, b)), 0)
    for (a, b), k in directed.items():
        if (b, a) in directed or not closes:
            continue
        one, two = fan_at(a, k, faces, directed), fan_at(b, k, faces, directed)
        if inside[b]:  # back along the rim
            add(two, one if inside[a] else frozenset((a, b)), 1)
        elif inside[a]:
            add(frozenset((a, b)), one, 1)

    def where(node):
        if isinstance(node, frozenset):
            one, two = sorted(node)
            return crossing_between(*solid, place[one], place[two])
        return place[node[0]]

    number = {node: k for k, node in enumerate({*after, *after.values()})}
    node_of = {k: node for node, k in number.items()}
    lines = []
    for chain, closed in walk({number[a]: number[b] for a, b in after.items()}):
        nodes = [node_of[k] for k in chain]
        points = np.array([where(node) for node in [*nodes, *nodes[: int(closed)]]])
        lines.append((points, np.array([kind[node] for node in (nodes if closed else nodes[:-1])]), closed))
    return lines


def sides_of(face):
    """A face's edges, from where to where."""
    return list(zip(face, face[1:] + face[:1], strict=True))


def fan_at(vertex, face, faces, directed):
    """A vertex and one face of its own: rims that touch at a vertex pass it apart, each along its own fan of faces."""
    fan, found = set(), {face}
    while found:
        fan |= found
        edges = [
            (a, b) for k in found for a, b in zip(faces[k], np.roll(faces[k], -1), strict=True) if vertex in (a, b)
        ]
        found = {directed[b, a] for a, b in edges if (b, a) in directed} - fan
    return vertex, min(fan)


def summary_of(lines):
    """Numbers that tell curves apart, wherever they start: shape [line, 8], in order."""
    rows = []
    for points, kinds, closed in lines:
        step = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if step.sum() < 1e-6:
            continue
        d = points - points[:-1].mean(axis=0) if closed else points
        area = 0.5 * np.cross(d[:-1], d[1:]).sum(axis=0)  # of the loop, with its orientation
        middle = (0.5 * (points[1:] + points[:-1]) * step[:, None]).sum(axis=0) / step.sum()
        rows.append([float(closed), *np.round(middle, 4), step[kinds == 0].sum(), step.sum(), *area])
    return np.array(sorted(rows)).reshape(-1, 9)


def lines_of(batch, pose):
    """Polylines of a pose of a batch as the oracle gives them."""
    out = []
    for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
        first, stop = batch.polyline_start[line : line + 2]
        points = batch.points[first:stop].astype(np.float64)
        out.append((points, batch.kind[first : stop - 1], bool(batch.polyline_closed[line])))
    return out


def placed_by(vertices, pose):
    """Vertices of a hand in the array's frame, float64."""
    return np.asarray(vertices, np.float64) @ rotation(pose[3:]).T + np.asarray(pose[:3], np.float64)
