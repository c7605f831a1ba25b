"""Focal points -> drives of arrays: a delay for each transducer, an amplitude for each frame."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from ...device.array import ArrayModel
from ...kernels.driving.slew import limit_slew, lock_gauge
from ...kernels.driving.solve import POINTS_MOST, SIZES, solve_points
from ...kernels.driving.wave import transducers_on
from ..errors import StrategyError
from ..sampling.contour_sampling import FocalPoints
from ..validation import read_fields, require_choice, require_number

SOUND_SPEED = 343.0  # [m/s] at 20 degrees C; 331.3 + 0.606 T
PISTON_RADIUS = 4.5e-3  # [m] of a transducer of 10 mm
REST = (0.0, 0.0, 0.2)  # [m] where silent frames aim before there was a focal point
CHUNK = 512  # frames; at 256 transducers their distances stay in the cache
OVER = 1e-6  # by which rounding may lift an intensity above 1
TARGET_STEPS = 1 << 16  # to which ratios of pressures are rounded, lest modulation make new problems of the same ratios

# Amplitudes: rms error of 4 foci, median of random frames. Change: of a transducer's delay from frame to frame while 4
# foci go 7 m/s at 40 kHz, mean over transducers, 90 % of frames below it | largest. WGS hops between solutions that
# are as good, since each frame is solved from the start; one focus changes by 0.004 turns.
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
    refused: int  # focal points outside the focal zones, or of an intensity that is none: silenced


@dataclass(frozen=True)
class DriveStrategy:
    """How focal points become drives.

    A frame with one focal point is focused exactly, and its amplitude is the point's. A frame with several gives all
    transducers one common amplitude, the greatest of the points', and phases such that the pressures at the points are
    in the ratio of theirs: intensities scaled by a factor scale every pressure by it, and a lone point at 1 is the
    array at full power. The points of a frame share what the array emits, so each gets less than it would alone (of 4,
    about half).

    Raises StrategyError for a value out of its range, with field, value and bound.
    """

    amplitude: str = "pressure"
    """What an intensity is: relative pressure amplitude, or relative radiation force (pressure = its square root)."""
    solver: str = "gs-pat+wgs"
    """For frames with several focal points: naive, gs-pat, wgs, gs-pat+wgs."""
    gs_pat_iterations: int | None = None
    """Of a solver that has GS-PAT; by default 20 alone, 10 before WGS."""
    wgs_iterations: int | None = None
    """Of a solver that has WGS; by default 20 alone, 6 after GS-PAT."""
    slew: float | None = None
    """Most that a transducer's delay changes [turns] in a period of the carrier, hence carrier / update_rate times as
    much in a frame, which must be less than half a turn. The phase that all transducers share is locked first, so that
    4/256 quietens jumps and follows a focal point at 7 m/s whichever way it goes. None: no limit."""
    sound_speed: float = SOUND_SPEED
    """[m/s]"""
    level_max: float = 1.0
    """Amplitude that intensity 1 is given, relative to what the array can."""
    piston_radius: float = PISTON_RADIUS
    """Of a transducer [m], for the solvers: how it directs its sound; 0 is a monopole."""

    def __post_init__(self) -> None:
        """Refuse what is not a drive."""
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
        """Of GS-PAT and of WGS, defaults filled in."""
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
    """Makes the drives of one array, or of several side by side, block after block.

    What a frame gets depends on the frames before it (held positions, phase gauge, slew), not on how they are cut into
    blocks. Raises StrategyError for no array, arrays of different carriers, or a slew limit without update rate or at
    one so low that it would limit nothing.
    """

    def __init__(
        self,
        arrays: ArrayModel | Sequence[ArrayModel],
        strategy: DriveStrategy | None = None,
        *,
        update_rate: float | None = None,
        device: str = "cpu",
    ) -> None:
        """Arrays in the common frame; update_rate [Hz] is needed for a slew limit; device: Warp's, for solvers."""
        self.arrays = (arrays,) if isinstance(arrays, ArrayModel) else tuple(arrays)
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

    def reset(self) -> None:
        """Forget the frames so far: the next one starts from rest."""
        self._held: np.ndarray | None = None  # [m], shape [focus, 3]
        self._target: np.ndarray | None = None  # of the last frame that was not silent, shape [focus]
        self._unlocked: np.ndarray | None = None  # last frame before its gauge was locked [turns], shape [transducer]
        self._turned = 0.0  # by how much it was turned as a whole [turns]
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

    def drive(self, focus: FocalPoints) -> Drives:
        """Drives of the next frames.

        focus: position [m], common frame, shape [frame, 3], or [frame, focus, 3] with up to 8 focal points a frame;
        intensity 0..1, shape [frame] or [frame, focus]. Points that no array can reach, that are not finite, or have
        an intensity outside 0..1 get intensity 0 and are counted; phases then aim at where the point was before.
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
        usable &= (intensity >= 0) & (intensity <= 1 + OVER)
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
        """Positions, those that are not usable replaced by the last one before them, of earlier blocks too."""
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
        """Pressures relative to the greatest of their frame; a silent frame has those of the last that was not."""
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
        """Delays of frames, of which points and level are usable."""
        if len(position) == 0:
            return np.empty((0, len(self._position)), np.float32)
        if position.shape[1] == 1:
            delay = focus_delays(position[:, 0], self._position, self._wavelength)
            if self._step is None:
                return delay
            return self._slew(self._locked(wp.array(delay, device=self._device)))
        target = self._targets(level)
        # frames that ask for the same as the one before are solved once: still points, whatever their modulation
        new = np.ones(len(position), bool)
        new[1:] = (position[1:] != position[:-1]).any(axis=(1, 2)) | (target[1:] != target[:-1]).any(axis=1)
        delay = self._locked(self._solve(position[new], target[new]))
        return self._slew(delay if new.all() else delay[np.cumsum(new) - 1])

    def _locked(self, delay: wp.array) -> np.ndarray:
        """Delays, each frame turned as a whole to be in phase with the one before."""
        last = delay[-1:].numpy()[0].copy()  # before it is turned in place
        before = wp.array(delay[:1].numpy()[0] if self._unlocked is None else self._unlocked, device=self._device)
        self._turned = lock_gauge(delay, before=before, turned=self._turned)
        self._unlocked = last
        return delay.numpy()

    def _solve(self, position: np.ndarray, target: np.ndarray) -> wp.array:
        """Delays for several points a frame."""
        if self._transducers is None:
            self._transducers = transducers_on(
                self._position,
                np.concatenate([array.normal for array in self.arrays]),
                wavelength=self._wavelength,
                radius=self.strategy.piston_radius,
                device=self._device,
            )
        size = next(size for size in SIZES if size >= position.shape[1])
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
        """Delays, their changes limited where the strategy says so."""
        if self._step is None:
            return delay
        before = wp.array(delay[0] if self._now is None else self._now, device=self._device)
        limited = limit_slew(wp.array(delay, device=self._device), before=before, step=self._step).numpy()
        self._now = limited[-1].copy()
        return limited


def focus_delays(position: np.ndarray, transducer: np.ndarray, wavelength: float) -> np.ndarray:
    """Delays frac(-r / wavelength) [turns] that focus each frame at its point, float32, shape [frame, transducer].

    position and transducer [m], shape [frame, 3] and [transducer, 3]; wavelength [m]. Within 1e-4 turns up to 1 m.
    In NumPy: 0.24 us a frame of 256, 1 % of a core at 40 kHz; a Warp kernel takes 0.07 us, but 2 s to compile before
    the first frame can be played.
    """
    # |p - t|^2 as one matrix product: 2.3 times as fast as differences
    one = np.float32(1)
    left = np.column_stack([position, np.einsum("ij,ij->i", position, position), np.full(len(position), one)])
    square = np.einsum("ij,ij->i", transducer, transducer)
    right = np.ascontiguousarray(np.column_stack([-2 * transducer, np.full(len(transducer), one), square]).T)
    turns = np.empty((len(position), len(transducer)), np.float32)
    whole = np.empty((min(CHUNK, len(position)), len(transducer)), np.float32)
    for start in range(0, len(position), CHUNK):
        part = turns[start : start + CHUNK]
        np.matmul(left[start : start + CHUNK], right, out=part)
        np.sqrt(np.maximum(part, 0, out=part), out=part)
        part *= np.float32(-1 / wavelength)
        part -= np.floor(part, out=whole[: len(part)])
    return turns


def drive_focus(focus: FocalPoints, array: ArrayModel, *, sound_speed: float = SOUND_SPEED) -> Drives:
    """Delays that make every transducer's wave arrive in phase: frac(-r / lambda) turns.

    Time factor exp(+j w t): a wave that has come the distance r lags by k r, so the drive leads by it, and the farther
    transducer has the smaller delay. Every transducer gets the same amplitude. Focal points outside the focal zone,
    and any that are not finite, get amplitude 0 and are counted.
    """
    return Driver(array, DriveStrategy(sound_speed=sound_speed)).drive(focus)
