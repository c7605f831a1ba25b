"""The project's own hand: a triangulated skin around 26 joints, of any breadth and length, left or right.

It is built, not scanned: a cage of quads around the joints (`hand_cage`), smoothed by subdivision (`quads`). Positions
and skinning weights are smoothed alike, so each vertex follows the joints around it (`posed_vertices`).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..errors import ShapeError
from .cage import BREADTH, LENGTH, hand_cage
from .frames import joint_orientations
from .joints import FINGERS, JOINT_NAMES, Joint
from .quads import subdivide, triangulate

Array = TypeVar("Array", bound=NDArray[Any])

BREADTHS, LENGTHS = (0.05, 0.12), (0.1, 0.26)  # [m] a child's to the largest
DETAILS = (1, 2, 3)
"""How often the cage is subdivided: 1,312, 5,248 and 20,992 triangles."""
INFLUENCES = 4
"""Joints that move a vertex, at most."""


@dataclass(frozen=True, eq=False)
class HandShape:
    """A hand's skin in its rest pose (flat, open, fingers a little spread), hand frame; arrays are read-only.

    One oriented surface without holes but for the wrist, where it is open.

    >>> from palpate.datasets import hand_shape
    >>> skin = hand_shape(detail=1)
    >>> skin.faces.shape, skin.joint_pose.shape, skin.joint_names[:2]
    ((1312, 3), (26, 7), ('palm', 'wrist'))
    """

    vertices: NDArray[np.float32]
    """[m], shape [vertex, 3]."""
    faces: NDArray[np.int32]
    """Counter-clockwise from outside, shape [face, 3]."""
    glabrous: NDArray[np.bool_]
    """The palm's side of palm, fingers and thumb, shape [face]: one region, without holes."""
    joint_pose: NDArray[np.float64]
    """Of the joints at rest, hand frame [m] and quaternion xyzw, shape [26, 7]."""
    joint_radius: NDArray[np.float64]
    """[m], shape [26]."""
    weight_joint: NDArray[np.int32]
    """Joints that move each vertex, shape [vertex, 4]."""
    weight: NDArray[np.float32]
    """How far they do, largest first, summing to 1; shape [vertex, 4]."""
    is_left: bool

    def __repr__(self) -> str:
        """One line."""
        return f"HandShape({len(self.vertices)} vertices, {len(self.faces)} triangles)"

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, OpenXR's."""
        return JOINT_NAMES


def hand_shape(
    *, breadth: float = BREADTH, length: float = LENGTH, is_left: bool = False, detail: int = 2
) -> HandShape:
    """Make the skin of a hand of a given size.

    breadth [m]: of the palm at the knuckles without the thumb, 0.05 to 0.12. length [m]: from the wrist's joint to the
    skin of the middle finger's tip, 0.1 to 0.26. detail: 1 (1,312 triangles), 2 (5,248) or 3 (20,992). Raises
    ShapeError for sizes that are no hand's.

    >>> from palpate.datasets import hand_shape
    >>> hand_shape(breadth=0.08, length=0.18, detail=1)
    HandShape(667 vertices, 1312 triangles)
    """
    for name, value, (least, most) in (("breadth", breadth, BREADTHS), ("length", length, LENGTHS)):
        if not (math.isfinite(value) and least <= value <= most):
            raise ShapeError(f"a hand's {name} must be {least:g} to {most:g} m, got {value!r}")
    if detail not in DETAILS:
        raise ShapeError(f"detail must be one of {DETAILS}, got {detail!r}")
    return _shape(float(breadth), float(length), bool(is_left), int(detail))


@lru_cache(maxsize=8)
def _shape(breadth: float, length: float, is_left: bool, detail: int) -> HandShape:
    cage = hand_cage()
    values = np.concatenate([cage.position, cage.palmar[:, None], cage.weight], axis=1)
    quads = cage.quads
    for _ in range(detail):
        values, quads = subdivide(values, quads)
    position, palmar, dense = values[:, :3], values[:, 3], values[:, 4:]
    palm = np.isin(np.argmax(dense, axis=1), [finger[0] for finger in FINGERS])  # what metacarpals move most
    across = breadth / float(np.ptp(position[palm, 0]))
    scale = np.array([across, across, length / (cage.joint_position[Joint.WRIST, 2] - position[:, 2].min())])
    glabrous = np.repeat(palmar[quads].mean(axis=1) > 0.5, 2)
    faces, joints = triangulate(quads), cage.joint_position * scale
    mirror = np.array([-1.0 if is_left else 1.0, 1.0, 1.0])
    if is_left:
        faces = faces[:, ::-1]
    joints = joints * mirror
    turned = joint_orientations(joints[None], np.eye(3)[None], is_left=is_left)[0]
    weight_joint = np.argsort(-dense, axis=1, kind="stable")[:, :INFLUENCES]
    weight = np.take_along_axis(dense, weight_joint, axis=1)
    weight = (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)
    return HandShape(
        vertices=_freeze((position * scale * mirror).astype(np.float32)),
        faces=_freeze(np.ascontiguousarray(faces, dtype=np.int32)),
        glabrous=_freeze(glabrous),
        joint_pose=_freeze(np.concatenate([joints, turned], axis=1)),
        joint_radius=_freeze(cage.joint_radius * across),
        weight_joint=_freeze(weight_joint.astype(np.int32)),
        weight=_freeze(weight),
        is_left=is_left,
    )


def _freeze(array: Array) -> Array:
    array.setflags(write=False)
    return array
