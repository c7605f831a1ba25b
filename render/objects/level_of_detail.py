"""Haptic level of detail: a mesh with no more triangles than a focal point can tell apart, its distance measured."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...datasets.errors import name_nothing
from ...kernels.solids.distance import MeshDistance
from ..errors import MeshError, StrategyError
from ..focal_spot import focal_width
from ..validation import unit_hint
from .mesh.solid_mesh import MeshObject

TRIANGLES_MOST = 2_000_000  # pieces under way at once: about 300 MB
AT_ONCE = 500_000  # pieces that are measured in one go
ROUNDING = 1e-6  # of float32, against the size of the two: distances may be off by this

Mesh = tuple[np.ndarray, np.ndarray]


def hausdorff_distance(
    one: Mesh, other: Mesh, *, accuracy: float, limit: float | None = None, device: str = "cpu"
) -> tuple[float, float]:
    """The Hausdorff distance between two meshes, both ways: a distance that occurs, and one that none exceeds [m].

    one, other: vertices [m], shape [vertex, 3], and faces, shape [face, 3].
    The two differ by `accuracy` [m] at most, unless that would take more than `TRIANGLES_MOST` pieces.
    limit: given if all that is asked is whether this distance [m] is exceeded; then work ends as soon as that is known.
    """
    there = farthest_distance(one, other, accuracy=accuracy, limit=limit, device=device)
    if limit is not None and there[0] > limit:
        return there
    back = farthest_distance(other, one, accuracy=accuracy, limit=limit, device=device)
    return max(there[0], back[0]), max(there[1], back[1])


def farthest_distance(
    source: Mesh, target: Mesh, *, accuracy: float, limit: float | None = None, device: str = "cpu"
) -> tuple[float, float]:
    """The largest distance of a point of one surface from another: see `hausdorff_distance`.

    Each triangle has the distance of its middle and a bound for all of its points; those that may hold more than the
    largest distance found, and the accuracy, are halved across their longest side.
    """
    vertices, faces = np.asarray(source[0], np.float64), source[1]
    distance = MeshDistance(np.asarray(target[0], np.float64), target[1], device)
    triangle = vertices[faces]
    rounding = ROUNDING * float(max(np.ptp(mesh[0], axis=0).max() for mesh in (source, target)))
    corner = np.unique(faces)
    known = float(distance.bound_distances(np.repeat(vertices[corner][:, None], 3, axis=1))[0].max())
    settled = known
    while len(triangle):
        parts = [distance.bound_distances(triangle[k : k + AT_ONCE]) for k in range(0, len(triangle), AT_ONCE)]
        at, above = (np.concatenate(part) for part in zip(*parts, strict=True))
        known = max(known, float(at.max()))
        if limit is not None and known > limit:
            return known, max(settled, float(above.max())) + rounding
        still_open = above > max(known + accuracy - rounding, (limit or 0.0) - rounding)
        if 2 * np.count_nonzero(still_open) > TRIANGLES_MOST:
            return known, max(settled, float(above.max())) + rounding
        settled = max(settled, float(above[~still_open].max(initial=0.0)))
        triangle = halved(triangle[still_open])
    return known, max(known, settled) + rounding


def halved(triangle: np.ndarray) -> np.ndarray:
    """Triangles, shape [triangle, 3, 3], as two each, cut across the longest side."""
    side = np.linalg.norm(triangle - np.roll(triangle, -1, axis=1), axis=2).argmax(axis=1)
    a, b, c = (np.take_along_axis(triangle, ((side + k) % 3)[:, None, None], axis=1)[:, 0] for k in range(3))
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.12, 0.06, 0.03)  # of the tolerance, that the library is asked for
ACCURACY = 0.1  # share of the tolerance that the distance is told within


@dataclass(frozen=True)
class Detail:
    """What simplifying a mesh did."""

    tolerance: float
    """What was allowed [m]."""
    distance: float
    """Largest distance between the two surfaces that was found, measured both ways [m]."""
    distance_bound: float
    """No point of either surface is farther from the other than this [m]; the Hausdorff distance is in between."""
    triangles_before: int
    triangles_after: int

    def described(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def simplify(mesh: MeshObject, tolerance: float | None = None, *, device: str = "cpu") -> tuple[MeshObject, Detail]:
    """The mesh with fewer triangles, closed, and how far the two surfaces are from each other.

    tolerance: no point of either surface ends farther from the other than this [m]; None: a quarter of the width of a
    focal point at the object's middle. device: where distances are measured.

    manifold3d moves corners together and keeps the surface closed; it takes its tolerance edge by edge, so thin parts
    can shrink by more. So the result is measured, and of several attempts the one with the fewest triangles that keeps
    the tolerance is taken; if none does, or nothing is gained, the mesh itself.
    Raises MeshError for a mesh that is not closed and for a tolerance that is none.

    >>> import trimesh
    >>> from palpate.render import MeshObject, simplify
    >>> box = trimesh.creation.box((0.1, 0.1, 0.05)).subdivide().subdivide()  # 16 triangles for each that it needs
    >>> simple, detail = simplify(MeshObject(box, at=(0, 0, 0.2)), tolerance=0.0001)
    >>> detail.triangles_before, detail.triangles_after
    (192, 12)
    """
    if tolerance is None:
        try:
            tolerance = focal_width(mesh.bounds.mean(axis=0)).width / 4
        except StrategyError as error:
            raise StrategyError(f"{mesh.name}: {error}; give a tolerance, or move the object") from error
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise MeshError(f"{mesh.name}: tolerance must be a positive length in metres, not {tolerance}")
    size = float(np.ptp(mesh.bounds, axis=0).max())
    if tolerance > size:
        hint = unit_hint(tolerance, 0.0, size, "m")
        refused = f"{mesh.name}: tolerance must be less than the mesh, {size:.3g} m, not {tolerance}{hint}"
        raise name_nothing(MeshError(refused))
    if not mesh.report.closed:
        raise MeshError(
            f"{mesh.name}: only a closed surface can be simplified, but it has {mesh.report.open_edges} open edges "
            "or bodies that overlap; voxelising it closes it"
        )
    whole = (mesh.vertices, mesh.faces)
    best, before = whole, len(mesh.faces)
    for share in SHARES:
        found = collapsed(mesh, share * tolerance)
        if 0 < len(found[1]) < len(best[1]):
            _, bound = hausdorff_distance(whole, found, accuracy=ACCURACY * tolerance, limit=tolerance, device=device)
            best = found if bound <= tolerance else best
    if best is whole:
        return mesh, Detail(tolerance, 0.0, 0.0, before, before)
    distance, bound = hausdorff_distance(whole, best, accuracy=ACCURACY * tolerance, device=device)
    simple = MeshObject(*best, name=mesh.name, solid=mesh.solid)
    return simple, Detail(tolerance, distance, bound, before, len(simple.faces))


def collapsed(mesh: MeshObject, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m], float32, and faces of what manifold3d makes of a closed mesh; no faces if it cannot take it."""
    import manifold3d  # 50 ms that only simplifying costs

    middle = mesh.bounds.mean(axis=0)
    near = (mesh.vertices - middle).astype(np.float32)
    manifold = manifold3d.Manifold(manifold3d.Mesh(near, mesh.faces.astype(np.uint32)))
    if manifold.status() != manifold3d.Error.NoError:
        raise MeshError(f"{mesh.name}: cannot be simplified ({manifold.status().name})")
    out = manifold.simplify(tolerance).to_mesh()
    vertices = np.asarray(out.vert_properties)[:, :3].astype(np.float64) + middle
    return vertices.astype(np.float32), np.asarray(out.tri_verts, np.int32)
