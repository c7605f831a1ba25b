"""Where ultrasound presses at a pose that is shown: on the hand's planes, its mesh, or in a plane through the palm."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..acoustics.drawn_frames import cycle_along, drives_of
from ..acoustics.field_metrics import sampling_for
from ..acoustics.pressure import NEAREST, PressureSum, complex_drives
from ..acoustics.radiation import AIR_DENSITY, mean_square
from ..acoustics.sampled_places import SampledPlane, sample_plane
from ..acoustics.transducers import PRESSURE_AT_1M, TransducerSet
from ..focal_spot import SOUND_SPEED
from ..playback.drive import Driver
from ..playback.placed_arrays import PlacedArray
from ..sampling.metrics import FocalPoints
from ..sampling.strategy import SamplingStrategy
from .file_scene import Moment
from .packing import Packer

FRAMES_MOST = 256
"""Frames of a draw cycle that stand for it: more change a print by less than a viewer shows, and take longer."""
SPACING = 2e-3  # [m] between points of a print
PLANE_SIDE = 0.2  # [m] of the plane through the palm
PLACES = ("skin", "plane")
LIFT = 5e-4  # [m] of a print off the palm, towards the array


@dataclass(frozen=True, eq=False)
class PressurePrint:
    """Mean radiation pressure of a pose that is drawn once around."""

    planes: list[SampledPlane]
    """Grids of points; empty where the print is on a mesh."""
    on_planes: list[np.ndarray]
    """Radiation pressure [Pa] on each of them, shape [row, column]."""
    on_vertices: np.ndarray | None
    """Radiation pressure [Pa] at the vertices of the hand's mesh, shape [vertex]; None where it is on planes."""

    @property
    def peak(self) -> float:
        """The largest [Pa]; 0 where nothing is drawn."""
        parts = [*self.on_planes, *([] if self.on_vertices is None else [self.on_vertices])]
        return float(max((part.max(initial=0.0) for part in parts), default=0.0))


class PressurePrinter:
    """Computes prints with one array, or several, on the CPU; a print of a palm takes about half a second.

    sampling: how the focal point draws; None: stm, at a rate that the arrays have.
    """

    def __init__(self, arrays: Sequence[PlacedArray], sampling: SamplingStrategy | None = None) -> None:
        sampling = self._sampling = sampling_for(sampling, arrays)
        models = [placed.model for placed in arrays]
        self._driver = Driver(models, update_rate=sampling.update_rate)
        strategy = self._driver.strategy
        self._transducers = TransducerSet(
            models, sound_speed=strategy.sound_speed, piston_radius=strategy.piston_radius
        )
        self._field = PressureSum(self._transducers)

    def compute(self, moment: Moment, where: str) -> PressurePrint:
        """The print of a pose; where: "skin" or "plane" (parallel to the array's face, through the palm's place).

        Points within 5 mm of a transducer's rim have no pressure here: the model does not hold there.
        """
        focus = cycle_along(moment.contours, moment.hand_pose, self._sampling)
        drive = complex_drives(drives_of(self._driver, _some_frames(focus)), self._transducers, quantised=True)
        if where == "skin" and moment.hand.is_rendered:
            return PressurePrint([], [], self._radiation(moment.hand.vertices.astype(np.float64), drive))
        planes = [_middle_plane(moment.hand_pose)] if where == "plane" else planes_of_patches(moment.hand.patches)
        parts = [self._radiation(plane.points, drive).reshape(plane.shape) for plane in planes]
        return PressurePrint(planes, parts, None)

    def _radiation(self, place: np.ndarray, drive: np.ndarray) -> np.ndarray:
        mean = np.zeros(len(place))
        clear = self._transducers.nearest(place) > NEAREST + self._transducers.piston_radius
        if clear.any() and len(drive):
            mean[clear], _ = mean_square(self._field, place[clear], drive)
        return mean * PRESSURE_AT_1M**2 / (AIR_DENSITY * SOUND_SPEED**2)


def pack_prints(prints: Sequence[PressurePrint], peaks: Sequence[float], packer: Packer) -> dict[str, Any]:
    """Pack prints of some poses: rectangles with a number 0..255 for each cell, or numbers of a mesh's vertices.

    peaks: radiation pressure that 255 means at each pose [Pa]; 255 x the share of it is rounded.
    """
    from matplotlib import colormaps  # 0.2 s that only a print costs

    colours = colormaps["inferno"](np.arange(256))[:, :3]
    scale = 255.0 / np.maximum(peaks, 1e-12)
    planes = [plane for each in prints for plane in each.planes]
    values = [k * part.reshape(-1) for k, each in zip(scale, prints, strict=True) for part in each.on_planes]
    values += [k * own.on_vertices for k, own in zip(scale, prints, strict=True) if own.on_vertices is not None]
    numbers = np.round(np.concatenate([np.zeros(0), *values]))
    return {
        "peak": packer.numbers(np.array(peaks), "f4"),
        "plane_count": packer.numbers(np.array([len(each.planes) for each in prints]), "u2"),
        "corners": packer.positions(np.concatenate([np.zeros((0, 3)), *map(_corners, planes)])),
        "shape": packer.numbers(np.array([plane.shape for plane in planes]).reshape(-1, 2), "u2"),
        "values": packer.numbers(numbers, "u1"),
        "colours": packer.numbers((255 * colours).round(), "u1"),  # of 0..255, as in `palpate field`'s pictures
    }


def _corners(plane: SampledPlane) -> np.ndarray:
    """Of a rectangle [m], just over the skin, shape [4, 3]: where u and v are least, then along u, v, and back."""
    u, v = plane.u * plane.extent[0] / 2, plane.v * plane.extent[1] / 2
    middle = plane.origin - LIFT * np.cross(plane.u, plane.v)
    return np.stack([middle - u - v, middle + u - v, middle + u + v, middle - u + v])


def planes_of_patches(patches: np.ndarray, spacing: float = SPACING) -> list[SampledPlane]:
    """Grids over patches of skin, whose corners [m] have shape [patch, 4, 3]."""
    planes = []
    for corners in patches.astype(np.float64):
        across, along = corners[1] - corners[0], corners[3] - corners[0]
        width, length = float(np.linalg.norm(across)), float(np.linalg.norm(along))
        middle = corners.mean(axis=0)
        planes.append(sample_plane(middle, across / width, along / length, (width, length), spacing))
    return planes


def _middle_plane(hand_pose: np.ndarray) -> SampledPlane:
    axes = np.eye(3)
    return sample_plane(hand_pose[:3].astype(np.float64), axes[0], axes[1], (PLANE_SIDE, PLANE_SIDE), SPACING)


def _some_frames(focus: FocalPoints) -> FocalPoints:
    count = len(focus.intensity)
    if count <= FRAMES_MOST:
        return focus
    chosen = np.linspace(0, count, FRAMES_MOST, endpoint=False).astype(np.int64)
    return FocalPoints(focus.position[chosen], focus.intensity[chosen])
