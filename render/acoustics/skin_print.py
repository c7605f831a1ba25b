"""The print of a rendering on a plane of skin: where it presses, and how much of that lies along the contours.

It is what an oil film under the array would show: the radiation pressure, averaged over the frames of a pose.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..focal_spot import SOUND_SPEED
from .pressure import PressureSum
from .radiation import AIR_DENSITY, mean_square
from .sampled_places import SampledPlane

STEPS_A_WIDTH = 8  # points along a contour in a focal width
CELLS = 4  # cells of a grid in a focal width, and points along a contour


@dataclass(frozen=True, eq=False)
class SkinPrint:
    """Radiation pressure on planes, mean over frames."""

    planes: list[SampledPlane]
    radiation: list[np.ndarray]
    """Mean radiation pressure [Pa] on each plane, float64, shape [row, column]."""
    pressure_peak: float
    """Largest pressure amplitude at any place in any frame [Pa]."""

    @property
    def force(self) -> float:
        """On all planes [N]: their sides that face the array reflect everything."""
        return float(sum(r.sum() * p.cell_area for p, r in zip(self.planes, self.radiation, strict=True)))

    @property
    def radiation_peak(self) -> float:
        """Largest mean radiation pressure [Pa]."""
        return float(max((r.max() for r in self.radiation), default=0.0))

    def share_within(self, polylines: Sequence[np.ndarray], width: float) -> float | None:
        """Share of the force not farther than `width` [m] from polylines [m]; None where there is no force."""
        force = self.force
        if force <= 0 or not len(polylines):
            return None
        near = 0.0
        for plane, radiation in zip(self.planes, self.radiation, strict=True):
            within = distance_to(polylines, plane.points, width / STEPS_A_WIDTH) <= width
            near += float(radiation.ravel()[within].sum()) * plane.cell_area
        return near / force


def print_on(
    planes: list[SampledPlane],
    field: PressureSum,
    drive: np.ndarray,
    *,
    pressure_at_1m: float,
    sound_speed: float = SOUND_SPEED,
    air_density: float = AIR_DENSITY,
    progress: Callable[[int, int], object] | None = None,
) -> SkinPrint:
    """The print of frames on planes; drive: complex, shape [frame, transducer]; progress: points done, and all."""
    place = np.concatenate([plane.points for plane in planes]) if planes else np.zeros((0, 3))
    mean, most = mean_square(field, place, drive, progress=progress)
    mean *= pressure_at_1m**2 / (air_density * sound_speed**2)
    ends = np.cumsum([np.prod(plane.shape) for plane in planes])[:-1]
    parts = [part.reshape(plane.shape) for part, plane in zip(np.split(mean, ends), planes, strict=True)]
    return SkinPrint(planes, parts, pressure_at_1m * float(np.sqrt(most.max(initial=0.0))))


def points_along(polylines: Sequence[np.ndarray], step: float) -> np.ndarray:
    """Points on polylines [m], shape [point, 3], about `step` apart, each for the same length of a polyline."""
    parts = []
    for line in polylines:
        arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        if arc[-1] > 0:
            count = max(1, round(arc[-1] / step))
            places = (np.arange(count) + 0.5) / count * arc[-1]
            parts.append(np.stack([np.interp(places, arc, line[:, k]) for k in range(3)], axis=1))
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def distance_to(polylines: Sequence[np.ndarray], points: np.ndarray, step: float) -> np.ndarray:
    """From points to the nearest one on polylines [m], shape [point]; infinite without polylines.

    step: between the points of polylines that are looked at [m]; distances of eight steps are up to 0.2 % too long.
    """
    from scipy.spatial import KDTree

    along = points_along(polylines, step)
    if not len(along):
        return np.full(len(points), np.inf)
    return np.asarray(KDTree(along).query(points)[0])


def unevenness(square: np.ndarray) -> float | None:
    """Coefficient of variation of mean |p|^2 along contours, at points each for the same length; None without any."""
    if not len(square) or square.mean() <= 0:
        return None
    return float(square.std() / square.mean())
