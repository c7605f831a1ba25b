"""Solid: the interface of all objects, meshes, voxels and functions alike."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from ...kernels.fields.field import Field


@runtime_checkable
class Solid(Protocol):
    """An object to render: MeshObject, VoxelObject, ImplicitObject."""

    name: str

    @property
    def bounds(self) -> np.ndarray:
        """A box around the surface, lowest and highest coordinates [m], array frame, float64, shape [2, 3]."""
        ...

    def require_closed(self) -> None:
        """Raise MeshError, with the counts and the ways out, unless inside and outside are defined."""
        ...

    def field_on(self, device: str) -> Field:
        """The solid as a field on a Warp device, uploaded once."""
        ...

    def outline_mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Surface mesh for pictures and distances: vertices [m], float32 [vertex, 3]; faces, int32 [face, 3]."""
        ...

    def described(self) -> dict[str, Any]:
        """Description that a file stores as JSON: name, placement, `hash` of all that determines the surface, ..."""
        ...
