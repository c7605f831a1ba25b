"""What a file says about a volume, and the units that its lengths may have."""

from typing import NamedTuple

import numpy as np

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6}  # [m]
UNIT_SPELLINGS = {
    "m": ("m", "meter", "metre"),
    "cm": ("cm", "centimeter", "centimetre"),
    "mm": ("mm", "millimeter", "millimetre"),
    "um": ("um", "µm", "micron", "micrometer", "micrometre"),
}
UNIT_NAMES = {name: unit for unit, names in UNIT_SPELLINGS.items() for name in names}


class VolumeFile(NamedTuple):
    """What a file says about a volume."""

    values: np.ndarray
    """Of any type, shape [i, j, k]."""
    affine: np.ndarray | None
    """Indices to coordinates [m], shape [4, 4]; None if the file has none."""
    kind: str | None = None
    """What the values mean, if the file says so."""
    level: float | None = None
    """Value on the surface, likewise."""


def scaled(affine: np.ndarray, unit: str) -> np.ndarray:
    """An affine map in metres."""
    out = np.array(affine, np.float64)
    out[:3] *= UNITS[unit]
    return out


def without_ones(values: np.ndarray) -> np.ndarray:
    """Without axes of length 1 beyond the third, which some writers add."""
    while values.ndim > 3 and values.shape[-1] == 1:
        values = values[..., 0]
    return values
