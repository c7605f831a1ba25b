"""Judge a triangle soup and mend it into what the kernels assume: the boundary of a solid, facing outwards.

The order of triangles, of vertices and of corners within a triangle changes nothing: the first step sorts it away, and
no later one decides by it. Inside is where the winding number of all bodies, once they face as they should, is above 0
(`solid="winding"`), or odd (`solid="even-odd"`).
"""

from dataclasses import dataclass, replace

import numpy as np

from ....kernels.section.half_edges import OPEN, twins_of
from ...errors import MeshError
from ...runtime.loading_progress import Watch, unwatched
from .bodies import (
    Bodies,
    agree_faces,
    alternating_signs,
    areas_of,
    body_labels,
    faces_front,
    flat_bodies,
    nest_bodies,
    points_behind,
    resolve_signs,
    rows_of,
    signed_volumes,
)
from .report import MeshReport
from .sheets import closed_part, components, edges_of, is_plain, joined_by_edges, outer_hull, split_repeats
from .union import Cluster, Crossings, check_union, clusters_of, count_contacts, count_crossings, unite
from .welding import (
    check_soup,
    count_repeats,
    repeated,
    rounding_of,
    sorted_faces,
    split_shared,
    unify_patches,
    weld,
    weld_close,
    without_slivers,
)

WELD_SHARES = (1e-6, 1e-5, 1e-4, 1e-3)  # of a mesh's size, within which merging vertices is tried to close it


def rims_of(faces: np.ndarray, twin: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The open half-edges, the one that follows each along its rim (as a row of them), and the number of its rim.

    faces: int, shape [face, 3]; twin: as `twins_of` gives it.
    """
    rim = np.flatnonzero(twin == OPEN)
    row = np.full(len(twin), -1)
    row[rim] = np.arange(len(rim))
    at = 3 * (rim // 3) + (rim + 1) % 3
    while True:
        inner = np.flatnonzero(twin[at] != OPEN)
        if len(inner) == 0:
            break
        across = twin[at[inner]].astype(np.int64)
        at[inner] = 3 * (across // 3) + (across + 1) % 3
    following = row[at]
    return rim, following, components(np.arange(len(rim)), following, len(rim))


def rim_lengths(vertices: np.ndarray, faces: np.ndarray, rim: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Length of each rim, in the mesh's unit."""
    tail, head = faces.ravel()[rim], np.roll(faces, -1, axis=1).ravel()[rim]
    return np.bincount(number, np.linalg.norm(vertices[head] - vertices[tail], axis=1))


def fill_holes(
    vertices: np.ndarray, faces: np.ndarray, twin: np.ndarray, length: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Close every hole whose rim is at most `length` long by triangles from its rim to the middle of its corners.

    Returns vertices and faces with those of the lids after them, and how many holes were closed.
    """
    rim, _, number = rims_of(faces, twin)
    if len(rim) == 0:
        return vertices, faces, 0
    small = rim_lengths(vertices, faces, rim, number) <= length
    middle_of = np.cumsum(small) - 1 + len(vertices)
    kept = small[number]
    tail, head = faces.ravel()[rim][kept], np.roll(faces, -1, axis=1).ravel()[rim][kept]
    number = number[kept]
    count = np.bincount(number, minlength=len(small))[:, None]
    sums = np.stack([np.bincount(number, vertices[tail][:, k], minlength=len(small)) for k in range(3)], axis=1)
    lids = np.stack([head, tail, middle_of[number]], axis=1)
    middles = (sums / np.maximum(count, 1))[small]
    return np.vstack([vertices, middles]), np.vstack([faces, lids]), int(small.sum())


def closing_distance(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The least of some distances within which merging vertices leaves no open edge, in the mesh's unit; 0 for none."""
    for share in WELD_SHARES:
        distance = float(share * np.ptp(vertices, axis=0).max())
        joined = sorted_faces(weld_close(*weld(vertices, faces), distance)[1])
        if len(joined) and closed_part(joined).all():
            return distance
    return 0.0


ENCLOSES = 0.75  # winding number that an open surface must reach somewhere to count as a solid with holes
ENCLOSURE_SAMPLES = 256  # triangles at which that is asked


@dataclass(frozen=True)
class Repair:
    """What is done to a mesh on demand, beyond what it always needs; lengths in the file's unit."""

    solid: str = "winding"
    """What is inside: "winding" (winding number above 0) or "even-odd" (an odd winding number)."""
    weld: float = 0.0
    """Vertices at most this far apart are merged; those that float32 cannot tell apart always are."""
    fill_holes: float = 0.0
    """Holes whose rim is at most this long are closed."""


@dataclass(frozen=True)
class Mended:
    """A mended mesh."""

    vertices: np.ndarray
    """float64, shape [vertex, 3]."""
    faces: np.ndarray
    """int64, shape [face, 3]; those that bound the solid first."""
    solid_count: int
    """How many of the faces bound the solid; the others are open surfaces."""
    report: MeshReport


@dataclass(frozen=True)
class Surface:
    """A mesh on its way: where its faces are and what was done to it so far."""

    vertices: np.ndarray
    faces: np.ndarray
    report: MeshReport
    tolerance: float


def repair_mesh(
    vertices: np.ndarray, faces: np.ndarray, repair: Repair | None = None, watch: Watch = unwatched
) -> Mended:
    """Weld, drop, turn and unite, and say what was done.

    vertices: float, shape [vertex, 3]; faces: int, shape [face, 3].
    Raises MeshError for what is no mesh: no triangles, indices out of range, vertices that are not finite.
    """
    repair = repair or Repair()
    vertices, faces = np.array(vertices, np.float64), np.array(faces, np.int64)
    check_soup(vertices, faces)
    watch("welding", 0, 1)
    surface = welded_surface(vertices, faces, repair)
    watch("orientation", 0, 1)
    surface = oriented_surface(surface)
    if repair.fill_holes > 0:
        surface = filled_surface(surface, repair.fill_holes)
    is_closed = closed_part(surface.faces)
    crossed = surface.report.crossed_edges > 0
    is_closed &= not crossed
    solid, sheets = replace(surface, faces=surface.faces[is_closed]), surface.faces[~is_closed]
    if len(solid.faces):
        watch("bodies", 0, 1)
        solid, flat = resolved_solid(solid, repair, watch)
        if len(solid.faces) == len(sheets) == 0:  # nothing but sheets with their backs: drawn as open surfaces
            sheets = flat
    return finished(solid, sheets, surface.vertices)


def welded_surface(vertices: np.ndarray, faces: np.ndarray, repair: Repair) -> Surface:
    """Vertices and triangles merged and sorted; of repeats what `mesh_sheets` keeps."""
    used_count, given_count = int(np.count_nonzero(np.bincount(faces.ravel()))), len(faces)
    vertices, faces = weld(vertices, faces)
    tolerance = rounding_of(vertices)
    vertices, faces = weld_close(vertices, faces, max(repair.weld, tolerance))
    faces = sorted_faces(faces)
    require_surface(faces, "have a corner twice", given_count, tolerance, repair)
    whole_count = len(faces)
    faces, flat_count = without_slivers(vertices, faces, tolerance)
    dropped = given_count - whole_count + len(faces)
    require_surface(faces, "are flat or have a corner twice", given_count, tolerance, repair)
    faces = without_repeats(vertices, faces, tolerance)
    report = MeshReport(
        triangles=given_count,
        vertices_welded=used_count - len(vertices),
        faces_dropped=dropped - len(faces),
        faces_flat=flat_count,
    )
    return Surface(vertices, faces, report, tolerance)


def require_surface(faces: np.ndarray, all_are: str, given_count: int, tolerance: float, repair: Repair) -> None:
    """Raise MeshError where no triangle is left."""
    if len(faces) == 0:
        why = f"weld merges what is {repair.weld:.3g} of the file's units apart"
        if repair.weld <= tolerance:
            why = f"float32 cannot tell what is {tolerance:.3g} of the file's units apart, for this size and place"
        raise MeshError(f"all {given_count} triangles {all_are}, and so no surface is left: {why}")


def without_repeats(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> np.ndarray:
    """Sorted faces, of those in one place what `mesh_patches` and `mesh_sheets` keep."""
    if is_plain(edges_of(faces)):
        return faces
    faces = sorted_faces(repeated(*unify_patches(vertices, *count_repeats(faces), tolerance)))
    faces, shared = split_shared(vertices, faces, tolerance)
    odd, even = split_repeats(sorted_faces(faces))
    faces = with_walls(vertices, odd, even, tolerance) if len(even) else odd
    return sorted_faces(np.concatenate([faces, shared]))


def with_walls(vertices: np.ndarray, odd: np.ndarray, even: np.ndarray, tolerance: float) -> np.ndarray:
    """Faces that are there an odd number of times, and those of the even ones that bound something (`mesh_sheets`)."""
    closes_alone = closed_part(even)
    bodies = outer_hull(vertices, even[closes_alone], tolerance) if closes_alone.any() else even[:0]
    rest = even[~closes_alone]
    both = np.concatenate([odd, rest])
    edges = edges_of(both)
    connected = joined_by_edges(edges)
    odd_count = np.bincount(edges.of_half[: 3 * len(odd)], minlength=len(edges.face_count))
    is_open = np.zeros(int(connected.max(initial=-1)) + 1, bool)
    is_open[connected[np.flatnonzero(odd_count[edges.of_half] % 2) // 3]] = True
    needed = is_open[connected[len(odd) :]]
    needed |= len(odd) == len(bodies) == 0  # a mesh of sheets alone is drawn as open surfaces
    return np.concatenate([odd, rest[needed], bodies])


def oriented_surface(surface: Surface) -> Surface:
    """Neighbours made to agree."""
    faces, turned, crossed = agree_faces(surface.vertices, surface.faces)
    report = replace(surface.report, faces_turned=int(turned.sum()), crossed_edges=crossed)
    return replace(surface, faces=faces, report=report)


def filled_surface(surface: Surface, length: float) -> Surface:
    """Small holes closed, and the whole sorted and oriented again."""
    twin = twins_of(surface.faces, surface.vertices, surface.tolerance)
    vertices, faces, count = fill_holes(surface.vertices, surface.faces, twin, length)
    if count == 0:
        return surface
    vertices, faces = weld(vertices, faces)
    turned = surface.report.faces_turned
    out = oriented_surface(
        replace(
            surface, vertices=vertices, faces=sorted_faces(faces), report=replace(surface.report, holes_filled=count)
        )
    )
    return replace(out, report=replace(out.report, faces_turned=turned + out.report.faces_turned))


def resolved_solid(surface: Surface, repair: Repair, watch: Watch) -> tuple[Surface, np.ndarray]:
    """Bodies told apart, turned, left out where they bound nothing, and united where they cross.

    Returns also one side of the flat bodies that were left out.
    """
    faces, tolerance = balanced(surface), surface.tolerance
    vertices = surface.vertices
    label = body_labels(twins_of(faces, vertices, tolerance))
    flat = flat_bodies(vertices, faces, label, tolerance)
    dropped = len(surface.faces) - len(faces)
    report = replace(
        surface.report,
        faces_dropped=surface.report.faces_dropped + dropped,
        bodies=len(flat),
        bodies_flat=int(flat.sum()),
    )
    kept = ~flat[label]
    sheets = faces[~kept & faces_front(vertices, faces)]
    faces, label = faces[kept], np.unique(label[kept], return_inverse=True)[1]
    surface = replace(surface, faces=faces, report=report)
    if len(faces) == 0:
        return surface, sheets
    return bounding_bodies(surface, label, repair, watch), sheets


def balanced(surface: Surface) -> np.ndarray:
    """Faces of which every edge has as many one way as the other: the outer hull where no sides agree."""
    faces = surface.faces
    edges = edges_of(faces)
    if not edges.balance.any():
        return faces
    connected = joined_by_edges(edges)
    odd = np.unique(connected[np.flatnonzero(edges.balance[edges.of_half]) // 3])
    walled = np.isin(connected, odd)
    hull = outer_hull(surface.vertices, faces[walled], surface.tolerance)
    return sorted_faces(np.concatenate([faces[~walled], hull]))


def bounding_bodies(surface: Surface, label: np.ndarray, repair: Repair, watch: Watch) -> Surface:
    """Turn bodies that are inside out, keep cavities, leave out what bounds nothing, unite what crosses."""
    vertices, faces, tolerance = surface.vertices, surface.faces, surface.tolerance
    volume = signed_volumes(vertices, faces, label)
    found = count_crossings(vertices, faces, label, watch)
    watch("nesting", 0, 1)
    depth = tolerance
    if len(volume) > 1 and found.all_counted:
        nest = nest_bodies(vertices, faces, label, volume, found.touching, depth)
        around, outside = nest.around, nest.outside
    else:
        around, outside = [set() for _ in volume], np.zeros((0, 2), np.int64)
    even_odd = repair.solid == "even-odd"
    sign = alternating_signs(around) if even_odd else resolve_signs(volume, around)
    turned = np.sign(volume) * sign < 0
    faces = np.where(turned[label][:, None], faces[:, ::-1], faces)
    report = replace(
        surface.report,
        bodies_turned=int(turned.sum()),
        cavities=int(np.count_nonzero(sign < 0)),
        crossings_found=found.pair_count,
    )
    bodies = Bodies(rows_of(label), sign, around, outside)
    return joined_clusters(replace(surface, faces=faces, report=report), bodies, found, even_odd, watch)


def joined_clusters(surface: Surface, bodies: Bodies, found: Crossings, even_odd: bool, watch: Watch) -> Surface:
    """Leave out bodies that bound nothing, and replace clusters that cross by their union where that can be done."""
    report, tolerance = surface.report, surface.tolerance
    clusters = clusters_of(found)
    kept = np.ones(len(bodies.rows), bool)
    if not even_odd and found.all_counted:
        level = np.bincount(bodies.outside[:, 0], bodies.sign[bodies.outside[:, 1]], minlength=len(kept))
        kept = (level > 0) != (level + bodies.sign > 0)
    united_points, united_faces, vertex_count = [surface.vertices], [], len(surface.vertices)
    hidden, united, crossings, reasons = 0, 0, 0, []
    for number, cluster in enumerate(clusters):
        watch("uniting", number, len(clusters))
        kept[cluster.bodies] = True
        if not even_odd and is_hidden(bodies, cluster):
            kept[cluster.bodies] = False
            continue
        try:
            points, faces = united_cluster(surface, bodies, cluster, even_odd)
        except MeshError as error:
            crossings += cluster.crossing_count
            reasons.append(str(error))
            continue
        kept[cluster.bodies] = False
        united += len(cluster.bodies)
        united_points.append(points)
        united_faces.append(faces + vertex_count)
        vertex_count += len(points)
    hidden = int(np.count_nonzero(~kept)) - united
    rows = np.concatenate([bodies.rows[k] for k in np.flatnonzero(kept)]) if kept.any() else np.zeros(0, np.int64)
    faces = np.concatenate([surface.faces[rows], *united_faces])
    vertices, faces = weld(np.concatenate(united_points), faces)
    faces = sorted_faces(faces)
    if len(bodies.rows) > 1 and not crossings:
        faces = without_gaps(vertices, faces, tolerance) if united else faces
        again = count_crossings(vertices, faces, np.zeros(len(faces), np.int64), unwatched).pair_count if united else 0
        crossings = again + count_contacts(vertices, faces, tolerance, watch)
        reasons = ["bodies touch within rounding"] * (crossings > 0)
    report = replace(
        report,
        bodies_hidden=hidden,
        bodies_united=united,
        crossings=crossings,
        union_fault=reasons[0] if reasons else "",
    )
    return replace(surface, vertices=vertices, faces=faces, report=report, tolerance=tolerance)


def without_gaps(vertices: np.ndarray, faces: np.ndarray, tolerance: float) -> np.ndarray:
    """Faces of a union without the walls and flat bodies that it leaves where bodies had touched within rounding."""
    faces = without_repeats(vertices, faces, tolerance)
    label = body_labels(twins_of(faces, vertices, tolerance))
    return faces[~flat_bodies(vertices, faces, label, tolerance)[label]]


def is_hidden(bodies: Bodies, cluster: Cluster) -> bool:
    """Whether bodies that touch each other lie in the solid of others whatever they do to the winding number."""
    if cluster.fault:
        return False
    level = bodies.level(cluster.bodies).min()
    return bool(level + np.minimum(bodies.sign[cluster.bodies], 0).sum() > 0)


def united_cluster(surface: Surface, bodies: Bodies, cluster: Cluster, even_odd: bool) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of what bodies that cross bound together; raises MeshError where that cannot be had."""
    if even_odd:
        raise MeshError("the even-odd rule is no union")
    if cluster.fault:
        raise MeshError(cluster.fault)
    members = cluster.bodies.tolist()
    place = {body: k for k, body in enumerate(members)}
    sign, level = bodies.sign[members], int(bodies.level(cluster.bodies).max())
    if level > 1 or (level == 1 and (sign > 0).any()):
        raise MeshError("solids and cavities cross inside a solid")
    rows = [bodies.rows[k] for k in members]
    used, index = np.unique(surface.faces[np.concatenate(rows)], return_inverse=True)
    parts = np.split(index.reshape(-1, 3), np.cumsum([len(own) for own in rows])[:-1])
    around = [{place[j] for j in bodies.around[k] if j in place} for k in members]
    united = unite(surface.vertices[used], parts, sign, around)
    check_union(surface.vertices[used], parts, level, united, surface.tolerance)
    return united


def finished(solid: Surface, sheets: np.ndarray, sheet_vertices: np.ndarray) -> Mended:
    """The solid and the open surfaces as one mesh, and what is to be said about the latter."""
    shift = len(solid.vertices)
    vertices, faces = weld(
        np.concatenate([solid.vertices, sheet_vertices]), np.concatenate([solid.faces, sheets + shift])
    )
    solid_count = len(solid.faces)
    report = solid.report
    if len(sheets):
        crossings = crossings_with(vertices, faces, solid_count)
        report = replace(report, crossings_found=report.crossings_found + crossings)
        report = with_sheets(report, vertices, faces[solid_count:], solid_count > 0, solid.tolerance)
    if len(faces) == 0:
        raise MeshError(
            f"the mesh encloses nothing: its {report.triangles} triangles are repeats, walls with a back or flat bodies"
        )
    return Mended(vertices, faces, solid_count, report)


def crossings_with(vertices: np.ndarray, faces: np.ndarray, solid_count: int) -> int:
    """Pairs of triangles that cross or overlap, of which one at least is of an open surface."""
    is_sheet = (np.arange(len(faces)) >= solid_count).astype(np.int64)
    found = count_crossings(vertices, faces, is_sheet, unwatched)
    return int(found.pair_count - found.of_body[0]) if solid_count else found.pair_count


def with_sheets(
    report: MeshReport, vertices: np.ndarray, sheets: np.ndarray, has_solid: bool, tolerance: float
) -> MeshReport:
    """The report with what is known of open surfaces."""
    twin = twins_of(sheets, vertices, tolerance)
    rim, _, number = rims_of(sheets, twin)
    lengths = rim_lengths(vertices, sheets, rim, number)
    bodies = int(body_labels(twin).max()) + 1 + (report.bodies if has_solid else 0)
    hint = closing_distance(vertices, sheets) if len(rim) else 0.0
    has_depth = not flat_bodies(vertices, sheets, body_labels(twin), tolerance).any()
    nothing = has_solid and report.crossed_edges == 0 and not encloses(vertices, sheets)
    return replace(
        report,
        bodies=bodies,
        open_edges=len(rim),
        holes=len(lengths),
        rim_longest=float(lengths.max(initial=0.0)),
        fill_closes=float(lengths.max(initial=0.0)) if has_depth else 0.0,
        weld_closes=hint,
        sheet_faces=len(sheets) if nothing else 0,
    )


def encloses(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether an open surface all but encloses something: its winding number somewhere just beside it."""
    rows = np.arange(len(faces))[:: max(1, len(faces) // ENCLOSURE_SAMPLES)]
    size = np.sqrt(areas_of(vertices, faces[rows])).max()
    triangles = vertices[faces]
    for distance in (1e-6 * size, -1e-6 * size):
        for point in points_behind(vertices, faces, rows, distance):
            if abs(winding_number(point, triangles)) > ENCLOSES:
                return True
    return False


def winding_number(point: np.ndarray, triangles: np.ndarray) -> float:
    """Solid angle of a surface seen from a point, in turns of the sphere (Van Oosterom and Strackee 1983)."""
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.einsum("ij,ij->i", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", x, y) for x, y in ((a, b), (b, c), (c, a)))
    return float(np.sum(np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb)) / (2.0 * np.pi))
