"""The surface of a solid that is a field, as a closed mesh."""

import numpy as np

from ...kernels.fields.field import Field, lattice_of
from ...kernels.solids.isosurface import mesh_isosurface
from ..errors import MeshError
from .solid import Solid

CELL_LIMIT = 2**24  # 256 cells a side: 40 bytes each while it is meshed
MARGIN = 1e-4  # share of a lattice edge between a vertex and the edge's ends


def isosurface(
    solid: Solid | Field, bounds: np.ndarray, step: float, *, device: str = "cpu", limit: int = CELL_LIMIT
) -> tuple[np.ndarray, np.ndarray]:
    """The surface as a mesh: vertices [m], float32, shape [vertex, 3], and faces, int32, shape [face, 3].

    bounds: what is meshed [m], shape [2, 3]; a surface that leaves it is closed half a step outside it, or more.
    step: of the lattice [m]. Vertices lie on the surface, where it crosses the lattice's edges, but for `MARGIN` of a
    step; what is thinner than a step may be missing.
    device: of the work; where a Field's data lie.
    limit: most cells of the lattice.

    The mesh is closed, has no coinciding vertices, and its triangles are counter-clockwise from outside.
    Raises MeshError for bounds or a step that are none, more cells than the limit, and where no node is inside.

    >>> from palpate.render import ImplicitObject, MeshObject, isosurface, sphere
    >>> ball = ImplicitObject(sphere(0.03), at=(0, 0, 0.2))
    >>> vertices, faces = isosurface(ball, ball.bounds, step=0.005)
    >>> len(vertices) - len(faces) // 2  # Euler's number of a closed surface without a handle
    2
    >>> MeshObject(vertices, faces).bounds.round(3)  # [m]
    array([[-0.03, -0.03,  0.17],
           [ 0.03,  0.03,  0.23]])
    """
    name = "field" if isinstance(solid, Field) else solid.name
    bounds = np.asarray(bounds, np.float64)
    if bounds.shape != (2, 3) or not np.isfinite(bounds).all() or (bounds[0] > bounds[1]).any():
        raise MeshError(f"{name}: bounds must be finite, lowest then highest, shape [2, 3], not {bounds.tolist()}")
    if not (np.isfinite(step) and step > 0):
        raise MeshError(f"{name}: step must be a positive length in metres, not {step}")
    cells = np.floor(np.ptp(bounds, axis=0) / step) + 2  # at least half a step around
    if cells.prod() > limit:
        least = float(np.cbrt(np.ptp(bounds, axis=0).prod() / limit))
        raise MeshError(
            f"{name}: a surface in steps of {step:.3g} m takes {cells.prod():.3g} cells, of which {limit} are allowed; "
            f"a step of about {max(least, step * (cells.prod() / limit) ** (1 / 3)):.2g} m fits"
        )
    margin = max(MARGIN, 4 * float(np.spacing(np.float32(np.abs(bounds).max()))) / step)
    if margin > 0.25:
        raise MeshError(f"{name}: a step of {step:.3g} m is below what float32 resolves this far from the origin")
    lattice = lattice_of(bounds.mean(axis=0) - cells * step / 2, step)
    field = solid if isinstance(solid, Field) else solid.field_on(device)
    shape = tuple(int(n) + 1 for n in cells)
    vertex, corner = mesh_isosurface(field, lattice, (shape[0], shape[1], shape[2]), margin=margin, device=device)
    if not corner.shape[0]:
        raise MeshError(f"{name}: no point of a lattice of {step:.3g} m is inside; a smaller step may find it")
    return vertex.numpy(), corner.numpy().reshape(-1, 3)
