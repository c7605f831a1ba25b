"""Meshes to voxels: the way to closed contours for a surface that has holes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from ....datasets.errors import name_nothing
from ....kernels.section.half_edges import twins_of
from ....kernels.solids.voxelise import GridNodes, cross_columns, measure_distances, wind_nodes
from ...errors import MeshError, VoxelError
from ...runtime.interrupt import abandonable
from ...runtime.loading_progress import Watch, unwatched
from ...user_warnings import warn_user
from ...validation import unit_hint, value_text
from ..mesh.bodies import body_labels, resolve_signs, rows_of, signed_volumes
from ..mesh.placement import Placement
from ..mesh.repair import winding_number
from ..mesh.sheets import edges_of
from ..mesh.solid_mesh import MeshObject
from .grid import LENGTHS, PADDED_MOST, is_bounded_number, numbers_of
from .voxel_object import VoxelObject, save_voxels

SIGNS = ("auto", "crossings", "parity", "winding")
SPACING_LARGEST = 0.05  # [m]; a larger spacing is probably meant in millimetres
MARGIN = 2.0  # [voxel] around the mesh, unless told
THRESHOLD = 0.5  # winding number above which a point is inside
DEEP = 0.9  # and above which it is even if it lies on the mesh: on a single surface it is 0.5
ROUNDING = 1e-3  # of float32 distances, relative
FLAT = 1e-6  # volume of a body, of the cube over its longest side, below which it has no inside
BODIES_MOST = 2000  # beyond, bodies of an open mesh are taken as they face


def sign_of(mesh: MeshObject, sign: str) -> str:
    """How to decide what is inside, once `auto` is resolved.

    surface                        auto        also possible
    closed                         crossings   parity, winding
    closed, but sides disagree     parity      winding
    with edges of one triangle     winding     none: columns would leak through the holes
    """
    if sign not in SIGNS:
        raise VoxelError(f"sign must be one of {', '.join(SIGNS)}, not {value_text(sign)}")
    rims = int(np.count_nonzero(edges_of(mesh.faces).face_count % 2))  # a column could slip through the surface there
    agrees = rims == 0 and mesh.report.open_edges == 0
    if sign == "auto":
        return "crossings" if agrees else "winding" if rims else "parity"
    if rims and sign != "winding":
        raise MeshError(f"{mesh.name}: sign={sign!r} needs a closed surface; it has {rims} open edges")
    if sign == "crossings" and not agrees:
        raise MeshError(f"{mesh.name}: sign='crossings' needs sides that agree; sign='parity' does not")
    return sign


def grid_around(
    bounds: np.ndarray, spacing: float | Sequence[float], margin: float | None, name: str = "mesh"
) -> GridNodes:
    """Nodes over a box and a margin around it, the box in their middle; raises VoxelError for too many or for none.

    bounds, spacing, margin: [m].
    """
    step = np.ravel(numbers_of("spacing", spacing, LENGTHS))
    step = np.repeat(step, 3) if len(step) == 1 else step
    if len(step) != 3 or not (np.isfinite(step) & (step > 0)).all():
        raise VoxelError(f"spacing must be {LENGTHS}, not {value_text(spacing)}")
    if margin is not None and not (is_bounded_number(margin) and margin >= 0):
        raise VoxelError(f"margin must be a length in metres of at least 0, not {value_text(margin)}")
    around = MARGIN * step if margin is None else np.full(3, float(margin))
    count = np.maximum(np.ceil((np.ptp(bounds, axis=0) + 2 * around) / step), 1.0) + 1
    if (count + 2).prod() > PADDED_MOST:
        size = " x ".join(f"{x:.0f}" for x in count)
        raise VoxelError(
            f"{name}: spacing {spacing} m needs {size} voxels; {PADDED_MOST} are allowed, a layer around them included"
        )
    origin = (bounds[0] + bounds[1]) / 2 - (count - 1) / 2 * step
    return GridNodes(origin, step, (int(count[0]), int(count[1]), int(count[2])))


def turn_bodies(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int]:
    """Faces with bodies that face inwards turned over, and how many were: else winding numbers would cancel."""
    label = body_labels(twins_of(faces))
    rows = rows_of(label)
    if len(rows) > BODIES_MOST:
        return faces, 0
    triangles = [vertices[faces[k]] for k in rows]
    volume = np.array([own_volume(part) for part in triangles])
    sign = resolve_signs(volume, bodies_around(triangles))
    turned = np.flatnonzero(volume * sign < 0)
    faces = faces.copy()
    for k in turned:
        faces[rows[k]] = faces[rows[k]][:, ::-1]
    return faces, len(turned)


def bodies_around(triangles: list[np.ndarray]) -> list[set[int]]:
    """For each body those that it lies in wholly, by the winding number of all its vertices (of 256 of them at most).

    triangles: of each body, float64, shape [face, 3, 3]; bodies may have holes.
    """
    low, high = (np.array([f(t, axis=(0, 1)) for t in triangles]) for f in (np.min, np.max))
    around: list[set[int]] = [set() for _ in triangles]
    for body, part in enumerate(triangles):
        points = part.reshape(-1, 3)[:: max(1, 3 * len(part) // 256)]
        for other in np.flatnonzero(np.all((low <= low[body]) & (high >= high[body]), axis=1)):
            if other != body and all(abs(winding_number(point, triangles[other])) > 0.5 for point in points):
                around[body].add(int(other))
    return around


def own_volume(triangles: np.ndarray) -> float:
    """Volume between a body's triangles and its own middle [m^3], below 0 if most of it faces inwards, 0 if flat."""
    flat = triangles.reshape(-1, 3) - triangles.mean(axis=(0, 1))
    volume = signed_volumes(flat, np.arange(len(flat)).reshape(-1, 3), np.zeros(len(triangles), np.int64))[0]
    return float(volume) if abs(volume) > FLAT * np.ptp(flat, axis=0).max() ** 3 else 0.0


def hole_points(winding: np.ndarray, distance: np.ndarray, nodes: GridNodes) -> np.ndarray:
    """Where the winding number passes the threshold between two neighbours with no mesh between them [m], [point, 3].

    A mesh between them would be no farther from the two, together, than they are from each other.
    """
    out = []
    for axis in range(3):
        (w, w_next), (d, d_next) = (
            (np.moveaxis(x, axis, 0)[:-1], np.moveaxis(x, axis, 0)[1:]) for x in (winding, distance)
        )
        bare = ((w > THRESHOLD) != (w_next > THRESHOLD)) & (d + d_next > nodes.spacing[axis] * (1 + ROUNDING))
        at = np.argwhere(bare).astype(np.float64)
        a, b = w[bare].astype(np.float64) - THRESHOLD, w_next[bare].astype(np.float64) - THRESHOLD
        at[:, 0] += a / (a - b)
        out.append(np.insert(at[:, 1:], axis, at[:, 0], axis=1))
    return nodes.origin + np.concatenate(out) * nodes.spacing


def near_holes(distance: np.ndarray, points: np.ndarray, nodes: GridNodes) -> np.ndarray:
    """Distances to the mesh or to what closes its holes, whichever is nearer [m]."""
    if len(points) == 0:
        return distance
    from scipy.spatial import KDTree  # a tenth of a second that closed meshes need not wait for

    tree = KDTree(points)
    out = np.empty_like(distance)
    j, k = (a.ravel() for a in np.meshgrid(*(np.arange(n) for n in nodes.shape[1:]), indexing="ij"))
    for i in range(nodes.shape[0]):
        at = nodes.origin + np.stack([np.full(len(j), i), j, k], axis=1) * nodes.spacing
        out[i] = np.minimum(distance[i], tree.query(at)[0].reshape(distance[i].shape))
    return out


def known_device(device: str | None) -> str:
    """A Warp device's name, the preferred one's for None; raises VoxelError for one that is not there."""
    if device is None:
        return str(wp.get_preferred_device())
    try:
        return str(wp.get_device(device))
    except (ValueError, TypeError, RuntimeError, AttributeError) as error:
        known = ", ".join(str(x) for x in wp.get_devices())
        raise VoxelError(f"device must be one of {known}, not {value_text(device)}") from error


def voxelise(
    mesh: MeshObject | str | Path,
    *,
    spacing: float | Sequence[float],
    kind: str = "distance",
    margin: float | None = None,
    band: float | None = None,
    sign: str = "auto",
    device: str | None = None,
) -> VoxelObject:
    """A mesh as voxels, holes closed.

    spacing: between voxel centres [m], one or three. margin: around the mesh [m], None: 2 voxels. kind: "distance" to
    the surface [m], negative inside, from each voxel centre, or "occupancy". band: beyond this distance, distances are
    cut off [m], which is faster; None: nowhere. device: a Warp device; None: its preferred one.

    sign: "crossings" of each column of voxels with the surface, entered less left; "parity", whichever way triangles
    face; "winding", the generalised winding number above 0.5, for surfaces with holes; "auto": the first that fits.
    With "winding", bodies that face inwards are turned over, which a PalpateWarning counts.

    Raises VoxelError for a spacing, margin or band that cannot be used, and where nothing is inside: a surface too open
    to hold anything, or thinner than the spacing; MeshError for a sign that needs a closed surface.

    >>> from palpate.render import MeshObject, voxelise
    >>> voxelise(MeshObject.load("cube"), spacing=0.02)  # 6 of its voxels fit along each side
    VoxelObject('cube', 216 voxels inside, 130 x 130 x 130 mm at (0, 0, 0.2) m)
    """
    if kind not in ("distance", "occupancy"):
        raise VoxelError(f"kind must be 'distance' or 'occupancy', not {value_text(kind)}")
    mesh = MeshObject.load(mesh) if isinstance(mesh, str | Path) else mesh
    if not isinstance(mesh, MeshObject):
        raise VoxelError(f"a MeshObject is voxelised, not {value_text(mesh)}")
    nodes = grid_around(mesh.bounds, spacing, margin, mesh.name)
    if band is not None and not (is_bounded_number(band) and band >= 2 * nodes.spacing.max()):
        raise VoxelError(f"band must be at least two voxels, {2 * nodes.spacing.max():g} m, not {value_text(band)}")
    sign = sign_of(mesh, sign)
    device = known_device(device)
    vertices, faces, turned, points = mesh.vertices.astype(np.float64), mesh.faces, 0, np.zeros((0, 3))
    deep = np.zeros(nodes.shape, bool)
    if band is None and kind == "occupancy" and sign != "winding":
        band = 2 * nodes.spacing.max()  # all that matters is which voxels lie on the surface
    reach = float(np.linalg.norm(np.array(nodes.shape) * nodes.spacing)) if band is None else float(band)
    with abandonable():
        distance = measure_distances(vertices, faces, nodes, band=reach, device=device)
    if sign == "winding":
        faces, turned = turn_bodies(vertices, faces)
        with abandonable():
            winding = wind_nodes(vertices, faces, nodes, device)
        inside = winding > THRESHOLD
        deep = (winding > DEEP) & (distance == 0)
        points = hole_points(winding, distance, nodes)
        distance = near_holes(distance, points, nodes)
    else:
        with abandonable():
            inside = cross_columns(vertices, faces, nodes, odd=sign == "parity", device=device) > 0
    inside &= (distance > 0) | deep  # what lies on the surface is outside, but not within another body
    distance[deep] = ROUNDING * nodes.spacing.min()
    if turned:
        warn_user(f"{mesh.name}: {turned} of its bodies faced inwards and were turned over")
    if not inside.any():
        why = "it is too open to hold anything" if sign == "winding" else "it is thinner than the spacing"
        step = float(nodes.spacing.max())
        hint = unit_hint(step, 0.0, SPACING_LARGEST, "m") if step > SPACING_LARGEST else ""
        raise name_nothing(VoxelError(f"{mesh.name}: no voxel of {spacing} m lies inside: {why}{hint}"))
    return VoxelObject(
        np.where(inside, -distance, distance) if kind == "distance" else inside,
        spacing=nodes.spacing,
        origin=nodes.origin,
        kind=kind,
        name=mesh.name,
        source={
            "mesh": mesh.identity,  # SHA-256 of the mesh as placed
            "sign": sign,
            "bodies_turned": turned,  # of an open mesh, which faced inwards
            "hole_points": len(points),  # between two nodes, where the solid was closed over a hole
        },
    )


def voxelise_file(
    source: str | Path,
    out: str | Path,
    *,
    spacing: float | Sequence[float],
    placement: Placement | None = None,
    kind: str = "distance",
    margin: float | None = None,
    band: float | None = None,
    sign: str = "auto",
    device: str | None = None,
    watch: Watch = unwatched,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Voxelise a built-in object or a mesh file into a file of voxels; returns what it says about itself, for JSON."""
    mesh = MeshObject.load(source, placement=placement, watch=watch)
    watch("voxels", 0, 1)
    voxels = voxelise(mesh, spacing=spacing, kind=kind, margin=margin, band=band, sign=sign, device=device)
    save_voxels(voxels, out, overwrite=overwrite)
    return {**voxels.described(), "file": str(out)}
