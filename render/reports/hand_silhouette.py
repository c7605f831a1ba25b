"""A hand in a picture: palpate's own around a palm, or the mesh that was rendered, as an outline with its folds."""

from typing import NamedTuple

import numpy as np

from ...datasets.rigid import rotate
from ..hands.hand import Hand, Palm
from ..hands.mesh_hand import MeshHand
from ..hands.stored_hand import hand_around
from .scene_view import flat

DETAIL = 2  # of palpate's own hand: 5,248 triangles; its outline takes 30 ms
SMALLEST = 1e-6  # [mm²] of a triangle that is seen; smaller ones are edge on


class Silhouette(NamedTuple):
    """A hand as it is seen."""

    outline: list[np.ndarray]
    """Closed outlines [mm], each of shape [point, 2]; holes run the other way round."""
    folds: np.ndarray
    """Edges between a triangle that faces the eye and one that does not [mm], shape [edge, 2, 2]."""


def hand_surface(hand: Hand, pose: np.ndarray, row: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Vertices [m], array frame, and faces of a hand at a pose, shape [7]; None for a hand of several planes.

    A palm gets palpate's own right hand, as broad as the palm is wide. row: of the motion.
    """
    if isinstance(hand, MeshHand):
        vertices, faces = hand.vertices[0 if hand.pose_count is None else row], hand.faces
    elif isinstance(hand, Palm):
        shape = hand_around(round(hand.width, 4), DETAIL)
        vertices, faces = shape.vertices, shape.faces
    else:
        return None
    pose = np.asarray(pose, np.float64)
    return pose[:3] + rotate(pose[3:], np.asarray(vertices, np.float64)), faces


def silhouette(vertices: np.ndarray, faces: np.ndarray, basis: np.ndarray) -> Silhouette:
    """Outline and folds of a surface [m] in a view's plane."""
    from manifold3d import CrossSection, FillRule

    seen = flat(vertices, basis)[faces]
    area = doubled_area(seen)
    facing = area > 0
    wound = np.where(facing[:, None, None], seen, seen[:, ::-1])
    filled = CrossSection(list(wound[np.abs(area) > SMALLEST]), FillRule.Positive).simplify(0.05)
    return Silhouette([np.asarray(loop) for loop in filled.to_polygons()], _folds(vertices, faces, facing, basis))


def doubled_area(triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area of flat triangles, shape [triangle, 3, 2]: above 0 where they face the eye."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _folds(vertices: np.ndarray, faces: np.ndarray, facing: np.ndarray, basis: np.ndarray) -> np.ndarray:
    edges = np.sort(np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    front = np.tile(facing, 3)
    order = np.lexsort(edges.T)
    edges, front = edges[order], front[order]
    same = (edges[1:] == edges[:-1]).all(axis=1) & (front[1:] != front[:-1])
    return flat(vertices, basis)[edges[1:][same]]
