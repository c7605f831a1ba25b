"""Convert focal points to drives of arrays: a delay for each transducer, an amplitude for each frame."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...device.array import ArrayModel
from ...device.registry import array_model
from ...kernels.driving.slew import Gauge, limit_slew
from ...kernels.driving.solve import POINTS_MOST, SIZES, solve_points
from ...kernels.driving.wave import transducers_on
from ...kernels.driving.weigh import TARGET_STEPS
from ..errors import StrategyError
from ..focal_spot import PISTON_RADIUS, SOUND_SPEED
from ..sampling.metrics import FocalPoints
from ..validation import read_fields, require_choice, require_number

REST = (0.0, 0.0, 0.2)  # [m] aim of silent frames before the first focal point
DISTANCES_AT_ONCE = 1 << 16  # 256 kB of float32: two blocks stay in the processor's cache
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


class Driver:
    """Computes the drives of one array, or of several side by side, block after block.

    A frame depends on the frames before it (held positions, common phase, slew limit), not on their division into
    blocks. Raises StrategyError for no array, arrays of different carriers, a slew limit without update rate, and an
    update rate so low that the slew limit has no effect.

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
        """Arrays in the common frame, or names; update_rate [Hz]: for a slew limit; device: Warp's, for solvers."""
        given = (arrays,) if isinstance(arrays, ArrayModel | str) else tuple(arrays)
        self.arrays = tuple(array_model(array) if isinstance(array, str) else array for array in given)
        self.strategy = strategy or DriveStrategy()
        carriers = sorted({array.carrier for array in self.arrays})
        if len(carriers) != 1:
            raise StrategyError(f"arrays must be at least one and of one carrier, not {carriers} Hz")
        self._wavelength = self.strategy.sound_speed / carriers[0]
        self._position = np.concatenate([array.position for array in self.arrays])
        self._step = self._slew_step(carriers[0], update_rate)  # [turns a frame]; None: no limit
        self._device = device
        self._transducers: Any = None
        self.reset()

    def __repr__(self) -> str:
        """One line."""
        return f"Driver({', '.join(array.name for array in self.arrays)}, {self.strategy!r})"

    def reset(self) -> None:
        """Forget the frames so far: the next one starts from rest."""
        self._held: np.ndarray | None = None  # [m], shape [focus, 3]
        self._target: np.ndarray | None = None  # targets of the last frame that was not silent, shape [focus]
        self._gauge = Gauge()
        self._now: np.ndarray | None = None  # last frame as it was driven [turns], shape [transducer]

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
        if foci > 1:
            return "driving.solve", "driving.slew"
        return () if self._step is None else ("driving.slew",)

    def drive(self, focus: FocalPoints) -> Drives:
        """Drives of the next frames.

        focus: position [m], common frame, shape [frame, 3], or [frame, focus, 3] with up to 8 focal points a frame;
        intensity 0..1, shape [frame] or [frame, focus]. Points that no array can reach, that are not finite, or have
        an intensity outside 0..1 get intensity 0 and are counted; phases then aim at the point's last valid position.
        Raises StrategyError for other shapes.
        """
        position, intensity = np.asarray(focus.position, np.float32), np.asarray(focus.intensity, np.float32)
        if position.ndim == 2:
            position, intensity = position[:, None], intensity[..., None]
        frame_count, point_count = position.shape[:2]
        if position.shape != (frame_count, point_count, 3) or not 1 <= point_count <= POINTS_MOST:
            raise StrategyError(f"position must be [frame, 3] or [frame, 1..{POINTS_MOST}, 3], not {position.shape}")
        if intensity.shape != position.shape[:2]:
            raise StrategyError(f"intensity must have shape {position.shape[:2]}, not {intensity.shape}")
        usable = np.any([array.in_reach(position) for array in self.arrays], axis=0)
        usable &= (intensity >= 0) & (intensity <= 1 + INTENSITY_TOLERANCE)
        refused = int(np.count_nonzero(~usable & (intensity != 0)))
        level = self.strategy.pressure(np.minimum(np.where(usable, intensity, np.float32(0)), np.float32(1)))
        position = self._hold(position, usable)
        amplitude = (level.max(axis=1) * self.strategy.level_max).astype(np.float32)
        return Drives(self._delays(position, level), amplitude, refused)

    def split(self, drives: Drives) -> list[Drives]:
        """The drives of each array, in the order of `arrays`; `refused` is that of all."""
        ends = np.cumsum([array.transducer_count for array in self.arrays])[:-1]
        return [Drives(delay, drives.amplitude, drives.refused) for delay in np.split(drives.delay, ends, axis=1)]

    def _hold(self, position: np.ndarray, usable: np.ndarray) -> np.ndarray:
        """Positions, each unusable one replaced by the last usable one before it, also from earlier blocks."""
        point_count = position.shape[1]
        if self._held is None or len(self._held) != point_count:
            self._held = np.tile(np.float32(REST), (point_count, 1))
        rows = np.concatenate([self._held[None], position])
        last = np.where(usable, np.arange(1, len(rows))[:, None], 0)
        held = rows[np.maximum.accumulate(last, axis=0), np.arange(point_count)]
        if len(held):
            self._held = held[-1].copy()
        return held

    def _targets(self, level: np.ndarray) -> np.ndarray:
        """Pressures relative to the largest of their frame; a silent frame repeats those of the last audible frame."""
        before = self._target
        if before is None or len(before) != level.shape[1]:
            before = np.ones(level.shape[1], np.float32)
        most = level.max(axis=1, keepdims=True)
        ratio = np.rint(level / np.where(most > 0, most, 1) * TARGET_STEPS) / np.float32(TARGET_STEPS)
        rows = np.concatenate([before[None], ratio])
        last = np.where(most[:, 0] > 0, np.arange(1, len(rows)), 0)
        held = rows[np.maximum.accumulate(last)]
        self._target = held[-1].copy()
        return held

    def _delays(self, position: np.ndarray, level: np.ndarray) -> np.ndarray:
        """Delays of frames from usable positions and levels."""
        if len(position) == 0:
            return np.empty((0, len(self._position)), np.float32)
        if position.shape[1] == 1:
            delay = focus_delays(position[:, 0], self._position, self._wavelength)
            if self._step is None:
                return delay
            return self._slew(self._locked(wp.array(delay, device=self._device)))
        target = self._targets(level)
        # a frame with the points and ratios of the one before is not solved again: points at rest, also when modulated
        new = np.ones(len(position), bool)
        new[1:] = (position[1:] != position[:-1]).any(axis=(1, 2)) | (target[1:] != target[:-1]).any(axis=1)
        delay = self._locked(self._solve(position[new], target[new]))
        return self._slew(delay if new.all() else delay[np.cumsum(new) - 1])

    def _locked(self, delay: wp.array) -> np.ndarray:
        """Delays, with each frame's common phase turned to that of the frame before."""
        self._gauge.lock(delay)
        return delay.numpy()

    def _solve(self, position: np.ndarray, target: np.ndarray) -> wp.array:
        """Delays for several points a frame."""
        if self._transducers is None:
            self._transducers = transducers_of(self.arrays, self.strategy, self._device)
        size = solved_size(position.shape[1])
        spare = size - position.shape[1]
        points = np.concatenate([position, np.repeat(position[:, :1], spare, axis=1)], axis=1)
        gs_pat, wgs = self.strategy.iterations
        return solve_points(
            wp.array(points, dtype=wp.vec3, device=self._device),
            wp.array(np.pad(target, ((0, 0), (0, spare))), dtype=wp.float32, device=self._device),
            self._transducers,
            gs_pat=gs_pat,
            wgs=wgs,
        )

    def _slew(self, delay: np.ndarray) -> np.ndarray:
        """Delays, with their changes limited if the strategy has a slew limit."""
        if self._step is None:
            return delay
        before = wp.array(delay[0] if self._now is None else self._now, device=self._device)
        limited = limit_slew(wp.array(delay, device=self._device), before=before, step=self._step).numpy()
        self._now = limited[-1].copy()
        return limited


def transducers_of(arrays: Sequence[ArrayModel], strategy: DriveStrategy, device: str) -> Any:
    """Transducers of arrays side by side, on a device, as solvers take them."""
    return transducers_on(
        np.concatenate([array.position for array in arrays]),
        np.concatenate([array.normal for array in arrays]),
        wavelength=strategy.sound_speed / arrays[0].carrier,
        radius=strategy.piston_radius,
        device=device,
    )


def solved_size(point_count: int) -> int:
    """How many points a frame has when it is solved: the least of SIZES that holds them."""
    return next(size for size in SIZES if size >= point_count)


def focus_delays(position: np.ndarray, transducer: np.ndarray, wavelength: float) -> np.ndarray:
    """Delays frac(-r / wavelength) [turns] that focus each frame at its point, float32, shape [frame, transducer].

    position and transducer [m], float32, shape [frame, 3] and [transducer, 3]; wavelength [m]. Within 1e-4 turns up to
    1 m. In NumPy: 0.55 us a frame of 256, 2.2 % of a core at 40 kHz; a Warp kernel takes 0.07 us, but 2 s to compile
    before the first frame can be played.
    """
    # Each ufunc does one operation, which IEEE 754 rounds. So a delay depends on its own point and transducer only. A
    # matrix product, |p|^2 - 2 p t + |t|^2, takes 0.8 times as long, but BLAS rounds it by shape, row and processor.
    of_points, of_transducers = np.ascontiguousarray(position.T)[:, :, None], np.ascontiguousarray(transducer.T)
    of_transducers = [one[:1] if (one == one[:1]).all() else one for one in of_transducers]  # often all have one z
    turns = np.empty((len(position), len(transducer)), np.float32)
    frames_at_once = max(1, DISTANCES_AT_ONCE // max(1, len(transducer)))
    spare = np.empty((min(frames_at_once, len(position)), len(transducer)), np.float32)
    for start in range(0, len(position), frames_at_once):
        rows = slice(start, start + frames_at_once)
        block, other = turns[rows], spare[: len(turns[rows])]
        np.subtract(of_points[0, rows], of_transducers[0], out=block)
        block *= block
        for of_point, of_transducer in zip(of_points[1:, rows], of_transducers[1:], strict=True):
            apart = np.subtract(of_point, of_transducer, out=other[:, : len(of_transducer)])
            block += np.multiply(apart, apart, out=apart)
        np.sqrt(block, out=block)
        block *= np.float32(1 / wavelength)
        np.subtract(np.ceil(block, out=other), block, out=block)
    return turns


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
