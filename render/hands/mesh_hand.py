"""A hand as a triangulated skin of which a region, the glabrous skin, feels; rigid, or with vertices for each pose."""

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import warp as wp

from ...datasets.counted import counted
from ...datasets.rigid import rotate
from ...kernels.skin.edges import SkinEdges, upload_skin
from ..device_copies import KeepsDeviceCopies
from ..errors import PoseError, StrategyError
from ..objects.isosurface import isosurface
from ..objects.solid import Solid
from ..validation import is_number
from .given_mesh import Glabrous, checked_hand, face_normals, facing_palm, placed_hand, read_hand, region_of
from .hand import PatchFrames, poses_text, rigid_poses

__all__ = ["MeshHand", "facing_palm"]

STEP_SMALLEST = 1e-4  # [m]; below, float32 hardly tells a triangle's corners apart at 1 m
ROWS = 256  # poses whose frames are worked out at a time


class MeshHand(KeepsDeviceCopies):
    """A triangulated skin in the hand's frame: +Y out of its back, -Z to the finger tips, origin on the palm's skin.

    vertices: [m], shape [vertex, 3] (rigid) or [pose, vertex, 3] (a row for each pose of the motion); faces: int, shape
    [face, 3], counter-clockwise seen from outside. glabrous: which faces curves are drawn on, bool, shape [face];
    None: all. step: longest edge of the triangles that curves are drawn on [m]; longer ones are halved. None: what the
    strategy says.

    Vertices in the same place become one; triangles that are none are dropped, with a warning (PalpateWarning), and a
    closed mesh that faces inwards is turned over. Raises MeshError for values that are not finite, an edge of more than
    two triangles, neighbours wound against each other, and a region without triangle or without boundary.

    >>> import trimesh
    >>> from palpate.render import MeshHand, render, static_pose
    >>> box = trimesh.creation.box((0.08, 0.03, 0.1))  # [m]; in place of a hand's skin
    >>> hand = MeshHand(box.vertices, box.faces, glabrous=box.face_normals[:, 1] < -0.9, name="box")
    >>> hand
    MeshHand('box', 12 triangles, rigid)
    >>> render("cube", hand, static_pose([0, 0, 0.2])).length().round(3)  # the outline of the side that feels [m]
    array([0.36], dtype=float32)
    """

    made_anew: ClassVar = {**KeepsDeviceCopies.made_anew, "_edges": dict, "_rest_on": dict}
    _edges: dict[float | None, SkinEdges]
    _on: dict[tuple[str, float | None], Any]
    _rest_on: dict[str, wp.array]

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        *,
        glabrous: np.ndarray | None = None,
        step: float | None = None,
        name: str = "hand",
    ) -> None:
        if step is not None and not (is_number(step) and STEP_SMALLEST <= step < np.inf):  # a NaN compares false
            raise StrategyError(f"{name}: step must be at least {STEP_SMALLEST:g} m, not {step!r}")
        self.name, self.step = name, None if step is None else float(step)
        surface = checked_hand(name, vertices, faces, glabrous)
        self._rigid = np.ndim(vertices) != 3
        self.vertices = surface.vertices
        """[m], float32, shape [row, vertex, 3]; one row for a rigid hand."""
        self.faces = surface.faces
        """int32, shape [face, 3]."""
        self.glabrous = surface.glabrous
        """Which faces feel, bool, shape [face]."""
        for array in surface:
            array.setflags(write=False)
        self.begin_copies()

    def __repr__(self) -> str:
        """One line."""
        return f"MeshHand({self.name!r}, {counted(len(self.faces), 'triangle')}, {poses_text(self.pose_count)})"

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        glabrous: Glabrous = "palm",
        palm_angle: float = 90.0,
        scale: float = 1.0,
        back: str | None = None,
        fingers: str | None = None,
        origin: str | Sequence[float] | None = None,
        step: float | None = None,
        name: str | None = None,
    ) -> "MeshHand":
        """A rigid hand from any mesh file (GLB, glTF, OBJ, OFF, PLY, STL), in its rest pose.

        glabrous: "palm" (faces whose normal makes less than `palm_angle` [degree] with the palm's, -Y), "all", a mask
        [face] of the file's faces in its order, a file of one (.npy, or text of 0 and 1), or a function of the faces'
        middles [m] and normals in the hand's frame, both [face, 3], that gives one.
        scale: 0.001 for a file in millimetres. back, fingers: the file's axes (x, y, z, -x, -y, -z) that point out of
        the back of the hand and to the finger tips; by default a WebXR hand's own (joint "wrist"), else y and -z.
        origin: the point that becomes the hand's origin [m], in the file's axes after scaling; "palm": the skin below
        the middle of the metacarpals; by default that for a WebXR hand, else the file's own origin.
        Raises MeshError for a file without a hand, PlacementError for a placement that cannot be applied.
        """
        path = Path(path)
        read = read_hand(path)
        vertices = placed_hand(read, scale=scale, back=back, fingers=fingers, origin=origin)
        region = region_of(vertices, read.faces, glabrous, palm_angle)
        return cls(vertices, read.faces, glabrous=region, step=step, name=name or path.name)

    @classmethod
    def from_solid(
        cls, solid: Solid, step: float, *, glabrous: Glabrous = "palm", palm_angle: float = 90.0, device: str = "cpu"
    ) -> "MeshHand":
        """A hand given as voxels or as an implicit function, in the hand's frame, meshed once in steps of `step` [m].

        glabrous, palm_angle: as for `load`; a mask cannot be known beforehand, a function can.
        """
        bounds = np.asarray(solid.bounds, np.float64)
        vertices, faces = isosurface(solid, bounds, step, device=device)
        region = region_of(vertices.astype(np.float64), faces, glabrous, palm_angle)
        return cls(vertices, faces, glabrous=region, name=solid.name)

    @property
    def patch_count(self) -> int:
        """1: all curves are of patch 0."""
        return 1

    @property
    def pose_count(self) -> int | None:
        """Rows of vertices; None for a rigid hand."""
        return None if self._rigid else len(self.vertices)

    @cached_property
    def identity(self) -> str:
        """SHA-256 over vertices, faces and the region."""
        digest = hashlib.sha256()
        for array in (self.vertices, self.faces, self.glabrous.astype(np.uint8)):
            digest.update(np.ascontiguousarray(array).tobytes() + b"/")
        return digest.hexdigest()

    def described(self) -> dict[str, Any]:
        """What a file says about the hand, for JSON."""
        text: dict[str, Any] = {
            "kind": "mesh",
            "name": self.name,
            "vertices": self.vertices.shape[1],
            "triangles": len(self.faces),
            "glabrous": int(self.glabrous.sum()),
            "step": self.step,
            "sha256": self.identity,
        }
        return text if self._rigid else {**text, "poses": len(self.vertices)}

    def arrays(self) -> dict[str, np.ndarray]:
        """`skin_vertices`, float32 [row * vertex, 3], `skin_faces`, int32 [face, 3], `skin_glabrous`, uint8 [face]."""
        return {
            "skin_vertices": self.vertices.reshape(-1, 3),
            "skin_faces": self.faces,
            "skin_glabrous": self.glabrous.astype(np.uint8),
        }

    @classmethod
    def from_file(cls, described: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> "MeshHand":
        """Read back what `described` and `arrays` gave; raises StrategyError where the one is not of the other."""
        vertices = np.asarray(arrays["skin_vertices"]).reshape(-1, int(described["vertices"]), 3)
        rows = vertices if "poses" in described else vertices[0]
        step, name = described.get("step"), str(described.get("name", "hand"))
        hand = cls(rows, arrays["skin_faces"], glabrous=arrays["skin_glabrous"], step=step, name=name)
        if hand.identity != described["sha256"]:
            raise StrategyError(f"{name}: the stored hand mesh is not the one described (SHA-256 differs)")
        return hand

    def edges_of(self, step: float | None = None) -> SkinEdges:
        """Topology of the glabrous region, refined to the hand's own step or, if it has none, this one [m].

        Raises StrategyError for a step that asks for too many triangles.
        """
        step = step if self.step is None else self.step
        with self._lock:
            if step not in self._edges:
                try:
                    self._edges[step] = SkinEdges(self.vertices, self.faces[self.glabrous], step=step)
                except ValueError as error:
                    raise StrategyError(f"{self.name}: {error}") from error
            return self._edges[step]

    def skin_on(self, device: str, step: float | None = None) -> Any:
        """The glabrous region on a Warp device, a Skin, refined as by `edges_of`; uploaded once."""
        step = step if self.step is None else self.step
        edges = self.edges_of(step)
        with self._lock:
            if (device, step) not in self._on:
                self._on[device, step] = upload_skin(edges, device)
            return self._on[device, step]

    def vertices_on(self, device: str, first: int = 0, stop: int | None = None) -> wp.array:
        """Vertices of the region, of rows first..stop, on a device: vec3 [m], hand frame, shape [1 or row, vertex].

        Those of a rigid hand are uploaded once. Raises PoseError for rows that the hand does not have.
        """
        used = self._used
        if self._rigid:
            with self._lock:
                if device not in self._rest_on:
                    self._rest_on[device] = wp.array(self.vertices[:, used], dtype=wp.vec3, device=device)
                return self._rest_on[device]
        first, stop = self._rows(first, len(self.vertices) - first if stop is None else stop - first)
        return wp.array(self.vertices[first:stop, used], dtype=wp.vec3, device=device)

    @cached_property
    def _used(self) -> np.ndarray:
        """Vertices of the region in the kernels' order: the same whatever the step."""
        return SkinEdges(self.vertices[:1], self.faces[self.glabrous]).used

    def _rows(self, first: int, count: int) -> tuple[int, int]:
        if self._rigid:
            return 0, 1
        if not 0 <= first <= first + count <= len(self.vertices):
            raise PoseError(f"the hand has vertices for {len(self.vertices)} poses, not for {first}..{first + count}")
        return first, first + count

    def section_poses(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """The hand's poses, float32, shape [pose, 1, 7]."""
        return rigid_poses(pose)

    @cached_property
    def palm_frames(self) -> PatchFrames:
        """The plane through the region, one patch, in the hand's frame: a row for each of the hand's.

        n is against the mean normal of the skin, v as near to the finger tips as that allows, the middle that of the
        region's extents; half extents are those of the largest row.
        """
        rows = [self._palm_of(self.vertices[k : k + ROWS]) for k in range(0, len(self.vertices), ROWS)]
        origin, u, v, n, half = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        return PatchFrames(origin[:, None], u[:, None], v[:, None], n[:, None], half.max(axis=0, keepdims=True))

    def _palm_of(self, vertices: np.ndarray) -> tuple[np.ndarray, ...]:
        region = self.faces[self.glabrous]
        normal = face_normals(vertices, region)
        mean = normal.sum(axis=1)
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        n = np.where(size > 1e-12, -mean / np.maximum(size, 1e-12), [0.0, 1.0, 0.0])
        v = np.array([0.0, 0.0, -1.0]) + n * n[:, 2:]
        flat = np.linalg.norm(v, axis=1, keepdims=True) < 1e-3  # the skin faces the finger tips
        v = np.where(flat, np.array([0.0, 1.0, 0.0]) - n * n[:, 1:2], v)
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        u = np.cross(v, n)
        points = vertices[:, np.unique(region)].astype(np.float64)
        along = [np.einsum("rvk,rk->rv", points, axis) for axis in (u, v)]
        middle = [(x.max(axis=1) + x.min(axis=1)) / 2 for x in along]
        half = np.stack([np.ptp(x, axis=1) / 2 for x in along], axis=1)
        weight = np.linalg.norm(normal, axis=2)
        weight = np.where(weight.sum(axis=1, keepdims=True) > 0.0, weight, 1.0)  # a row may be folded flat
        centre = np.einsum("rfk,rf->rk", vertices[:, region].astype(np.float64).mean(axis=2), weight)
        depth = np.einsum("rk,rk->r", centre / weight.sum(axis=1, keepdims=True), n)
        return middle[0][:, None] * u + middle[1][:, None] * v + depth[:, None] * n, u, v, n, half

    def frames(self, pose: np.ndarray, first: int = 0) -> PatchFrames:
        """The palm's plane at poses, one patch: pose [n, 7], rows `first`.. of the motion."""
        pose = np.atleast_2d(np.asarray(pose, np.float64))
        start, stop = self._rows(first, len(pose))
        rest = self.palm_frames
        q = pose[:, None, 3:] / np.linalg.norm(pose[:, None, 3:], axis=-1, keepdims=True)
        origin, u, v, n = (rotate(q, x[start:stop]) for x in rest[:4])
        return PatchFrames(pose[:, None, :3] + origin, u, v, n, rest.half)

    def corners(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Corners of the palm's plane [m], array frame, shape [n, 1, 4, 3]."""
        return self.frames(pose, first).corners()

    def triangles(self, pose: np.ndarray, first: int = 0) -> np.ndarray:
        """Triangles of the skin that curves are drawn on [m], array frame, shape [n, triangle, 3, 3]."""
        pose = np.atleast_2d(np.asarray(pose, np.float64))
        start, stop = self._rows(first, len(pose))
        rows = np.broadcast_to(self.vertices[start:stop], (len(pose), *self.vertices.shape[1:])).astype(np.float64)
        placed = pose[:, None, :3] + rotate(pose[:, None, 3:], rows)
        return placed[:, self.faces[self.glabrous]]
