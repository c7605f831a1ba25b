"""The same solids as meshes, voxels and functions; the same rectangle as a palm, several patches and a skin."""

from functools import cache

import numpy as np
import shapely
import trimesh
from expression_oracle import value as oracle_value

from palpate.render import MeshObject, Palm
from palpate.render.contour_batch import ContourBatch
from palpate.render.objects.functions.expression import box, capsule, cylinder, sphere
from palpate.render.objects.functions.implicit_object import ImplicitObject
from palpate.render.objects.isosurface import isosurface
from palpate.render.objects.voxels.voxeliser import voxelise

MIDDLE = (0.0, 0.0, 0.2)
SOLIDS = ("cube", "sphere", "tube", "dog")
STEP = 0.0005
"""Of the grid on the skin [m]."""
SPACING = 0.0006
"""Of signed distances [m]."""
SPACING_BINARY = 0.0006
"""Of voxels that are 0 or 1 [m]."""


def expression_of(name):
    if name == "cube":
        return box(0.09, 0.09, 0.09).moved(*MIDDLE)
    if name == "sphere":
        return sphere(0.06).moved(*MIDDLE)
    if name == "tube":
        return (cylinder(0.06, 0.13) - cylinder(0.035, 0.2)).moved(*MIDDLE)
    trunk = capsule((-0.035, 0, 0.012), (0.035, 0, 0.008), 0.02)
    dog = trunk.blended(capsule((-0.035, 0, 0.012), (-0.055, 0, 0.04), 0.014), 0.012)
    dog = dog.blended(sphere(0.018).moved(-0.058, 0, 0.046), 0.006)
    for x in (-0.033, 0.033):
        for y in (-0.012, 0.012):
            dog = dog.blended(capsule((x, y, 0), (x, y, -0.045), 0.009), 0.006)
    return dog.moved(*MIDDLE)


@cache
def mesh_of(name):
    """So fine that it is within 0.06 mm of the expression."""
    if name == "cube":
        mesh = trimesh.creation.box((0.09, 0.09, 0.09))
    elif name == "sphere":
        mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.06)
    elif name == "tube":
        mesh = trimesh.creation.annulus(r_min=0.035, r_max=0.06, height=0.13, sections=400)
    else:
        dog = ImplicitObject(expression_of(name))
        return MeshObject(*isosurface(dog, dog.bounds, 0.00125), name=name)
    return MeshObject(mesh.vertices + MIDDLE, mesh.faces, name=name)


@cache
def solid_of(representation, name):
    if representation == "mesh":
        return mesh_of(name)
    if representation == "implicit":
        return ImplicitObject(expression_of(name), name=name)
    if representation == "binary":
        return voxelise(mesh_of(name), spacing=SPACING_BINARY, kind="occupancy")
    return voxelise(mesh_of(name), spacing=SPACING, kind="distance", band=4 * SPACING)


def in_patch(points, pose):
    """Points in the frame of a palm: u = X, v = -Z of the hand [m], shape [point, 2], and n, shape [point]."""
    turn = trimesh.transformations.quaternion_matrix(np.roll(pose[3:].astype(np.float64), 1))[:3, :3]
    local = (points.astype(np.float64) - pose[:3].astype(np.float64)) @ turn
    return np.stack([local[:, 0], -local[:, 2]], axis=1), local[:, 1]


def region_of(batch: ContourBatch, pose, row, patch=0):
    """The region that closed contours of a patch bound, by orientation: the inside lies to the left; and its rings."""
    lines = range(batch.pose_start[row], batch.pose_start[row + 1])
    rings = []
    for i in lines:
        if batch.polyline_patch[i] == patch:
            points = batch.points[batch.polyline_start[i] : batch.polyline_start[i + 1]]
            rings.append(in_patch(points, pose)[0])
    area = sum(signed_area(ring) for ring in rings)
    lines = [shapely.LineString(ring) for ring in rings]
    return (shapely.build_area(shapely.MultiLineString(lines)) if lines else shapely.Polygon()), rings, area


def signed_area(ring):
    x, y = ring[:, 0], ring[:, 1]
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def opened(region, step):
    """Region and surroundings without features smaller than 4 steps, and whether they are as many as before."""
    around = shapely.box(*region.bounds).buffer(10 * step).difference(region)
    kept = [part.buffer(-2 * step).buffer(2 * step) for part in (region, around)]
    return kept, all(parts_of(k) == parts_of(part) for k, part in zip(kept, (region, around), strict=True))


def parts_of(region):
    pieces = [piece for piece in getattr(region, "geoms", [region]) if not piece.is_empty]
    return len(pieces), sum(len(piece.interiors) for piece in pieces)


def dense_points(line, spacing):
    """Points along a boundary no farther apart than a spacing, and whether a corner of it is near."""
    return shapely.get_coordinates(shapely.segmentize(line, spacing))


def corners_of(region, degrees=25.0):
    """Vertices of the boundary at which it turns by more than some degrees."""
    corners = []
    for piece in getattr(region, "geoms", [region]):
        for ring in (piece.exterior, *piece.interiors):
            x = shapely.get_coordinates(shapely.simplify(ring, 1e-5))[:-1]
            before, after = x - np.roll(x, 1, axis=0), np.roll(x, -1, axis=0) - x
            cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            turn = np.degrees(np.abs(np.arctan2(cross, (before * after).sum(axis=1))))
            corners.append(x[turn > degrees])
    return shapely.MultiPoint(np.concatenate(corners)) if corners else shapely.MultiPoint()


def grazing(points, pose, name, degrees):
    """Whether the surface meets the palm's plane at less than some degrees at points of it, bool, shape [point]."""
    turn = trimesh.transformations.quaternion_matrix(np.roll(pose[3:].astype(np.float64), 1))[:3, :3]
    at = pose[:3] + np.stack([points[:, 0], 0 * points[:, 0], -points[:, 1]], axis=1) @ turn.T
    expression, gap = expression_of(name), 3e-4 * turn[:, 1]
    along = (oracle_value(expression, at + gap) - oracle_value(expression, at - gap)) / 6e-4
    return np.abs(along) > np.cos(np.radians(degrees))


def worst_deviations(region, exact, kept, step, *, left_out=None):
    """Two-sided distance between two regions' boundaries [m]: where the exact one is smooth, and near its corners.

    kept: of `opened`; corners so sharp that their tip is thinner than 4 steps over more than 1.5 are left out, and
    points where `left_out` (points [m], shape [point, 2]) says so.
    """
    corners = corners_of(exact)
    smooth = near = 0.0
    for one, other in ((region, exact), (exact, region)):
        places = dense_points(one.boundary, step / 4)
        if left_out is not None:
            places = places[~left_out(places)]
        points = shapely.points(places)
        tip = np.max([shapely.distance(points, part) for part in kept], axis=0) > 1.5 * step
        distance = np.where(tip, 0.0, shapely.distance(points, other.boundary))
        cornered = np.zeros(len(points), bool)
        if not corners.is_empty:
            cornered = shapely.distance(points, corners) < 2 * step
        smooth = max(smooth, float(distance[~cornered].max(initial=0.0)))
        near = max(near, float(distance[cornered].max(initial=0.0)))
    return smooth, near


def palm() -> Palm:
    return Palm(0.085, 0.085)
