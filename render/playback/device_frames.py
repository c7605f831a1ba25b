"""Focal points on a device -> wire bytes there, for boards whose frames are pulses on a grid (`Layout.pulses`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from ...datasets.rigid import conjugate, matrix_of
from ...device.array import ArrayModel
from ...device.registry import array_model, kind_of
from ...device.wire_layout import Layout
from ...kernels.driving.pulse_frames import (
    PackedFrames,
    RoundedFrames,
    board_on,
    pack_delays,
    pack_pulses,
    unpack_pulses,
)
from ...kernels.driving.slew import Gauge
from ...kernels.driving.solve import POINTS_MOST, solve_points
from ...kernels.driving.weigh import FocalBox, hold_points
from ..errors import StrategyError
from ..sampling.metrics import FocalPoints
from .drive import INTENSITY_TOLERANCE, REST, DriveStrategy, solved_size, transducers_of

SOLVED_AT_ONCE = 1 << 17  # frames: 128 MiB of delays of 256 transducers


class PulsePacker:
    """Packs frames of one array on a device, without going through the host.

    What `Driver` and `encode_frames` make on the host, with these differences. One focal point a frame: delays of both
    are within 1e-4 turns of exact, so one in some 10,000 starts is one step (1/128 turn) apart; and silent frames aim
    at the origin instead of at the last point that was drawn. Several: on the CPU frames are the same; a GPU rounds
    otherwise, so starts are a step apart, and more where a solver has the choice between solutions that are as good.
    Frames of several focal points depend on those of earlier calls, as those of `Driver` do.

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
            "level_least": levels_least(model, layout), "order": order,
        }  # fmt: skip
        grid, per_metre = layout.pulses, model.carrier / strategy.sound_speed
        self._board = board_on(values, per_metre=per_metre, turn=grid.turn, mark=grid.mark, device=device)
        plain = {"offset": np.zeros(len(order)), "gain": np.ones(len(order))}
        self._plain = board_on(values | plain, per_metre=per_metre, turn=grid.turn, mark=0, device=device)
        self._box = box_of(model, strategy)
        self.array, self.frame_bytes = model, model.frame_bytes
        """Whose frames they are, and bytes of a frame."""
        self._device = device
        self._strategy = strategy
        self._transducers = transducers_of([model], strategy, device)
        self.reset()

    def __repr__(self) -> str:
        """One line."""
        return f"PulsePacker({self.array.name!r})"

    def reset(self) -> None:
        """Forget the frames so far: the next one starts from rest."""
        self._gauge = Gauge()
        self._held: tuple[Any, ...] | None = None  # points and targets of the last frame, shape [focus]

    def pack(self, position: wp.array, intensity: wp.array) -> PackedFrames:
        """Frames of focal points [m], vec3, with intensities 0..1, float32, both on the device.

        Both have the shape [frame], or [frame, focus] with up to 8 focal points a frame, which are solved as the
        strategy says. Raises StrategyError for other shapes and types.
        """
        return self._pack(position, intensity, self._board)

    def rounded(self, position: wp.array, intensity: wp.array) -> RoundedFrames:
        """The same as delays and amplitudes in the board's steps, its calibration aside, as predictions take them.

        They are what `round_drives` makes on the host, with the differences of `pack`. Instead of `pack`, not beside
        it: frames of several focal points depend on those before.
        """
        return unpack_pulses(self._pack(position, intensity, self._plain), self._plain)

    def _pack(self, position: wp.array, intensity: wp.array, board: Any) -> PackedFrames:
        if position.shape != intensity.shape or position.ndim > 2:
            raise StrategyError(
                f"position and intensity must be [frame] or [frame, focus], not {position.shape}, {intensity.shape}"
            )
        if position.dtype is not wp.vec3 or intensity.dtype is not wp.float32:
            types = f"{position.dtype.__name__}, {intensity.dtype.__name__}"
            raise StrategyError(f"position must be vec3 and intensity float32, not {types}")
        if position.ndim == 1 or position.shape[1] == 1:
            return pack_pulses(position.flatten(), intensity.flatten(), board, self._box)
        frame_count, count = position.shape
        if not 1 <= count <= POINTS_MOST:
            raise StrategyError(f"position must be [frame, 1..{POINTS_MOST}], not {position.shape}")
        frame = wp.empty((frame_count, 2 * len(board.position)), dtype=wp.uint8, device=position.device)
        refused = 0
        for first in range(0, frame_count, SOLVED_AT_ONCE):
            rows = slice(first, min(first + SOLVED_AT_ONCE, frame_count))
            part, silenced = self._pack_several(position[rows], intensity[rows], board)
            wp.copy(frame[rows], part)
            refused += silenced
        return PackedFrames(frame, refused)

    def _pack_several(self, position: wp.array, intensity: wp.array, board: Any) -> PackedFrames:
        """The same of several focal points, a number of frames that fits into memory."""
        count, device = position.shape[1], position.device
        if self._held is None or len(self._held[0]) != count:
            points = wp.array(np.tile(np.float32(REST), (count, 1)), dtype=wp.vec3, device=device)
            self._held = points, wp.ones(count, dtype=wp.float32, device=device)
        held = hold_points(position, intensity, self._box, self._held, size=solved_size(count))
        self._held = tuple(wp.clone(own[-1:]).flatten()[:count] for own in (held.point, held.target))
        gs_pat, wgs = self._strategy.iterations
        delay = solve_points(held.point, held.target, self._transducers, gs_pat=gs_pat, wgs=wgs)
        self._gauge.lock(delay)
        return PackedFrames(pack_delays(delay, held.level, board), held.refused)

    def pack_host(self, focus: FocalPoints) -> tuple[np.ndarray, int]:
        """The same from focal points on the host, and back: frames, uint8, and how many points are silenced."""
        frame, refused = self.pack(*focus_on(focus, self._device))
        return frame.numpy(), refused


def focus_on(focus: FocalPoints, device: str) -> tuple[wp.array, wp.array]:
    """Focal points of the host on a device: positions [m], vec3, and intensities, float32."""
    position = wp.array(focus.position, dtype=wp.vec3, device=device)
    return position, wp.array(focus.intensity, dtype=wp.float32, device=device)


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
