"""Closed meshes that cross or touch themselves, and the solid that they bound, worked out apart from the product."""

from dataclasses import replace

import numpy as np
import shapely
from mesh_cases import MIDDLE, merged, placed
from section_oracle import in_palm, section_links, walk

from palpate.render import MeshObject

GRID = 1e-10  # [m]; of GEOS's rounding
CUBE_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
CUBE_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def crossing(mesh, solid="winding", *, crossings=1):
    """An object of exactly these triangles, with so many crossings counted: nothing is mended, united or looked for."""
    thing = MeshObject.load("cube")
    thing.name, thing.solid = "crossing", solid
    thing.vertices, thing.faces = np.asarray(mesh[0], np.float32), np.asarray(mesh[1], np.int32)
    thing.report = replace(thing.report, crossings=crossings)
    return thing


def block(low, high):
    """A box between two corners [m], seen from MIDDLE."""
    return placed(MIDDLE + np.asarray(low) + CUBE_CORNERS * (np.asarray(high) - low), CUBE_FACES)


def prism(outline, height=0.1):
    """Walls over a closed outline [m], which may cross itself, with a fan below and one above."""
    n, low, high = len(outline), -height / 2, height / 2
    k = np.arange(n)
    after, foot, top = (k + 1) % n, np.full(n, 2 * n), np.full(n, 2 * n + 1)
    rim = [np.column_stack([outline, np.full(n, z)]) for z in (low, high)]
    faces = [[k, after, n + after], [k, n + after, n + k], [after, k, foot], [n + k, n + after, top]]
    vertices = np.concatenate([*rim, [[0, 0, low], [0, 0, high]]])
    return placed(vertices + MIDDLE, np.concatenate([np.stack(f, axis=1) for f in faces]))


def limacon(count=128):
    """r = 0.02 + 0.01 cos(t / 2) m, which goes around twice."""
    t = np.arange(count) * 4 * np.pi / count
    return (0.02 + 0.01 * np.cos(t / 2))[:, None] * np.stack([np.cos(t), np.sin(t)], axis=1)


def figure_eight(count=128):
    """One lobe winds backwards; no vertex lies where the outline crosses itself."""
    t = (np.arange(count) + 0.3) * 2 * np.pi / count
    return np.stack([0.04 * np.sin(t), 0.03 * np.sin(2 * t)], axis=1)


def pentagram():
    """Its middle is gone around twice."""
    angle = np.arange(5) * 4 * np.pi / 5
    return 0.04 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def zigzag(count=14, seed=1):
    """Random corners, joined in their order."""
    return np.random.default_rng(seed).uniform(-0.045, 0.045, (count, 2))


PRISMS = {
    "limacon": lambda: prism(limacon()),
    "figure eight": lambda: prism(figure_eight()),
    "pentagram": lambda: prism(pentagram()),
    "zigzag": lambda: prism(zigzag()),
}


def overlapping_blocks():
    """Two boxes as one mesh, and each of them."""
    parts = [block([-0.03, -0.02, -0.02], [0.01, 0.02, 0.03]), block([-0.01, -0.03, -0.025], [0.03, 0.01, 0.02])]
    return merged(*parts), parts


def winding_around(loops, point):
    """How often closed polygons go around a point that none of them passes, by angles."""
    turned = 0.0
    for loop in loops:
        a, b = loop - point, np.roll(loop, -1, axis=0) - point
        turned += np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum()
    return round(turned / (2 * np.pi))


def region_of(loops, solid="winding"):
    """What is inside of closed polygons: GEOS takes their lines apart, and each face's winding number is counted.

    On a grid: GEOS loses faces between lines that all but coincide if it does not round (a fifth of one pentagram).
    """
    loops = [loop for loop in loops if len(loop) > 2]
    if not loops:
        return shapely.Polygon()
    lines = shapely.unary_union([shapely.LineString(np.vstack([loop, loop[:1]])) for loop in loops], grid_size=GRID)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    number = [winding_around(loops, shapely.get_coordinates(face.representative_point())[0]) for face in faces]
    inside = [n > 0 if solid == "winding" else n % 2 == 1 for n in number]
    return shapely.unary_union(faces[np.array(inside, bool)]) if any(inside) else shapely.Polygon()


def section_region(mesh, pose, solid="winding"):
    """The section of a mesh, whose edges have two faces each, by a palm's plane, in the palm's u and v [m]."""
    point, after = section_links(*mesh, pose)
    return region_of([np.array([point[edge] for edge in chain]) for chain, _ in walk(after)], solid)


def segments_of(mesh, pose):
    """Where a palm's plane cuts each triangle, from where its border goes down to where it comes up [m], [n, 2, 2].

    Segments need not be chained, so edges may have any number of faces.
    """
    vertices, faces = mesh
    x = in_palm(vertices, pose)[np.asarray(faces)]
    y = np.roll(x, -1, axis=1)
    share = x[..., 2] / np.where(x[..., 2] == y[..., 2], 1.0, x[..., 2] - y[..., 2])
    place = x[..., :2] + share[..., None] * (y - x)[..., :2]
    above, next_above = x[..., 2] >= 0, y[..., 2] >= 0
    cut = above.any(axis=1) & ~above.all(axis=1)
    down, up = (above & ~next_above).argmax(axis=1), (~above & next_above).argmax(axis=1)
    row = np.flatnonzero(cut)
    return np.stack([place[row, down[row]], place[row, up[row]]], axis=1)


def region_within(segments):
    """What the winding number of oriented segments says is inside, as `region_of`."""
    lines = shapely.unary_union(shapely.linestrings(segments), grid_size=GRID)
    faces = shapely.get_parts(shapely.polygonize([lines]))
    inside = []
    for face in faces:
        a, b = np.swapaxes(segments - shapely.get_coordinates(face.representative_point())[0], 0, 1)
        turned = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)).sum()
        inside.append(round(turned / (2 * np.pi)) > 0)
    return shapely.unary_union(faces[np.array(inside, bool)]) if any(inside) else shapely.Polygon()


def lengths_in(region, half):
    """Lengths of OC and CC, and the area, of a region in a palm [m, m, m^2]."""
    if region.is_empty:
        return 0.0, 0.0, 0.0
    box = shapely.box(-half[0], -half[1], half[0], half[1])
    shared = region.intersection(box)
    outline = shapely.difference(region.boundary.intersection(box), box.boundary)
    return float(outline.length), float(shared.boundary.length if shared.area else 0.0), float(shared.area)
