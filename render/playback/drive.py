"""Convert focal points to drives of arrays: a delay for each transducer, an amplitude for each frame."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...datasets.rigid import conjugate, matrix_of
from ...device.array import ArrayModel
from ...device.codec import require_unit_range
from ...device.registry import array_model, kind_of
from ...device.wire_layout import FocusLayout, Layout
from ...kernels import BYTE_STAGES
from ...kernels.driving.foci import focus_board, pack_foci
from ...kernels.driving.hold import FocalBox, HeldFrames, IntensityRule, hold_points
from ...kernels.driving.pack import RoundedFrames, board_on, focus_delays, pack_delays, pack_points, unpack_frames
from ...kernels.driving.slew import Gauge, limit_slew
from ...kernels.driving.solve import POINTS_MOST, SIZES, solve_points
from ...kernels.driving.wave import transducers_on
from ..errors import StrategyError
from ..focal_spot import PISTON_RADIUS, SOUND_SPEED
from ..runtime.span_workers import warp_device
from ..sampling.metrics import FocalPoints
from ..validation import read_fields, require_choice, require_number

REST = (0.0, 0.0, 0.2)  # [m] aim of silent frames before the first focal point
FRAMES_AT_ONCE = 1 << 17  # 128 MiB of delays of 256 transducers
INTENSITY_TOLERANCE = 1e-6  # by which rounding may raise an intensity above 1

# Amplitudes: rms error of 4 foci, median over random frames. Change: of a transducer's delay from frame to frame for 4
# foci at 7 m/s and 40 kHz, mean over transducers: 90 % quantile | maximum over frames. WGS solves each frame anew and
# may switch between equally good solutions. With one focus the change is 0.004 turns.
#
# solver        iterations of GS-PAT, of WGS, by default     amplitudes      change [turns]
SOLVERS = {
    "naive": (0, 0),  #                                      20 %            0.008 | 0.011
    "gs-pat": (20, 0),  #                                    3.5 %           0.008 | 0.027
    "wgs": (0, 20),  #                                       0.15 %          0.019 | 0.151
    "gs-pat+wgs": (10, 6),  #                                0.3 %           0.016 | 0.049
}
AMPLITUDES = ("pressure", "force")


class Drives(NamedTuple):
    """Drives of consecutive frames."""

    delay: np.ndarray  # [turns of the carrier], 0..1, float32, shape [frame, transducer]
    amplitude: np.ndarray  # relative pressure amplitude 0..1, float32, shape [frame]
    refused: int  # focal points that are silenced: outside the focal zones, or with an invalid intensity


@dataclass(frozen=True)
class DriveStrategy:
    """Conversion of focal points to drives.

    A frame with one focal point is focused exactly and has that point's amplitude. In a frame with several, all
    transducers have one amplitude, the greatest of the points', and a solver finds phases for which the pressures at
    the points have the ratios of their amplitudes. So scaling all intensities scales all pressures. The points of a
    frame share the emitted power, so each gets less pressure than alone (with 4 points about half).

    Raises StrategyError for a value out of its range, with field, value and bound.

    >>> import numpy as np
    >>> from palpate.render import DriveStrategy
    >>> DriveStrategy(amplitude="force").pressure(np.array([0.25, 1.0]))  # half the pressure has a quarter of the force
    array([0.5, 1. ])
    """

    amplitude: str = "pressure"
    """Meaning of intensity: relative pressure amplitude, or relative radiation force (pressure = its square root)."""
    solver: str = "gs-pat+wgs"
    """For frames with several focal points: naive, gs-pat, wgs, gs-pat+wgs."""
    gs_pat_iterations: int | None = None
    """Iterations of a solver with GS-PAT; by default 20, or 10 if WGS follows."""
    wgs_iterations: int | None = None
    """Iterations of a solver with WGS; by default 20, or 6 after GS-PAT."""
    slew: float | None = None
    """Largest change of a transducer's delay [turns] in a carrier period. In a frame the limit is carrier / update_rate
    times as large, and must be below half a turn. The common phase of all transducers is fixed before, so 4/256 makes
    jumps quieter and still follows a focal point at 7 m/s in any direction. None: no limit."""
    sound_speed: float = SOUND_SPEED
    """[m/s]"""
    level_max: float = 1.0
    """Amplitude for intensity 1, relative to the array's full amplitude."""
    piston_radius: float = PISTON_RADIUS
    """Radius of a transducer's piston [m], from which solvers compute its directivity; 0: a monopole."""

    def __post_init__(self) -> None:
        """Check every field."""
        require_choice("amplitude", self.amplitude, AMPLITUDES)
        require_choice("solver", self.solver, tuple(SOLVERS))
        require_number("sound_speed", self.sound_speed, 300.0, 400.0, unit="m/s (speed of sound in air)")
        require_number("level_max", self.level_max, 1e-3, 1.0, unit="of full amplitude")
        require_number("piston_radius", self.piston_radius, 0.0, 5.5e-3, unit="m")
        if self.slew is not None:
            require_number("slew", self.slew, 1e-6, 0.5, unit="turns a period")
        for field, default in zip(("gs_pat_iterations", "wgs_iterations"), SOLVERS[self.solver], strict=True):
            value = getattr(self, field)
            if value is None:
                continue
            require_number(field, value, 1, 1000, whole=True)
            if default == 0:
                raise StrategyError(f"{field} is {value}, but solver {self.solver!r} has no such iterations")

    @property
    def iterations(self) -> tuple[int, int]:
        """Number of iterations of GS-PAT and of WGS, with defaults filled in."""
        gs_pat, wgs = SOLVERS[self.solver]
        return self.gs_pat_iterations or gs_pat, self.wgs_iterations or wgs

    def pressure(self, intensity: np.ndarray) -> np.ndarray:
        """Relative pressure amplitude of intensities, both 0..1."""
        return np.sqrt(intensity) if self.amplitude == "force" else intensity

    def to_json(self) -> str:
        """One line of JSON that `from_json` reads back."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> "DriveStrategy":
        """Read back what `to_json` wrote; missing fields take their defaults."""
        values = read_fields(text, [field.name for field in fields(cls)], "drive strategy")
        return cls(**values)


class PackedFrames(NamedTuple):
    """Wire bytes of consecutive frames, on the device that made them."""

    frames: tuple[Any, ...]
    """Of each array, wp.uint8, shape [frame, frame_bytes]."""
    amplitude: Any
    """Of each frame, relative pressure amplitude 0..1, wp.float32, shape [frame]."""
    refused: int
    """Focal points that are silenced."""


class Driver:
    """Makes drives and wire bytes of one array, or of several side by side, block after block, by Warp kernels.

    One focal point a frame: the bytes are the same on every processor, and on a GPU, whose code has the same
    operations. Several, or a slew limit: the same on every processor; a GPU rounds otherwise, so some delays are a step
    apart. A frame depends on the frames before it (held positions, common phase, slew limit), not on their division
    into blocks. A focal point that cannot be played aims where it did last.

    Raises StrategyError for no array, arrays of different carriers, a slew limit without update rate, and an update
    rate so low that the slew limit has no effect.

    >>> from palpate.render import Driver, render, static_pose
    >>> square = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").sample("stm", duration=0.01)
    >>> drives = Driver("emulator").drive(square.focus)
    >>> drives.delay.shape  # 100 frames of 16 x 16 transducers
    (100, 256)
    """

    def __init__(
        self,
        arrays: ArrayModel | str | Sequence[ArrayModel | str],
        strategy: DriveStrategy | None = None,
        *,
        update_rate: float | None = None,
        device: str = "cpu",
    ) -> None:
        """Arrays in the common frame, or names; update_rate [Hz]: for a slew limit; device: Warp's."""
        given = (arrays,) if isinstance(arrays, ArrayModel | str) else tuple(arrays)
        self.arrays = tuple(array_model(array) if isinstance(array, str) else array for array in given)
        self.strategy = strategy or DriveStrategy()
        alone = [array.name for array in self.arrays if array.takes_points]
        if alone and len(self.arrays) > 1:
            raise StrategyError(
                f"array {alone[0]} plays alone: arrays that take focal points find their phases by themselves, so no "
                "other array could be in phase with it"
            )
        carriers = sorted({array.carrier for array in self.arrays})
        if len(carriers) != 1:
            raise StrategyError(f"arrays must be at least one and of one carrier, not {carriers} Hz")
        if alone and self.strategy.slew is not None:
            raise StrategyError(
                f"slew is {self.strategy.slew:g}, but array {alone[0]} takes focal points: no change of its phases can "
                "be limited"
            )
        self._step = self._slew_step(carriers[0], update_rate)  # [turns a frame]; None: no limit
        self.device = warp_device(device)
        """Warp's, where kernels run."""
        self.reset()

    def __repr__(self) -> str:
        """One line."""
        return f"Driver({', '.join(array.name for array in self.arrays)}, {self.strategy!r})"

    @property
    def takes_points(self) -> bool:
        """Whether its array takes focal points, and finds the phases by itself."""
        return any(array.takes_points for array in self.arrays)

    def reset(self) -> None:
        """Forget the frames so far: the next one starts from rest."""
        self._held: tuple[int, Any, Any] | None = None  # focal points of the last frame; points and targets
        self._gauge = Gauge()
        self._driven: Any = None  # delays of the last frame [turns], shape [transducer]

    def _slew_step(self, carrier: float, update_rate: float | None) -> float | None:
        slew = self.strategy.slew
        if slew is None:
            return None
        if update_rate is None or not 0 < update_rate <= carrier:
            raise StrategyError(f"slew {slew:g} needs an update_rate in 0..{carrier:g} Hz, not {update_rate}")
        step = slew * carrier / update_rate
        if step >= 0.5:
            raise StrategyError(
                f"slew must be below {0.5 * update_rate / carrier:g} turns a period at {update_rate:g} Hz, not "
                f"{slew:g}: from half a turn a frame on it limits nothing"
            )
        return step

    def kernel_stages(self, foci: int) -> tuple[str, ...]:
        """The stages of kernels that frames of so many focal points need, as `compile_kernels` takes them."""
        if self.takes_points:
            return "driving.hold", "driving.foci"
        solve = ("driving.solve",) if foci > 1 else ()
        slew = ("driving.slew",) if foci > 1 or self._step is not None else ()
        return *BYTE_STAGES, *solve, *slew

    def require_played(self) -> None:
        """Raise StrategyError for fields of the strategy that an array of focal points cannot be told.

        Predictions take them: they say how the array's own driver is supposed to find phases.
        """
        for field in fields(DriveStrategy) if self.takes_points else ():
            value = getattr(self.strategy, field.name)
            if field.name not in ("amplitude", "level_max") and value != field.default:
                raise StrategyError(
                    f"{field.name} is {value}, but array {self.arrays[0].name} takes focal points: its own driver "
                    "finds the phases, so of a drive only amplitude and level_max can be asked for"
                )

    @property
    def transducer_count(self) -> int:
        """Of all arrays."""
        return sum(array.transducer_count for array in self.arrays)

    @cached_property
    def boards(self) -> list[Any]:
        """Each array as kernels pack its frames; raises StrategyError as `require_played` does."""
        if not self.takes_points:
            return boards_on(self.arrays, self.strategy.sound_speed, self.device)
        self.require_played()
        (array,) = self.arrays
        return [focus_board(array.pose, _own_axes(array), array.point_count)]

    @cached_property
    def plain_boards(self) -> list[Any]:
        """Each array without calibration and fixed bits, for predictions; of focal points, with steps as assumed."""
        return boards_on(self.arrays, self.strategy.sound_speed, self.device, plain=True)

    @cached_property
    def _no_rests(self) -> Any:
        return wp.empty(0, dtype=wp.int32, device=self.device)

    @cached_property
    def _transducers(self) -> Any:
        return transducers_on(
            np.concatenate([array.position for array in self.arrays]),
            np.concatenate([array.normal for array in self.arrays]),
            wavelength=self.strategy.sound_speed / self.arrays[0].carrier,
            radius=self.strategy.piston_radius,
            device=self.device,
        )

    @cached_property
    def _zones(self) -> tuple[Any, Any]:
        """Where the arrays can focus, and what intensities mean."""
        rule = IntensityRule()
        rule.intensity_most, rule.amplitude_most = 1 + INTENSITY_TOLERANCE, self.strategy.level_max
        rule.is_force = int(self.strategy.amplitude == "force")
        boxes = []
        for array in self.arrays:
            box, zone = FocalBox(), array.focal_zone
            box.turn = wp.mat33d(*_own_axes(array).ravel().tolist())
            box.middle = wp.vec3d(*array.pose[:3])
            box.lateral, box.low, box.high = zone.lateral, zone.z_min, zone.z_max
            boxes.append(box)
        return wp.array(boxes, dtype=FocalBox, device=self.device), rule

    def drive(self, focus: FocalPoints) -> Drives:
        """Drives of the next frames.

        focus: position [m], common frame, shape [frame, 3], or [frame, focus, 3] with up to 8 focal points a frame;
        intensity 0..1, shape [frame] or [frame, focus]; or Warp arrays on the device, vec3 and float32, of the same
        shapes without the 3. Points that no array can reach, that are not finite, or have an intensity outside 0..1 get
        intensity 0 and are counted; phases then aim at the point's last valid position.
        Raises StrategyError for other shapes and types.
        """
        position, intensity = self._on_device(focus)
        delay = np.empty((len(position), self.transducer_count), np.float32)
        amplitude, refused = np.empty(len(position), np.float32), 0
        for rows, held in self._spans(position, intensity):
            delay[rows], amplitude[rows] = self._delays(held).numpy(), held.amplitude.numpy()
            refused += held.refused
        return Drives(delay, amplitude, refused)

    def split(self, drives: Drives) -> list[Drives]:
        """The drives of each array, in the order of `arrays`; `refused` is that of all."""
        ends = np.cumsum([array.transducer_count for array in self.arrays])[:-1]
        return [Drives(delay, drives.amplitude, drives.refused) for delay in np.split(drives.delay, ends, axis=1)]

    def pack(self, focus: FocalPoints, *, rest_start: np.ndarray | None = None) -> PackedFrames:
        """Wire bytes of the next frames, on the device; focus: as for `drive`.

        rest_start: increasing numbers of frames that begin from rest, as after `reset`; raises StrategyError for them
        where phases follow the frames before: with several focal points a frame, or a slew limit.

        >>> from palpate.render import Driver, FocalPoints
        >>> focus = FocalPoints([[0.0, 0.0, 0.2], [0.0, 0.0, 9.0]], [1.0, 1.0])  # the second one is too far
        >>> packed = Driver("pat16").pack(focus)
        >>> (frames,) = packed.frames
        >>> frames.shape, packed.refused, frames.numpy()[:, 256:].max(axis=1).tolist()  # widths of pulses
        ((2, 512), 1, [64, 0])
        """
        return self._packed(focus, self.boards, rest_start)

    def rounded(self, focus: FocalPoints) -> RoundedFrames:
        """The next frames as delays and amplitudes in the boards' steps, their calibration aside, for predictions.

        Instead of `pack`, not beside it: frames depend on those before. Raises StrategyError for arrays whose levels
        differ.
        """
        require_alike(self.arrays)
        packed = self._packed(focus, self.plain_boards)
        return _unpacked(packed.frames, self.plain_boards, packed.refused)

    def _on_device(self, focus: FocalPoints) -> tuple[Any, Any]:
        """Positions and intensities on the device, shape [frame, focus]."""
        position: Any = focus.position
        intensity: Any = focus.intensity
        if not isinstance(position, wp.array):
            position = np.asarray(position, np.float32)
            if position.shape[-1:] != (3,):
                raise StrategyError(
                    f"position must be [frame, 3] or [frame, 1..{POINTS_MOST}, 3], not {position.shape}"
                )
            # on the CPU without a copy
            position = wp.array(np.ascontiguousarray(position), dtype=wp.vec3, device=self.device, copy=False)
        if not isinstance(intensity, wp.array):
            values = np.ascontiguousarray(intensity, np.float32)
            intensity = wp.array(values, dtype=wp.float32, device=self.device, copy=False)
        if position.dtype is not wp.vec3 or intensity.dtype is not wp.float32:
            types = f"{position.dtype.__name__}, {intensity.dtype.__name__}"
            raise StrategyError(f"position must be vec3 and intensity float32, not {types}")
        if position.shape != intensity.shape or position.ndim not in (1, 2):
            raise StrategyError(
                f"position and intensity must be [frame] or [frame, focus], not {position.shape}, {intensity.shape}"
            )
        if position.ndim == 1:
            return position.contiguous().reshape((-1, 1)), intensity.contiguous().reshape((-1, 1))
        if not 1 <= position.shape[1] <= POINTS_MOST:
            raise StrategyError(f"position must have 1..{POINTS_MOST} focal points a frame, not {position.shape[1]}")
        return position, intensity

    def _packed(self, focus: FocalPoints, boards: Sequence[Any], rest_start: np.ndarray | None = None) -> PackedFrames:
        position, intensity = self._on_device(focus)
        count = len(position)
        if boards is not self.plain_boards and self.takes_points:
            return self._points_packed(position, intensity, rest_start)
        frames = tuple(wp.empty((count, own.frame_bytes), dtype=wp.uint8, device=self.device) for own in boards)
        amplitude, refused = wp.empty(count, dtype=wp.float32, device=self.device), 0
        is_direct = position.shape[1] == 1 and self._step is None  # bytes need no delays of all arrays before
        if rest_start is not None:
            if not is_direct:
                raise StrategyError("rest_start is for one focal point a frame without a slew limit")
            rest_start = np.asarray(rest_start, np.int64)
        for rows, held in self._spans(position, intensity, rest_start):
            delay = None if is_direct else self._delays(held)
            for board, frame in zip(boards, frames, strict=True):
                if delay is None:
                    pack_points(held.point.flatten(), held.amplitude, board, out=frame[rows])
                else:
                    pack_delays(delay, held.amplitude, board, out=frame[rows])
            wp.copy(amplitude[rows], held.amplitude)
            refused += held.refused
        return PackedFrames(frames, amplitude, refused)

    def _points_packed(self, position: Any, intensity: Any, rest_start: np.ndarray | None) -> PackedFrames:
        """Frames of focal points."""
        (array,), (board,) = self.arrays, self.boards
        if position.shape[1] > board.count:
            raise StrategyError(
                f"array {array.name} was opened for {board.count} focal points a frame, not {position.shape[1]}: "
                "array_model(...).with_points, or foci of a Session, asks for more"
            )
        count = len(position)
        frame = wp.empty((count, board.frame_bytes), dtype=wp.uint8, device=self.device)
        amplitude, refused = wp.empty(count, dtype=wp.float32, device=self.device), 0
        for rows, held in self._spans(position, intensity, rest_start):
            pack_foci(held.point, held.target, held.amplitude, board, out=frame[rows])
            wp.copy(amplitude[rows], held.amplitude)
            refused += held.refused
        return PackedFrames((frame,), amplitude, refused)

    def _spans(
        self, position: Any, intensity: Any, rest_start: np.ndarray | None = None
    ) -> Iterator[tuple[slice, HeldFrames]]:
        """Frames that fit into memory together, weighed and held; shape [frame, focus]."""
        frame_count, count = position.shape
        (boxes, rule), device = self._zones, self.device
        for first in range(0, frame_count, FRAMES_AT_ONCE):
            rows = slice(first, min(first + FRAMES_AT_ONCE, frame_count))
            if self._held is None or self._held[0] != count:
                points = wp.array(np.tile(np.float32(REST), (count, 1)), dtype=wp.vec3, device=device)
                self._held = count, points, wp.ones(count, dtype=wp.float32, device=device)
            size = next(size for size in (1, *SIZES) if size >= count)
            starts = self._no_rests
            if rest_start is not None:
                own = rest_start[(rest_start >= first) & (rest_start < rows.stop)] - first
                starts = wp.array(own, dtype=wp.int32, device=device)
            held = hold_points(
                position[rows],
                intensity[rows],
                boxes,
                rule,
                self._held[1:],
                size=size,
                rest_start=starts,
                rest=REST,
            )
            last = len(held.point) - 1
            self._held = count, held.point[last], held.target[last]
            yield rows, held

    def _delays(self, held: HeldFrames) -> Any:
        """Delays [turns] of some frames, one at least, shape [frame, transducer]."""
        if held.point.shape[1] > 1:
            delay = self._solved(held)
        else:
            delay = wp.empty((len(held.point), self.transducer_count), dtype=wp.float32, device=self.device)
            for board in self.plain_boards if self.takes_points else self.boards:
                focus_delays(held.point.flatten(), board, out=delay)
            if self._step is not None:
                self._gauge.lock(delay)
        if self._step is None:
            return delay
        before = wp.clone(delay[0]) if self._driven is None else self._driven
        limited = limit_slew(delay, before=before, step=self._step)
        self._driven = wp.clone(limited[-1])
        return limited

    def _solved(self, held: HeldFrames) -> Any:
        """Delays of several points a frame, in the common phase of the frames before.

        A frame with the points and ratios of the one before is not solved again: points at rest, also when modulated.
        """
        point, target = held.point.numpy(), held.target.numpy()
        new = np.ones(len(point), bool)
        new[1:] = (point[1:] != point[:-1]).any(axis=(1, 2)) | (target[1:] != target[:-1]).any(axis=1)
        gs_pat, wgs = self.strategy.iterations
        if new.all():
            delay = solve_points(held.point, held.target, self._transducers, gs_pat=gs_pat, wgs=wgs)
            self._gauge.lock(delay)
            return delay
        place = wp.array(point[new], dtype=wp.vec3, device=self.device)
        ratio = wp.array(target[new], dtype=wp.float32, device=self.device)
        delay = solve_points(place, ratio, self._transducers, gs_pat=gs_pat, wgs=wgs)
        self._gauge.lock(delay)
        index = wp.array(np.cumsum(new) - 1, dtype=wp.int32, device=self.device)
        return wp.indexedarray(delay, [index, None]).contiguous()


def boards_on(arrays: Sequence[ArrayModel], sound_speed: float, device: str, *, plain: bool = False) -> list[Any]:
    """Arrays side by side as kernels pack their frames; plain: without calibration and fixed bits."""
    boards, first = [], 0
    for array in arrays:
        layout, order = _phase_layout(array), array.wire_order
        frame_bytes = 2 * array.transducer_count if array.takes_points else array.frame_bytes
        delay_at, level_at = layout.bytes_of(frame_bytes, array.transducer_count)
        if not np.array_equal(np.sort(order), np.arange(array.transducer_count)):
            raise StrategyError(f"the wire order of {array!r} must have each of its transducers once")
        if not (np.isfinite(array.gain).all() and np.isfinite(array.delay_offset).all()):
            raise StrategyError(f"gains and delay offsets of {array!r} must be finite")
        boards.append(
            board_on(
                array.position[order],
                first + order,
                offset=np.zeros(len(order), np.float32) if plain else array.delay_offset[order],
                gain=np.ones(len(order), np.float32) if plain else array.gain[order],
                levels=(layout.levels.least, layout.levels.amplitude),
                delay_at=delay_at,
                level_at=level_at,
                fixed=np.zeros(frame_bytes, np.uint8) if plain else layout.fixed_bits(frame_bytes),
                per_metre=array.carrier / sound_speed,
                turn=layout.turn,
                later=layout.later,
                device=device,
            )
        )
        first += array.transducer_count
    return boards


def round_drives(drives: Drives, arrays: Sequence[ArrayModel], *, device: str = "cpu") -> RoundedFrames:
    """Drives of arrays side by side as their boards play them: in their steps, their calibration aside.

    Raises StrategyError for arrays of other levels and for other shapes, FrameError for a value outside 0..1.
    """
    require_alike(arrays)
    turns, level = np.ascontiguousarray(drives.delay, np.float32), np.ascontiguousarray(drives.amplitude, np.float32)
    count = sum(array.transducer_count for array in arrays)
    if turns.ndim != 2 or turns.shape[1] != count or level.shape != turns.shape[:1]:
        shapes = f"{turns.shape}, {level.shape}"
        raise StrategyError(f"delay and amplitude must be [frame, {count}] and [frame], not {shapes}")
    require_unit_range("delay", turns, "turns")
    require_unit_range("amplitude", level, "of full pressure")
    boards = boards_on(arrays, SOUND_SPEED, device, plain=True)
    delay, amplitude = wp.array(turns, device=device), wp.array(level, device=device)
    frames = tuple(wp.empty((len(delay), board.frame_bytes), dtype=wp.uint8, device=device) for board in boards)
    for board, frame in zip(boards, frames, strict=True):
        pack_delays(delay, amplitude, board, out=frame)
    return _unpacked(frames, boards, drives.refused)


def require_alike(arrays: Sequence[ArrayModel]) -> None:
    """Raise StrategyError for arrays of other levels: rounded frames have one amplitude for all."""
    levels = {_phase_layout(array).levels.amplitude.tobytes() for array in arrays}
    if len(levels) > 1:
        names = ", ".join(dict.fromkeys(array.name for array in arrays))
        raise StrategyError(f"arrays {names} have other steps of amplitude; predict arrays of one kind together")


def _phase_layout(array: ArrayModel) -> Layout:
    """Steps of delays and levels: those of the wire, or as they are assumed of an array that takes focal points."""
    layout = kind_of(array).layout
    return layout.assumed(array.transducer_count) if isinstance(layout, FocusLayout) else layout


def _own_axes(array: ArrayModel) -> np.ndarray:
    """Matrix that maps vectors of the common frame to the array's own, shape [3, 3]."""
    return matrix_of(conjugate(np.asarray(array.pose[3:], np.float64)))


def _unpacked(frames: Sequence[Any], boards: Sequence[Any], refused: int) -> RoundedFrames:
    count, device = len(frames[0]), frames[0].device
    transducer_count = sum(board.count for board in boards)
    delay = wp.empty((count, transducer_count), dtype=wp.uint8, device=device)
    amplitude = wp.empty(count, dtype=wp.float32, device=device)
    for board, frame in zip(boards, frames, strict=True):
        unpack_frames(frame, board, delay=delay, amplitude=amplitude)
    return RoundedFrames(delay, amplitude, refused)


def drive_focus(focus: FocalPoints, array: ArrayModel | str, *, sound_speed: float = SOUND_SPEED) -> Drives:
    """Delays that make every transducer's wave arrive in phase: frac(-r / lambda) turns.

    Time factor exp(+j w t): a wave lags by k r after the distance r, so the drive must lead by k r, and a farther
    transducer has a smaller delay. Every transducer gets the same amplitude. Focal points outside the focal zone,
    and any that are not finite, get amplitude 0 and are counted.

    >>> import numpy as np
    >>> from palpate.render import FocalPoints, drive_focus
    >>> focus = FocalPoints(np.float32([[0, 0, 0.2], [0, 0, 9.0]]), np.ones(2, np.float32))  # the second is too far
    >>> drives = drive_focus(focus, "emulator")
    >>> drives.delay.shape, drives.amplitude, drives.refused
    ((2, 256), array([1., 0.], dtype=float32), 1)
    """
    return Driver(array, DriveStrategy(sound_speed=sound_speed)).drive(focus)
