"""Where an object goes: from a file's coordinates to the array's frame."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypedDict, Unpack

import numpy as np

from ....datasets.known_names import find_name, likely_name
from ...errors import PlacementError
from ...user_warnings import warn_user
from ...validation import is_number, value_text

SIZE_LARGEST = 5.0  # [m]; a larger object does not fit any workspace: its file is probably in millimetres
UP_AXES = ("x", "y", "z", "-x", "-y", "-z")


@dataclass(frozen=True)
class Placement:
    """Transform from a file's coordinates to the array's: scale, `up`, fit, rotate and move, in this order.

    >>> from palpate.render import MeshObject, Placement
    >>> MeshObject.load("cube", placement=Placement(fit=0.1, at=(0, 0, 0.25)))
    MeshObject('cube', 12 triangles, closed, 100 x 100 x 100 mm at (0, 0, 0.25) m)
    """

    scale: float = 1.0
    """Factor on all coordinates (0.001 for a file in millimetres)."""
    up: str = "z"
    """Axis of the file that points up, away from the array: one of x, y, z, -x, -y, -z."""
    fit: float | None = None
    """Longest side of the bounding box [m]; None leaves the size alone."""
    rotate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Angles about the array's x, then y, then z axis, through the middle of the bounding box [degree]."""
    at: tuple[float, float, float] | None = None
    """Where the middle of the bounding box goes [m], array frame; None leaves it where it is."""

    def __post_init__(self) -> None:
        """Take numbers of any type as Python's; raise PlacementError for a value that is not allowed."""
        if not (is_number(self.scale) and np.isfinite(self.scale) and self.scale > 0):
            raise PlacementError(f"scale must be positive, not {value_text(self.scale)}")
        object.__setattr__(self, "scale", float(self.scale))
        up = find_name(self.up, UP_AXES)
        if up is None:
            raise PlacementError(f"up must be one of {', '.join(UP_AXES)}, not {self.up!r}")
        object.__setattr__(self, "up", up)
        if self.fit is not None and not (is_number(self.fit) and np.isfinite(self.fit) and self.fit > 0):
            raise PlacementError(f"fit must be a positive length in metres, not {value_text(self.fit)}")
        object.__setattr__(self, "fit", None if self.fit is None else float(self.fit))
        for field, value in (("rotate", self.rotate), ("at", self.at)):
            if value is not None:
                numbers = list(value) if isinstance(value, Iterable) and not isinstance(value, str) else []
                if len(numbers) != 3 or not all(is_number(one) and np.isfinite(one) for one in numbers):
                    raise PlacementError(f"{field} must be three finite numbers, not {value_text(value)}")
                object.__setattr__(self, field, tuple(float(one) for one in numbers))

    def applied_to(self, vertices: np.ndarray) -> np.ndarray:
        """Placed vertices [m], shape [vertex, 3]."""
        if self == Placement():
            return vertices
        out = vertices * self.scale @ up_rotation(self.up).T
        middle = (out.min(axis=0) + out.max(axis=0)) / 2
        out = out - middle
        if self.fit is not None:
            out *= self.fit / np.ptp(out, axis=0).max()
        for axis, angle in enumerate(self.rotate):
            out = out @ axis_rotation(axis, np.radians(angle)).T
        return out + (middle if self.at is None else np.asarray(self.at))

    def factor_of(self, vertices: np.ndarray) -> float:
        """Factor by which lengths grow."""
        if self.fit is None:
            return self.scale
        finite = vertices[np.isfinite(vertices).all(axis=-1)] if vertices.ndim == 2 else vertices[:0]
        if len(finite) == 0:
            return self.scale
        return self.fit / (float(np.ptp(finite, axis=0).max()) or 1.0)


class PlacementFields(TypedDict, total=False):
    """Fields of a `Placement`, as arguments of what loads objects."""

    scale: float
    up: str
    fit: float | None
    rotate: tuple[float, float, float]
    at: tuple[float, float, float] | None


def placement_of(placement: Placement | None, **fields: Unpack[PlacementFields]) -> Placement:
    """The placement given, or the one of these fields; raises PlacementError for both and for unknown fields."""
    known = Placement.__dataclass_fields__
    if unknown := set(fields) - set(known):
        raise TypeError(f"unexpected argument {min(unknown)!r}{likely_name(min(unknown), known)}")
    if placement is not None and fields:
        raise PlacementError(f"{min(fields)} is a field of placement, which is given, too")
    return placement or Placement(**fields)


def warn_of_place(name: str, bounds: np.ndarray, way: str, at: tuple[float, float, float] | None) -> None:
    """Warn (PalpateWarning) of an object that is too large, placed far away, or reaches behind the array.

    bounds: [m], array frame, shape [2, 3]; way: advice against the size; at: of its placement. The warning is
    attributed to the line of a script that made the object.
    """
    size, low, high = np.ptp(bounds, axis=0), bounds[0, 2], bounds[1, 2]
    if size.max() > SIZE_LARGEST:
        fault = f"is {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m; {way}"
    elif at is not None and np.abs(at).max() > SIZE_LARGEST:
        metres = ", ".join(f"{value / 1000:g}" for value in at)
        fault = f"lies at {at} m; lengths are in metres, in millimetres that were at=({metres})"
    elif low < 0:
        fault = (
            f"reaches behind the array (z from {low:.4g} to {high:.4g} m): coordinates are taken as they are, "
            "at=(0, 0, 0.2) places it in front"
        )
    else:
        return
    warn_user(f"{name}: {fault}")


def place_text(bounds: np.ndarray) -> str:
    """Size and middle of a box [m], shape [2, 3], in words for one line."""
    factor, unit = (1.0, "m") if np.ptp(bounds, axis=0).max() > SIZE_LARGEST else (1e3, "mm")
    size = " x ".join(f"{factor * side:.4g}" for side in np.ptp(bounds, axis=0))
    middle = ", ".join(f"{value + 0.0:.4g}" for value in np.round(bounds.mean(axis=0), 6))
    return f"{size} {unit} at ({middle}) m"


def axis_rotation(axis: int, angle: float) -> np.ndarray:
    """Rotation matrix about a coordinate axis [rad]; quarter turns are exact."""
    c, s = np.cos(angle), np.sin(angle)
    c, s = (np.round(c), np.round(s)) if abs(np.sin(2 * angle)) < 1e-15 else (c, s)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[i, i], out[i, j], out[j, i], out[j, j] = c, -s, s, c
    return out


def up_rotation(up: str) -> np.ndarray:
    """Rotation that brings an axis of the file to +z: a turn about the file's x (for x itself, about its y)."""
    axis, angle = {"z": (0, 0), "y": (0, 1), "-z": (0, 2), "-y": (0, -1), "x": (1, -1), "-x": (1, 1)}[up]
    return axis_rotation(axis, angle * np.pi / 2)
