"""Bodies that cross or touch replaced by their union, where manifold3d can and what it gives stands a check.

Surfaces within rounding of each other are counted as contacts: bodies that rest on each other are cut as one. Boxes of
different size that touch share no vertices. Turned, their faces no longer lie in one plane: rounding leaves gaps here
and overlaps there, and what uniting leaves of them would be drawn as inner walls.
"""

from typing import NamedTuple

import numpy as np

from ....kernels.section.half_edges import OPEN, twins_of
from ....kernels.solids.crossing import find_crossings
from ....kernels.solids.nesting import wind_bodies
from ...errors import MeshError
from ...runtime.loading_progress import Watch
from .bodies import areas_of, body_labels, largest_faces, normals_of, points_behind, rows_of
from .sheets import components
from .welding import sorted_faces, weld

CROSSINGS_MOST = 2**22  # pairs of triangles that are counted; beyond, the mesh is taken for nothing but crossings
CHECKS = 512  # random points and triangles at which a union is compared with its bodies
CLEARANCE = 16.0  # of a mesh's rounding: how far from triangles it is compared
CUBE_WAYS = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0  # to a cube's neighbours


class Crossings(NamedTuple):
    """Pairs of triangles that cross or overlap."""

    pair_count: int
    of_body: np.ndarray
    """How many of them are of one body, shape [body]."""
    touching: np.ndarray
    """Pairs of bodies that have some, the lower first, sorted, int64, shape [pair, 2]."""
    between: np.ndarray
    """How many they have, shape [pair]."""
    all_counted: bool
    """Whether they are fewer than CROSSINGS_MOST; if not, the search was ended."""


def count_crossings(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray, watch: Watch) -> Crossings:
    """Find the crossings of all triangles and count them by body; `label` is the body of each."""
    body_count = int(label.max(initial=-1)) + 1
    of_body = np.zeros(body_count, np.int64)
    keys, counts, total = np.zeros(0, np.int64), np.zeros(0, np.int64), 0
    for done, pairs in find_crossings(vertices, faces):
        watch("crossings", done, len(faces))
        body = np.sort(label[pairs], axis=1)
        own = body[:, 0] == body[:, 1]
        of_body += np.bincount(body[own, 0], minlength=body_count)
        key, count = np.unique(body[~own] @ np.array([body_count, 1]), return_counts=True)
        keys, index = np.unique(np.concatenate([keys, key]), return_inverse=True)
        counts = np.bincount(index, np.concatenate([counts, count]), minlength=len(keys)).astype(np.int64)
        total += len(pairs)
        if total >= CROSSINGS_MOST and done < len(faces):
            break
    touching = np.stack([keys // max(body_count, 1), keys % max(body_count, 1)], axis=1)
    return Crossings(total, of_body, touching, counts, total < CROSSINGS_MOST)


class Cluster(NamedTuple):
    """Bodies that touch each other, directly or through others of them."""

    bodies: np.ndarray
    crossing_count: int
    fault: str = ""
    """Why they cannot be united; empty if they may be."""


def clusters_of(crossings: Crossings) -> list[Cluster]:
    """Every body that crosses anything, with those that it touches."""
    body_count = len(crossings.of_body)
    if not crossings.all_counted:
        return [
            Cluster(
                np.arange(body_count), crossings.pair_count, f"more than {CROSSINGS_MOST} pairs: not all were counted"
            )
        ]
    one, two = crossings.touching.T
    label = components(one, two, body_count)
    count = np.bincount(label, crossings.of_body, minlength=body_count)
    own = count > 0
    count += np.bincount(label[one], crossings.between, minlength=body_count)
    rows = rows_of(label)
    fault = {False: "", True: "a body crosses itself"}
    return [Cluster(rows[k], int(count[k]), fault[bool(own[k])]) for k in np.flatnonzero(count > 0)]


def unite(
    vertices: np.ndarray, parts: list[np.ndarray], sign: np.ndarray, around: list[set[int]]
) -> tuple[np.ndarray, np.ndarray]:
    """Union of bodies, each solid less the cavities in it, by manifold3d; of cavities alone, their union as a cavity.

    parts: faces of each body, facing as `sign` says; around: for each body those, among them, that it lies in.
    Returns vertices and faces. Raises MeshError if a body is not a manifold, or manifold3d fails.
    """
    import manifold3d  # 20 MB of geometry that most meshes never need

    def solid(part: np.ndarray):
        used, index = np.unique(part, return_inverse=True)
        mesh = manifold3d.Mesh64(vertices[used], index.reshape(-1, 3).astype(np.uint64))
        out = manifold3d.Manifold(mesh)
        if out.status() != manifold3d.Error.NoError:
            raise MeshError(f"a body of {len(part)} triangles is not a manifold ({out.status().name})")
        return out

    only_cavities = bool((sign < 0).all())
    sign = -sign if only_cavities else sign
    turned = [part[:, ::-1] if (s < 0) != only_cavities else part for part, s in zip(parts, sign, strict=True)]
    bodies = [solid(part) for part in turned]
    solids = {k: body for k, body in enumerate(bodies) if sign[k] > 0}
    for k in np.flatnonzero(sign < 0):
        holder = max((j for j in around[k] if sign[j] > 0), key=lambda j: len(around[j]), default=None)
        if holder is None:
            raise MeshError("a cavity lies in none of the bodies that it touches")
        solids[holder] = solids[holder] - bodies[k]
    united = manifold3d.Manifold.batch_boolean(list(solids.values()), manifold3d.OpType.Add)
    if united.status() != manifold3d.Error.NoError:
        raise MeshError(f"the union failed ({united.status().name})")
    mesh = united.to_mesh64()
    points, faces = weld(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int64))
    return points, sorted_faces(faces[:, ::-1] if only_cavities else faces)


def check_union(
    vertices: np.ndarray,
    parts: list[np.ndarray],
    around_sign: int,
    united: tuple[np.ndarray, np.ndarray],
    tolerance: float,
) -> None:
    """Raise MeshError unless a union is closed and holds what its bodies hold, at random points and by their triangles.

    around_sign: winding number that the surroundings add: 1 in a solid.
    """
    points, faces = united
    open_count = int((twins_of(faces, points, tolerance) == OPEN).sum())
    if open_count:
        raise MeshError(f"the union has {open_count} open edges")
    given = np.concatenate(parts)
    asked = check_points(vertices, given, np.repeat(np.arange(len(parts)), [len(p) for p in parts]))
    before = around_sign + winding_of(vertices, given, asked) > 0
    after = around_sign + winding_of(points, faces, asked) > 0
    suspect = np.flatnonzero(before != after)
    reach = CLEARANCE * tolerance * CUBE_WAYS
    beside = (asked[suspect, None] + reach).reshape(-1, 3)
    alike = (around_sign + winding_of(vertices, given, beside) > 0).reshape(-1, len(reach)) == before[suspect, None]
    wrong = np.count_nonzero(alike.all(axis=1))  # others lie on the surface, as far as rounding can tell
    if wrong:
        raise MeshError(
            f"{wrong} of {len(asked)} points lie inside the union and not inside its bodies, or the reverse"
        )


def winding_of(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Winding number of closed surfaces around points, int64, shape [point]."""
    out = np.zeros(len(points), np.int64)
    if len(faces):
        row, _, number = wind_bodies(vertices, faces, np.zeros(len(faces), np.int64), points)
        out[row] = number
    return out


def check_points(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Random points of the bodies' box, and points on both sides of triangles: every body's largest among them."""
    rng = np.random.default_rng(14)
    used = vertices[np.unique(faces)]
    box = rng.uniform(used.min(axis=0), used.max(axis=0), (CHECKS, 3))
    rows = np.union1d(
        largest_faces(areas_of(vertices, faces), label), rng.choice(len(faces), min(CHECKS, len(faces)), replace=False)
    )
    distance = 1e-3 * np.sqrt(areas_of(vertices, faces[rows]))[:, None]
    return np.concatenate([box, *(points_behind(vertices, faces, rows, side * distance) for side in (1, -1))])


GROWTH = 4.0  # roundings by which surfaces are moved outwards


def count_contacts(vertices: np.ndarray, faces: np.ndarray, tolerance: float, watch: Watch) -> int:
    """Pairs of triangles that would cross if all surfaces were a few roundings farther out, and folds.

    vertices: shape [vertex, 3]; faces: of closed surfaces, int, shape [face, 3]; tolerance: of rounding, in their unit.
    Pairs with a common vertex do not count, as where bodies touch along edges.
    """
    twin = twins_of(faces, vertices, tolerance)
    label = body_labels(twin)
    key, index = np.unique(label[:, None] * len(vertices) + faces, return_inverse=True)
    own = index.reshape(-1, 3)
    moved = vertices[key % len(vertices)] + GROWTH * tolerance * outward_ways(vertices, faces, own, len(key))
    count = count_folds(vertices, faces, twin, tolerance)
    for done, pairs in find_crossings(moved, own):
        watch("contacts", done, len(faces))
        one, two = faces[pairs[:, 0]], faces[pairs[:, 1]]
        count += int(np.count_nonzero(~(one[:, :, None] == two[:, None, :]).any(axis=(1, 2))))
        if count >= CROSSINGS_MOST:
            break
    return count


def count_folds(vertices: np.ndarray, faces: np.ndarray, twin: np.ndarray, tolerance: float) -> int:
    """Pairs of triangles that lie on each other, on one side of the edge that joins them: where a gap ends.

    Triangles whose corners lie within a few roundings of that edge, which look either way, do not count.
    """
    half = np.flatnonzero(twin > np.arange(len(twin)))
    at, along = vertices[faces.ravel()[half]], vertices[np.roll(faces, -1, axis=1).ravel()[half]]
    along = (along - at) / np.maximum(np.linalg.norm(along - at, axis=1, keepdims=True), np.finfo(float).tiny)
    tip = np.roll(faces, -2, axis=1).ravel()
    one, two = vertices[tip[half]] - at, vertices[tip[twin[half]]] - at
    one, two = (x - np.einsum("ij,ij->i", x, along)[:, None] * along for x in (one, two))
    one_far, two_far = np.linalg.norm(one, axis=1), np.linalg.norm(two, axis=1)
    apart = np.linalg.norm(np.cross(one, two), axis=1) / np.maximum(np.maximum(one_far, two_far), np.finfo(float).tiny)
    folds = (np.einsum("ij,ij->i", one, two) > 0) & (apart <= tolerance)
    return int(np.count_nonzero(folds & (np.minimum(one_far, two_far) > GROWTH * tolerance)))


def outward_ways(vertices: np.ndarray, faces: np.ndarray, own: np.ndarray, count: int) -> np.ndarray:
    """Unit vectors outwards at the vertices of bodies: of the normals around each, weighted by their angles there.

    own: numbers of the faces' vertices among `count` that each body has for itself, shape [face, 3].
    """
    normal = normals_of(vertices, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    out = np.zeros((count, 3))
    for corner in range(3):
        at, one, two = (vertices[faces[:, (corner + k) % 3]] for k in range(3))
        cosine = np.einsum("ij,ij->i", one - at, two - at)
        angle = np.arctan2(np.linalg.norm(np.cross(one - at, two - at), axis=1), cosine)
        for axis in range(3):
            out[:, axis] += np.bincount(own[:, corner], angle * normal[:, axis], minlength=count)
    return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(float).tiny)
