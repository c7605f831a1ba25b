"""Grids of points where pressure is computed: a patch of skin, a plane, a volume."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import StrategyError
from ..hands.hand import PatchFrames
from ..validation import require_number

POINTS_MOST = 20_000_000


@dataclass(frozen=True, eq=False)
class SampledPlane:
    """Middles of equal cells that cover a rectangle."""

    origin: np.ndarray
    """Middle of the rectangle [m], shape [3]."""
    u: np.ndarray
    """Unit vector along the columns, shape [3]."""
    v: np.ndarray
    """Unit vector along the rows, shape [3]."""
    across: np.ndarray
    """Middle of each column along u [m], shape [column]."""
    along: np.ndarray
    """Middle of each row along v [m], shape [row]."""
    extent: tuple[float, float]
    """Width along u and length along v [m]."""

    @property
    def points(self) -> np.ndarray:
        """[m], common frame, shape [row * column, 3], row by row."""
        b, a = np.meshgrid(self.along, self.across, indexing="ij")
        return self.origin + a.reshape(-1, 1) * self.u + b.reshape(-1, 1) * self.v

    @property
    def shape(self) -> tuple[int, int]:
        """Rows, columns."""
        return len(self.along), len(self.across)

    @property
    def cell_area(self) -> float:
        """Of one cell [m^2]."""
        return self.extent[0] * self.extent[1] / (len(self.along) * len(self.across))

    def locate(self, points: np.ndarray) -> np.ndarray:
        """Coordinates of points along u and v from the middle [m], shape [point, 2]."""
        return (points - self.origin) @ np.stack([self.u, self.v], axis=1)


def sample_plane(
    origin: np.ndarray, u: np.ndarray, v: np.ndarray, extent: tuple[float, float], spacing: float
) -> SampledPlane:
    """A grid over a rectangle, cells of about `spacing` [m]; raises StrategyError for more than 20 million points."""
    require_number("spacing", spacing, 1e-5, 1.0, unit="m")
    across, along = (_middles(side, spacing) for side in extent)
    _require_count(len(across) * len(along), spacing)
    return SampledPlane(np.asarray(origin, float), np.asarray(u, float), np.asarray(v, float), across, along, extent)


def sample_patches(frames: PatchFrames, spacing: float) -> list[SampledPlane]:
    """Grids over the patches of a hand at its first pose; patches that are absent there are left out."""
    planes = []
    for patch, half in enumerate(frames.half):
        origin = frames.origin[0, patch]
        if np.isfinite(origin).all():
            extent = (2 * float(half[0]), 2 * float(half[1]))
            planes.append(sample_plane(origin, frames.u[0, patch], frames.v[0, patch], extent, spacing))
    return planes


def sample_volume(centre: Sequence[float], size: float, spacing: float) -> tuple[np.ndarray, ...]:
    """Coordinates x, y, z [m] of cells' middles in a cube; raises StrategyError for more than 20 million points."""
    require_number("spacing", spacing, 1e-5, 1.0, unit="m")
    middle = _middles(size, spacing)
    _require_count(len(middle) ** 3, spacing)
    return tuple(c + middle for c in centre)


def _middles(side: float, spacing: float) -> np.ndarray:
    count = max(1, round(side / spacing))
    return ((np.arange(count) + 0.5) / count - 0.5) * side


def _require_count(count: int, spacing: float) -> None:
    if count > POINTS_MOST:
        raise StrategyError(f"spacing {spacing:g} m gives {count} points, {POINTS_MOST} at most")
