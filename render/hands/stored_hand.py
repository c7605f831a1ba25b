"""Hands of files: read back, and how they look at a pose: the skin that was rendered, a whole hand around it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...datasets.contour_file.pose_rows import hand_at
from ...datasets.contour_file.reader import ContourFile
from ...datasets.hand_model.cage import BREADTH, LENGTH
from ...datasets.hand_model.shape import BREADTHS, LENGTHS, HandShape, hand_shape
from ...datasets.rigid import rotate, unit
from ..errors import RenderError, StrategyError
from .hand import Hand, Palm
from .mesh_hand import MeshHand
from .plane_hand import PlaneHand

DETAIL = 1  # triangles of the hand around a palm: 1,312


@dataclass(frozen=True, eq=False)
class HandLook:
    """Skin of one pose [m], array frame."""

    patches: np.ndarray
    """Corners of the planes of skin, float32, shape [patch, 4, 3]; none for a hand mesh."""
    vertices: np.ndarray
    """Of the hand's mesh, or of a whole hand around the patches; float32, shape [vertex, 3]."""
    is_rendered: bool
    """The mesh is the skin that was rendered; False: it only shows where the hand of the patches is."""


class HandLooks:
    """The look of a file's hand at any pose; only the rows of that pose are read.

    A palm and rigid planes get palpate's own flat hand around them, as broad as the palm is. Articulated planes get
    none, as the file does not have their joints.
    """

    def __init__(self, file: ContourFile) -> None:
        self._file = file
        self._articulated = "poses" in file.hand
        described, arrays = hand_at(file, 0)
        self._is_mesh = described.get("kind") == "mesh"
        self._rigid = None if self._articulated or self._is_mesh else hand_from(file.hand, file.hand_arrays())
        self._rest = np.zeros((0, 3), np.float32)
        self.faces: np.ndarray = np.zeros((0, 3), np.int32)
        """Triangles of `HandLook.vertices`, int32, shape [face, 3]."""
        self.glabrous: np.ndarray = np.zeros(0, bool)
        """Which of them feel, bool, shape [face]."""
        if self._is_mesh:
            self._rest = arrays["skin_vertices"]
            self.faces, self.glabrous = arrays["skin_faces"], arrays["skin_glabrous"] > 0
        elif self._rigid is not None:
            rigid, patches = self._rigid, getattr(self._rigid, "patches", ())
            palm = rigid if isinstance(rigid, Palm) else next((p for p in patches if p.name == "palm"), None)
            shape = hand_around(BREADTH if palm is None else palm.width)
            self._rest, self.faces, self.glabrous = shape.vertices, shape.faces, shape.glabrous

    @property
    def is_rigid(self) -> bool:
        """The hand has the same shape at all poses: its look at one pose, moved, is that at any other."""
        return not self._articulated

    def at(self, index: int, pose: np.ndarray) -> HandLook:
        """The hand at a pose of the file: index, and position [m] with quaternion xyzw, shape [7]."""
        pose = np.asarray(pose, np.float64)
        if self._rigid is not None:
            return HandLook(_present(self._rigid.corners(pose[None])[0]), _placed(self._rest, pose), False)
        described, arrays = hand_at(self._file, index)
        if self._is_mesh:
            return HandLook(np.zeros((0, 4, 3), np.float32), _placed(arrays["skin_vertices"], pose), True)
        rows = arrays["patch_pose"].reshape(1, -1, 7)
        rest = PlaneHand.from_file({name: value for name, value in described.items() if name != "poses"}, {})
        corners = PlaneHand(rest.patches, (), rows).corners(pose[None])[0]
        return HandLook(_present(corners), np.zeros((0, 3), np.float32), False)


def _present(corners: np.ndarray) -> np.ndarray:
    return corners[np.isfinite(corners).all(axis=(1, 2))].astype(np.float32)


def _placed(vertices: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return (pose[:3] + rotate(unit(pose[3:]), vertices.astype(np.float64))).astype(np.float32)


def hand_around(width: float, detail: int = DETAIL) -> HandShape:
    """palpate's own right hand, as broad as a palm is wide [m], or as the nearest breadth that a hand can have."""
    breadth = min(max(width, BREADTHS[0]), BREADTHS[1])
    return hand_shape(breadth=breadth, length=min(LENGTH * breadth / BREADTH, LENGTHS[1]), detail=detail)


def hand_from(described: Mapping[str, Any], arrays: Mapping[str, np.ndarray] | None = None) -> Hand:
    """The hand that a file describes; arrays: those of its /hand by name.

    Raises StrategyError for a kind that this version does not know, and for a description that lacks a field.
    """
    if not isinstance(described, Mapping):
        raise StrategyError(f"the description of a hand must be a mapping, not {described!r:.60}")
    kind, arrays = described.get("kind"), arrays or {}
    try:
        if kind == "palm":
            return Palm(float(described["width"]), float(described["length"]))
        if kind == "planes":
            return PlaneHand.from_file(described, arrays)
        if kind == "mesh":
            return MeshHand.from_file(described, arrays)
    except KeyError as error:
        raise StrategyError(f"the description of a hand of kind {kind!r} lacks {error.args[0]!r}") from None
    except RenderError:
        raise
    except (TypeError, ValueError, AttributeError) as error:  # something of another type, or of another shape
        raise StrategyError(f"the description of a hand of kind {kind!r} cannot be read: {error}") from error
    raise StrategyError(f"unknown hand {kind!r}; known: palm, planes, mesh")
