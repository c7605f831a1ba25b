"""Haptic level of detail: a mesh with no more triangles than a focal point can tell apart."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...datasets.errors import name_nothing
from ..errors import MeshError, StrategyError
from ..focal_spot import focal_width
from ..validation import unit_hint
from .hausdorff import hausdorff_distance
from .mesh.solid_mesh import MeshObject

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
