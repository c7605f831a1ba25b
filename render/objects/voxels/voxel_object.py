"""Objects given as voxels: occupancy, signed distance, intensity or labels on a grid of any spacing and orientation."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import warp as wp

from ....kernels.fields.bricked_grid import bricked_field, pad_outside
from ....kernels.fields.field import Field
from ...device_copies import KeepsDeviceCopies
from ...errors import VoxelError
from ...user_warnings import warn_user
from ...validation import value_text
from ..mesh.files import IMAGE_HINT
from ..mesh.placement import Placement, PlacementFields, place_text, placement_of, warn_of_place
from ..mesh.solid_mesh import POOL_KEPT
from .files import WrittenVolume, read_volume, write_volume
from .grid import (
    affine_of,
    applied,
    box_around,
    check_inside,
    crossing_points,
    placed_affine,
    rule_of,
    signed_values,
    values_of,
)


class VoxelObject(KeepsDeviceCopies):
    """A solid given by values on a grid, trilinear between voxel centres.

    values: bool, integer or float, shape [i, j, k]; what they mean say `kind`, `level`, `label` and `inside`
    (`VoxelRule`). kind None: "label" if a label is given, "intensity" if a level is, "occupancy" for values of 0 and 1.
    spacing: between voxel centres [m], one or three; origin: centre of voxel [0, 0, 0] [m]; direction: its columns are
    where i, j and k point; or affine: from indices to coordinates [m], shape [4, 4], mirrored and sheared ones too.
    label: one or several labels of a segmented volume. smooth: blur of occupancy and labels [m].
    placement, or its fields: as for meshes, about the surface's box; it moves the grid, nothing is resampled.
    hand: it is one, in the hand frame, so it may lie about the origin.

    A solid that reaches the volume's border is closed half a voxel beyond it, with a PalpateWarning.
    Raises VoxelError for what is no volume, and for one with nothing or everything inside.

    >>> import numpy as np
    >>> from palpate.render import VoxelObject
    >>> values = np.zeros((30, 30, 30), bool)
    >>> values[5:25, 5:25, 5:25] = True  # 20 voxels along each side
    >>> VoxelObject(values, spacing=0.005, name="block", at=(0, 0, 0.2))
    VoxelObject('block', 8000 voxels inside, 100 x 100 x 100 mm at (0, 0, 0.2) m)
    """

    _fields: dict[str, Field]

    def __init__(
        self,
        values: np.ndarray,
        *,
        spacing: float | Sequence[float] | None = None,
        origin: Sequence[float] | None = None,
        direction: np.ndarray | None = None,
        affine: np.ndarray | None = None,
        kind: str | None = None,
        level: float | None = None,
        label: int | Sequence[int] | None = None,
        inside: str | None = None,
        smooth: float = 0.0,
        placement: Placement | None = None,
        name: str = "voxels",
        source: Mapping[str, Any] | None = None,
        hand: bool = False,
        **place: Unpack[PlacementFields],
    ) -> None:
        self.name = name
        self.source = dict(source or {})
        """What the voxels were made from, for JSON; empty if they were given."""
        self.placement = placement_of(placement, **place)
        if hasattr(values, "dimensions") and hasattr(values, "spacing"):
            raise VoxelError(f"{value_text(values)} is no array: {IMAGE_HINT}")
        values = values_of(values)
        if spacing is None and affine is None and self.placement.fit is None:
            raise VoxelError("spacing must be given [m], or affine, or a placement with fit")
        self.rule = rule_of(values, kind, level=level, label=label, inside=inside, smooth=smooth)
        grid = affine_of(spacing, origin, direction, affine)
        signed = signed_values(values, self.rule, grid)
        self.inside_count = int(np.count_nonzero(signed < 0))
        """Voxels inside."""
        check_inside(values, self.inside_count, self.rule)
        self._padded = pad_outside(signed)
        self._padded.flags.writeable = False
        points = crossing_points(self._padded)
        self.affine = placed_affine(grid, self.placement, points)
        """Indices to the array's frame [m], as placed, float64, shape [4, 4]."""
        self.bounds = box_around(self.affine, points)
        """Lowest and highest coordinates of the surface [m], array frame, float64, shape [2, 3]."""
        self.begin_copies()
        self._check_border()
        self._check_place(hand)

    def __repr__(self) -> str:
        """One line."""
        return f"VoxelObject({self.name!r}, {self.inside_count} voxels inside, {place_text(self.bounds)})"

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        unit: str | None = None,
        kind: str | None = None,
        level: float | None = None,
        label: int | Sequence[int] | None = None,
        inside: str | None = None,
        spacing: float | Sequence[float] | None = None,
        smooth: float = 0.0,
        placement: Placement | None = None,
        name: str | None = None,
        hand: bool = False,
        **place: Unpack[PlacementFields],
    ) -> "VoxelObject":
        """Load .npy, .npz, .nrrd, .nhdr, .nii, .nii.gz or .nvdb; docs/guide/voxels.md says what each holds.

        unit: of the file's lengths, "m", "cm", "mm" or "um"; None: as the file says, else mm for NRRD and NIfTI, m for
        the others. spacing: [m], instead of the file's (its origin and directions are then left out, so a unit has no
        meaning). The others: see VoxelObject; what is not given is taken from the file.
        Raises VoxelError, with the path, for a file that cannot be read and for what VoxelObject refuses.
        """
        if not isinstance(path, str | Path):
            raise VoxelError(f"a volume's path must be text or a Path, not {value_text(path)}")
        path = Path(path)
        try:
            if spacing is not None and unit is not None:
                raise VoxelError(
                    f"spacing is in metres: give it or unit, not both ({value_text(spacing)}, {value_text(unit)})"
                )
            volume = read_volume(path, unit)
            if kind is None and label is None:
                kind = volume.kind
            if level is None and kind == volume.kind:
                level = volume.level
            return cls(
                volume.values,
                affine=volume.affine if spacing is None else None,
                spacing=spacing,
                kind=kind,
                level=level,
                label=label,
                inside=inside,
                smooth=smooth,
                placement=placement_of(placement, **place),
                name=name or path.name,
                hand=hand,
            )
        except VoxelError as error:
            raise VoxelError(str(error) if str(error).startswith(f"{path}:") else f"{path}: {error}") from error

    def _check_border(self) -> None:
        sides = []
        for axis in range(3):
            for end, where in ((0, "first"), (-1, "last")):
                count = int(np.count_nonzero(np.moveaxis(self.values, axis, 0)[end] < 0))
                sides += [f"{where} {'ijk'[axis]} ({count} voxels)"] if count else []
        if sides:
            warn_user(f"{self.name}: the solid reaches the volume's border at {', '.join(sides)}; it is closed there")

    def _check_place(self, hand: bool) -> None:
        size = np.ptp(self.bounds, axis=0)
        if not (np.isfinite(size).all() and np.abs(self.bounds).max() < np.finfo(np.float32).max):
            raise VoxelError(f"coordinates overflow after placement (scale {self.placement.scale})")
        if not hand:
            warn_of_place(self.name, self.bounds, "give the unit of its lengths", self.placement.at)

    @property
    def values(self) -> np.ndarray:
        """Signed values, below 0 inside, float32, shape [i, j, k]; read-only."""
        return self._padded[1:-1, 1:-1, 1:-1]

    @property
    def spacing(self) -> np.ndarray:
        """Between voxel centres, as placed [m], shape [3]."""
        return np.linalg.norm(self.affine[:3, :3], axis=0)

    @cached_property
    def identity(self) -> str:
        """SHA-256 over signed values and where they are placed."""
        digest = hashlib.sha256(f"{self.values.shape}/{self.affine.tolist()}/".encode())
        digest.update(self._padded)
        return digest.hexdigest()

    def require_closed(self) -> None:
        """Voxels always say what is inside."""

    def field_on(self, device: str) -> Field:
        """The values as a field on a Warp device, uploaded once."""
        with self._lock:
            if device not in self._fields:
                if wp.get_device(device).is_cuda:
                    wp.set_mempool_release_threshold(device, POOL_KEPT)
                self._fields[device] = bricked_field(self._padded, self.affine, device)
            return self._fields[device]

    def outline_mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """The surface by marching cubes over the voxels, closed: vertices [m], float32, and faces, int32, outwards."""
        from warp.geometry import IsoSurfaceMarchingCubes  # compiles kernels

        padded = wp.array(self._padded, dtype=wp.float32, device="cpu")
        vertices, corners = IsoSurfaceMarchingCubes.extract(padded, 0.0)
        faces = corners.numpy().reshape(-1, 3).astype(np.int32)
        if np.linalg.det(self.affine[:3, :3]) < 0:
            faces = faces[:, ::-1]
        points = applied(self.affine, vertices.numpy().astype(np.float64) - 1.0)
        return points.astype(np.float32), np.ascontiguousarray(faces)

    def described(self) -> dict[str, Any]:
        """What a file says about the object, for JSON."""
        return {
            "name": self.name,
            "representation": "voxels",
            "shape": list(self.values.shape),
            "inside": self.inside_count,
            "rule": {**asdict(self.rule), "labels": list(self.rule.labels)},
            "affine": self.affine.tolist(),
            "hash": self.identity,
            "placement": asdict(self.placement),
            "source": self.source,
        }


def save_voxels(voxels: VoxelObject, path: str | Path, *, overwrite: bool = False) -> None:
    """Write voxels, as placed: .npz, .npy (values only), .nrrd, .nii, .nii.gz, or .nvdb (along the axes only).

    Values that are signed are written as they are, occupancy and labels as 0 and 1. Raises VoxelError for another name,
    for what the format cannot hold, and for a file that is there unless `overwrite`, which replaces it once the new one
    is whole.

    >>> from palpate.render import MeshObject, VoxelObject, save_voxels, voxelise
    >>> save_voxels(voxelise(MeshObject.load("cube"), spacing=0.02), "cube.npz")
    >>> VoxelObject.load("cube.npz")
    VoxelObject('cube.npz', 216 voxels inside, 130 x 130 x 130 mm at (0, 0, 0.2) m)
    """
    signed = np.array(voxels.values)
    if voxels.rule.kind in ("occupancy", "label") and not voxels.rule.smooth:  # nothing lies between inside and outside
        volume = WrittenVolume((signed < 0).astype(np.uint8), "occupancy", voxels.affine, signed)
    else:
        volume = WrittenVolume(signed, "distance", voxels.affine, signed)
    write_volume(volume, Path(path), overwrite=overwrite)
