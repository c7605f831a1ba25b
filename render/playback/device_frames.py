"""Focal points on a device -> wire bytes there, for boards whose frames are pulses on a grid (`Layout.pulses`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ...datasets.rigid import conjugate, matrix_of
from ...device.array import ArrayModel
from ...device.registry import array_model, kind_of
from ...device.wire_layout import Layout
from ...kernels.driving.pulse_frames import FocalBox, PackedFrames, board_on, pack_pulses
from ..errors import StrategyError
from ..sampling.contour_sampling import FocalPoints
from .drive import INTENSITY_TOLERANCE, DriveStrategy


class PulsePacker:
    """Packs frames of one focal point each, without going through the host.

    What `Driver` and `encode_frames` make on the host, with two differences: delays of both are within 1e-4 turns of
    exact, so one in some 10,000 starts is one step (1/128 turn) apart; and silent frames aim at the origin instead of
    at the last point that was drawn.

    >>> import warp as wp
    >>> from palpate.render import PulsePacker
    >>> packer = PulsePacker("pat16", device="cpu")
    >>> points = wp.array([[0.0, 0.0, 0.2], [0.0, 0.0, 9.0]], dtype=wp.vec3, device="cpu")  # the second is too far
    >>> packed = packer.pack(points, wp.ones(2, dtype=wp.float32, device="cpu"))
    >>> packed.frame.shape, packed.refused, packed.frame.numpy()[:, 256:].max(axis=1).tolist()  # widths of pulses
    ((2, 512), 1, [64, 0])
    """

    def __init__(
        self, array: ArrayModel | str, strategy: DriveStrategy | None = None, *, device: str = "cuda:0"
    ) -> None:
        """Raises StrategyError for an array whose frames are no pulses on a grid, and for a slew limit."""
        model = array_model(array) if isinstance(array, str) else array
        strategy, layout = strategy or DriveStrategy(), kind_of(model).layout
        if layout.pulses is None:
            raise StrategyError(
                f"frames of array {model.name} are not packed on a device: use Driver and encode_frames"
            )
        if strategy.slew is not None:
            raise StrategyError(f"slew {strategy.slew:g}: frames that depend on those before are made by Driver")
        order = model.wire_order
        values = {
            "position": model.position[order], "offset": model.delay_offset[order], "gain": model.gain[order],
            "level_least": levels_least(model, layout),
        }  # fmt: skip
        grid, per_metre = layout.pulses, model.carrier / strategy.sound_speed
        self._board = board_on(values, per_metre=per_metre, turn=grid.turn, mark=grid.mark, device=device)
        self._box = box_of(model, strategy)
        self._name, self._device = model.name, device

    def __repr__(self) -> str:
        """One line."""
        return f"PulsePacker({self._name!r})"

    def pack(self, position: wp.array, intensity: wp.array) -> PackedFrames:
        """Frames of focal points [m], vec3, with intensities 0..1, float32, both of shape [frame] on the device."""
        return pack_pulses(position, intensity, self._board, self._box)

    def pack_host(self, focus: FocalPoints) -> tuple[np.ndarray, int]:
        """The same from focal points on the host, and back: frames, uint8, and how many points are silenced."""
        position = wp.array(focus.position, dtype=wp.vec3, device=self._device)
        frame, refused = self.pack(position, wp.array(focus.intensity, dtype=wp.float32, device=self._device))
        return frame.numpy(), refused


def packer_for(models: Sequence[ArrayModel], strategy: DriveStrategy, device: str) -> PulsePacker | None:
    """What packs frames of these arrays on a device; None on the CPU, and where only `Driver` makes them."""
    is_packed = len(models) == 1 and kind_of(models[0]).layout.pulses is not None and strategy.slew is None
    return PulsePacker(models[0], strategy, device=device) if is_packed and wp.get_device(device).is_cuda else None


def box_of(model: ArrayModel, strategy: DriveStrategy) -> Any:
    """Where an array can focus, and what intensities mean, as the kernels take it."""
    box, zone = FocalBox(), model.focal_zone
    box.turn = wp.mat33d(*matrix_of(conjugate(np.asarray(model.pose[3:], np.float64))).ravel().tolist())
    box.middle = wp.vec3d(*model.pose[:3])
    box.lateral, box.low, box.high = zone.lateral, zone.z_min, zone.z_max
    box.intensity_most, box.level_most = 1 + INTENSITY_TOLERANCE, strategy.level_max
    box.is_force = int(strategy.amplitude == "force")
    return box


def levels_least(model: ArrayModel, layout: Layout) -> np.ndarray:
    """Least amplitude, float32, for which a board gives each width from 1 on: what its own rounding says."""
    if layout.pulses is None:
        raise StrategyError(f"frames of array {model.name} are no pulses on a grid")
    width = np.arange(1, layout.pulses.half + 1)
    low, high = np.zeros(len(width), np.int32), np.full(len(width), np.float32(1.0).view(np.int32))
    while (low < high).any():  # floats that are not negative are ordered as their bits are
        middle = low + (high - low) // 2
        reached = widths_of(middle.view(np.float32), model, layout) >= width
        low, high = np.where(reached, low, middle + 1), np.where(reached, middle, high)
    return low.astype(np.int32).view(np.float32)


def widths_of(level: np.ndarray, model: ArrayModel, layout: Layout) -> np.ndarray:
    """Widths that a board gives to amplitudes, shape [level]."""
    frames = np.zeros((len(level), model.frame_bytes), np.uint8)
    delay = np.zeros((len(level), model.transducer_count), np.float32)
    layout.pack(delay, level[:, None], model.wire_order, frames)
    return frames[:, -1].astype(int)
