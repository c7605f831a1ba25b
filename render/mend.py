"""Judge a triangle soup and mend it into what the kernels assume: a simple, outward-facing surface."""

import warnings
from dataclasses import dataclass, replace

import numpy as np

from ..kernels.surface import OPEN, twins_of
from .errors import MeshError, PalpateWarning


@dataclass(frozen=True)
class MeshReport:
    """What was found and what was done when a mesh was loaded."""

    vertices_welded: int = 0
    """Vertices with the exact coordinates of another one."""
    faces_dropped: int = 0
    """Triangles with a corner twice, exact repeats, and leaves: a triangle with its own back, attached to nothing."""
    faces_flat: int = 0
    """Triangles of zero area that were kept, since the surface closes through them."""
    faces_turned: int = 0
    """Triangles turned over so that neighbours agree."""
    bodies: int = 1
    """Connected surfaces."""
    bodies_turned: int = 0
    """Bodies that were inside out."""
    cavities: int = 0
    """Closed surfaces that face inwards, inside another body."""
    bodies_united: bool = False
    """Bodies overlapped or touched and were replaced by their union."""
    crossings: int = 0
    """Pairs of triangles that cross or overlap and that uniting did not resolve."""
    overlap: str = ""
    """Why overlapping bodies could not be united; empty if there was no need or it was done."""
    open_edges: int = 0
    """Edges with a triangle on one side only."""
    crossed_edges: int = 0
    """Edges where no choice of sides can agree (a surface with one side only)."""

    @property
    def closed(self) -> bool:
        """Whether inside and outside are defined everywhere."""
        return self.open_edges == 0 and self.crossed_edges == 0 and not self.overlap


def weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices of equal coordinates, each at the place of the first; unused ones disappear.

    The order of what is left does not depend on where the mesh lies, so neither does the order of its contours.
    """
    used, faces = np.unique(faces, return_inverse=True)
    points = vertices[used] + 0.0  # -0 is 0
    _, first, index = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.zeros(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return points[first[order]], rank[index.ravel()][faces.reshape(-1, 3)].astype(np.int32)


def drop_faces(faces: np.ndarray) -> np.ndarray:
    """Leave out triangles with a corner twice, and repeats that face the same way."""
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    turned = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    _, first = np.unique(turned, axis=0, return_index=True)
    return faces[np.sort(first)]


def agree_faces(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Turn triangles over until the two at every plain edge run along it in opposite directions.

    Each triangle appears twice in a graph, as it is and turned over; edges join copies that agree. Its components are
    the possible orientations of each body.
    Returns the faces, which were turned, and at how many edges nothing can agree.
    """
    count = len(faces)
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    order = np.lexsort((np.maximum(tail, head), np.minimum(tail, head)))
    pair = np.stack([np.minimum(tail, head), np.maximum(tail, head)], axis=1)[order]
    _, start, size = np.unique(pair, axis=0, return_index=True, return_counts=True)
    plain = start[size == 2]
    one, two = order[plain] // 3, order[plain + 1] // 3
    differ = (tail[order[plain]] == tail[order[plain + 1]]).astype(np.int64)
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([two + count * differ, two + count * (1 - differ)])
    label = _components(rows, columns, 2 * count)
    as_is, over = label[:count], label[count:]
    crossed = as_is == over
    turned = (over < as_is) & ~crossed  # the copy of a body's first triangle as it is has the smaller label
    out = faces.copy()
    out[turned] = out[turned][:, ::-1]
    return out, turned, int(np.count_nonzero(crossed[one] & (differ == 1)))


def closes_within(vertices: np.ndarray, faces: np.ndarray) -> float | None:
    """Share of the mesh's size within which vertices would have to be merged for its open edges to close."""
    size = np.ptp(vertices, axis=0).max()
    for share in (1e-9, 1e-7, 1e-5):
        joined = drop_faces(weld(np.round(vertices / (share * size)), faces)[1])
        if len(joined) and not (twins_of(joined) == OPEN).any():
            return share
    return None


def body_labels(twin: np.ndarray) -> np.ndarray:
    """Number of the body of each triangle: those joined through an edge's two sides (see `twins_of`)."""
    inner = np.flatnonzero(twin != OPEN)
    one, two = inner // 3, twin[inner] // 3
    return _components(one, two, len(twin) // 3)


def _components(one: np.ndarray, two: np.ndarray, count: int) -> np.ndarray:
    """Number of the component of each of `count` nodes, joined by edges from `one` to `two`."""
    from scipy.sparse import coo_matrix  # a tenth of a second that only meshes cost
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(one), bool), (one, two)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def signed_volumes(vertices: np.ndarray, faces: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Volume of each body [m^3], negative if it faces inwards."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    return np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def winding_number(point: np.ndarray, triangles: np.ndarray) -> float:
    """Solid angle of a closed surface seen from a point, in turns of the sphere (Van Oosterom and Strackee 1983)."""
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    return float(np.sum(np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb)) / (2.0 * np.pi))


def bodies_around(triangles: list[np.ndarray]) -> list[set[int]]:
    """For each body those that it lies in wholly, by the winding number of all its vertices (of 256 of them at most).

    triangles: of each body, float64, shape [face, 3, 3].
    """
    low, high = (np.array([f(t, axis=(0, 1)) for t in triangles]) for f in (np.min, np.max))
    around: list[set[int]] = [set() for _ in triangles]
    for body, part in enumerate(triangles):
        points = part.reshape(-1, 3)[:: max(1, 3 * len(part) // 256)]
        for other in np.flatnonzero(np.all((low <= low[body]) & (high >= high[body]), axis=1)):
            if other != body and all(abs(winding_number(point, triangles[other])) > 0.5 for point in points):
                around[body].add(int(other))
    return around


def settle_signs(volume: np.ndarray, around: list[set[int]]) -> np.ndarray:
    """Which way each body should face: +1 a solid, -1 a cavity; from the outermost inwards.

    solid around it   faces     outermost body turned   becomes
    no                outward   either                  solid
    no                inward    either                  solid (turned)
    yes               inward    either                  cavity
    yes               outward   no                      solid (overlaps: to be united)
    yes               outward   yes                     cavity (turned: the whole nest was inside out)
    """
    sign = np.ones(len(volume), int)
    for body in sorted(range(len(volume)), key=lambda k: len(around[k])):
        solid_around = sum(sign[k] for k in around[body]) > 0
        outermost = [k for k in around[body] if not around[k]]
        turned = any(volume[k] < 0 for k in outermost)
        if solid_around and (volume[body] < 0 or turned):
            sign[body] = -1
    return sign


def boxes_overlap(triangles: list[np.ndarray]) -> bool:
    """Whether the bounding boxes of any two bodies meet."""
    low, high = (np.array([f(t, axis=(0, 1)) for t in triangles]) for f in (np.min, np.max))
    meet = np.all((low[:, None] <= high[None]) & (low[None] <= high[:, None]), axis=2)
    return bool(np.any(meet & ~np.eye(len(low), dtype=bool)))


def unite(vertices: np.ndarray, parts: list[np.ndarray], sign: np.ndarray, around: list[set[int]]):
    """Union of all solids, each less the cavities in it, by manifold3d.

    parts: faces of each body, facing as `sign` says. Returns (vertices, faces) if that differs from the bodies side by
    side in volume or area, None if it does not. Raises MeshError if a body is not a manifold.
    """
    import manifold3d  # 20 MB of geometry that most meshes never need

    def solid(part: np.ndarray):
        used, index = np.unique(part, return_inverse=True)
        mesh = manifold3d.Mesh64(vertices[used], index.reshape(-1, 3).astype(np.uint64))
        out = manifold3d.Manifold(mesh)
        if out.status() != manifold3d.Error.NoError:
            raise MeshError(f"a body of {len(part)} triangles is not a manifold ({out.status().name})")
        return out

    bodies = [solid(part if s > 0 else part[:, ::-1]) for part, s in zip(parts, sign, strict=True)]
    solids = {k: body for k, body in enumerate(bodies) if sign[k] > 0}
    for k in np.flatnonzero(sign < 0):
        holder = max((j for j in around[k] if sign[j] > 0), key=lambda j: len(around[j]))
        solids[holder] = solids[holder] - bodies[k]
    united = manifold3d.Manifold.batch_boolean(list(solids.values()), manifold3d.OpType.Add)
    volume = sum(s * body.volume() for s, body in zip(sign, bodies, strict=True))
    area = sum(body.surface_area() for body in bodies)
    if np.isclose(united.volume(), volume, rtol=1e-9) and np.isclose(united.surface_area(), area, rtol=1e-9):
        return None
    mesh = united.to_mesh64()
    return weld(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(np.int32))


def settle_bodies(vertices: np.ndarray, faces: np.ndarray, twin: np.ndarray, report: MeshReport):
    """Turn bodies that are inside out, keep cavities, unite what overlaps; for a surface without open edges."""
    label = body_labels(twin)
    leaf = np.bincount(label)[label] == 2  # a triangle and its back: no volume, and no manifold
    if leaf.any() and not leaf.all():
        faces, label = faces[~leaf], np.unique(label[~leaf], return_inverse=True)[1].ravel()
        report = replace(report, faces_dropped=report.faces_dropped + int(leaf.sum()))
    volume = signed_volumes(vertices, faces, label)
    rows = np.split(np.argsort(label, kind="stable"), np.cumsum(np.bincount(label))[:-1])
    triangles = [vertices[faces[k]] for k in rows]
    around = bodies_around(triangles)
    sign = settle_signs(volume, around)
    turned = np.sign(volume) * sign < 0
    for k in np.flatnonzero(turned):
        faces[rows[k]] = faces[rows[k]][:, ::-1]
    report = replace(
        report, bodies=len(volume), bodies_turned=int(turned.sum()), cavities=int(np.count_nonzero(sign < 0))
    )
    if len(volume) > 1 and boxes_overlap(triangles):
        try:
            united = unite(vertices, [faces[k] for k in rows], sign, around)
        except MeshError as error:
            return vertices, faces, replace(report, overlap=str(error))
        if united is not None:
            vertices, faces = united
            report = replace(report, bodies_united=True)
    return vertices, faces, report


def check_soup(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse what is not a mesh at all, naming the row."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"vertices must be [vertex, 3] and faces [face, 3], not {vertices.shape} and {faces.shape}")
    if len(faces) == 0:
        raise MeshError("the mesh has no triangles")
    if faces.min() < 0 or faces.max() >= len(vertices):
        row = int(np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))[0])
        raise MeshError(f"face {row} names vertex {faces[row].tolist()}, but there are {len(vertices)} vertices")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{len(bad)} vertices are not finite, the first is vertex {bad[0]}: {vertices[bad[0]].tolist()}"
        )


def mend_mesh(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, MeshReport]:
    """Weld, drop, turn and unite, and say what was done.

    vertices: float, shape [vertex, 3]; faces: int, shape [face, 3].
    Raises MeshError for what is no mesh: no triangles, indices out of range, vertices that are not finite.
    """
    vertices = np.array(vertices, np.float64)
    faces = np.array(faces, np.int64)
    check_soup(vertices, faces)
    used_count = len(np.unique(faces))
    given_count = len(faces)
    vertices, faces = weld(vertices, faces)
    welded = used_count - len(vertices)
    faces = drop_faces(faces)
    if len(faces) == 0:
        raise MeshError(f"all {given_count} triangles have a corner twice: the mesh has no surface")
    dropped = given_count - len(faces)
    faces, turned, crossed = agree_faces(faces)
    twin = twins_of(faces)
    open_count = int(np.count_nonzero(twin == OPEN))
    report = MeshReport(
        vertices_welded=welded,
        faces_dropped=dropped,
        faces_turned=int(turned.sum()),
        open_edges=open_count,
        crossed_edges=crossed,
    )
    if open_count == 0 and crossed == 0:
        vertices, faces, report = settle_bodies(vertices, faces, twin, report)
    else:
        report = replace(report, bodies=int(body_labels(twin).max()) + 1)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.linalg.norm(np.cross(b - a, c - a), axis=1) <= 1e-15 * np.ptp(vertices, axis=0).max() ** 2
    return vertices, faces, replace(report, faces_flat=int(flat.sum()))


def warn_of(report: MeshReport, name: str) -> None:
    """Say in one warning what was changed or is wrong; nothing if all was well."""
    parts = []
    if report.faces_dropped:
        parts.append(f"{report.faces_dropped} triangles dropped (a corner twice, a repeat, or a leaf without volume)")
    if report.faces_flat:
        parts.append(f"{report.faces_flat} triangles of zero area kept, since the surface closes through them")
    if report.faces_turned:
        parts.append(f"{report.faces_turned} triangles turned over to agree with their neighbours")
    if report.bodies_turned:
        parts.append(f"{report.bodies_turned} of {report.bodies} bodies turned inside out (they faced inwards)")
    if report.bodies_united:
        parts.append(f"{report.bodies} bodies that overlap or touch were united")
    if parts:
        warnings.warn(f"{name}: " + "; ".join(parts), PalpateWarning, stacklevel=3)
