"""Audible noise of an array that plays: what its resonant transducers make of each frame, heard by a microphone.

Phases that change from frame to frame make the emitted power flicker, as transducers are resonant (Suzuki et al. 2020,
IEEE ToH 13(1), 87-93), and the air demodulates it. The model: each transducer is a one-pole low-pass of its drive's
envelope (`Resonance`); the squared pressure at virtual sources is what is heard of them; the microphone adds them up by
1 / distance. docs/measured/noise.md compares it with the founding paper's Fig. 4 and with what else was tried.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from ...datasets.rigid import rotate
from ...device.array import ArrayModel
from ...kernels.acoustics.propagation import DEPTH, ROWS, propagate_signals, split_lags, sum_late_power, wave_rows
from ...kernels.acoustics.resonance import DeviceFrames, emit_frames
from ..errors import StrategyError
from ..focal_spot import SOUND_SPEED
from ..validation import require_choice, require_number
from .emission import PlayedFrames
from .spectrum import NoiseSignal
from .transducers import Resonance, TransducerSet

ABOVE, ASIDE = 0.07, 0.15  # [m] the founding paper's microphone: over the face, and from the array's edge (4.3.2)
KINDS = ("beam", "transducers")
PERIODS = {"cpu": 4096, "cuda": 1 << 17}  # of a block: 8 MiB of 256 transducers, 256 MiB
SOURCES_MOST = 100_000
DURATION_LEAST = 0.1  # [s]: some spectra of 1024 samples
CLEARANCE = 0.02  # [m] of sources and the microphone to transducers, and of the microphone to sources
FARTHEST = 30.0  # [m] of the microphone
TRIES = 20  # draws of all sources, of which those near transducers are left out
DELAYED_MOST = 4000  # periods by which one source may be later than another: 34 m


Progress = Callable[[int, int], object]
"""Takes how many periods are done, and how many there are."""


@dataclass(frozen=True)
class NoiseModel:
    """Where audible noise comes from, and where it is heard.

    Levels are relative: no microphone was calibrated, so only differences between renderings mean anything.

    >>> from palpate.render import NoiseModel
    >>> model = NoiseModel(sources=1000)
    >>> model.kind
    'beam'
    """

    kind: str = "beam"
    """beam: squared pressure at virtual sources in the beam. transducers: emitted power of each transducer."""
    resonance: Resonance = field(default_factory=Resonance)
    sources: int = 2000
    """Virtual sources of the beam. 2,000 elsewhere change OC - CC by 0.2 dB; 50,000 raise it by 2 dB, since the steady
    part of a smooth contour's noise is that of few sources."""
    box: tuple[tuple[float, float, float], tuple[float, float, float]] = ((-0.1, -0.1, 0.03), (0.1, 0.1, 0.4))
    """Corners of the box that holds them [m], in the frame of the first array: by default over its aperture."""
    seed: int = 0
    """Of the sources' places."""
    is_late: bool = False
    """Whether a farther source of the beam is heard later; transducers always are."""
    microphone: tuple[float, float, float] | None = None
    """[m], in the frame of the first array; None: the founding paper's, 7 cm over the face and 15 cm aside of it."""
    sound_speed: float = SOUND_SPEED
    """[m/s]"""

    def __post_init__(self) -> None:
        """Raise StrategyError for a value out of its range."""
        require_choice("kind", self.kind, KINDS)
        require_number("sources", self.sources, 1, SOURCES_MOST, whole=True)
        require_number("seed", self.seed, 0, 2**63 - 1, whole=True)
        require_number("sound_speed", self.sound_speed, 300.0, 400.0, unit="m/s (speed of sound in air)")
        box = _finite_numbers(self.box, (2, 3))
        if box is None or not (box[0] < box[1]).all():
            raise StrategyError(f"box must be two corners [m], the first one below the second, not {self.box}")
        if self.microphone is None:
            return
        place = _finite_numbers(self.microphone, (3,))
        if place is None or np.abs(place).max() > FARTHEST:
            raise StrategyError(f"microphone must be three numbers [m] up to {FARTHEST:g}, not {self.microphone}")

    def places(self, transducers: TransducerSet) -> np.ndarray:
        """Where the noise comes from [m], shape [source, 3]."""
        if self.kind == "transducers":
            return transducers.position
        rng, low, high = np.random.default_rng(self.seed), *np.array(self.box, float)
        found = np.zeros((0, 3))
        for _ in range(TRIES):
            drawn = _from_array(transducers, rng.uniform(low, high, (self.sources, 3)))
            found = np.concatenate([found, drawn[transducers.nearest(drawn) >= CLEARANCE]])
            if len(found) >= self.sources:
                return found[: self.sources]
        raise StrategyError(f"box {self.box} m leaves no room {CLEARANCE:g} m away from all transducers")

    def microphone_of(self, transducers: TransducerSet) -> np.ndarray:
        """The microphone's place [m], shape [3]."""
        place = self.microphone
        if place is None:
            first = transducers.arrays[0]
            own = (first.unplaced or first).position
            place = (float(own[:, 0].max()) + 5.25e-3 + ASIDE, 0.0, ABOVE)  # half a pitch beyond the last transducer
        return _from_array(transducers, np.array([place], float))[0]


def _finite_numbers(value: object, shape: tuple[int, ...]) -> np.ndarray | None:
    """Finite numbers of a shape; None for anything else."""
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.shape == shape and np.isfinite(numbers).all() else None


def _from_array(transducers: TransducerSet, place: np.ndarray) -> np.ndarray:
    """Places in the first array's frame [m], shape [place, 3], in the common one."""
    pose = transducers.arrays[0].pose
    return pose[:3] + rotate(pose[3:], place)


class NoiseListener:
    """Turns played frames of some arrays into the signal at the microphone.

    arrays: models in the common frame, or names. model: where noise comes from. device: Warp's.
    Raises StrategyError for a microphone within 2 cm of a source of noise or of a transducer.

    >>> import numpy as np
    >>> from palpate.render import NoiseListener, PlayedFrames
    >>> still = PlayedFrames(np.zeros((4000, 256), np.uint8), np.ones(4000, np.float32), update_rate=40_000.0)
    >>> listener = NoiseListener("emulator")
    >>> heard = listener.listen(still)
    >>> bool(np.ptp(heard.samples[400:]) < 1e-5 * heard.samples.max())  # a focal point at rest is silent
    True
    """

    def __init__(
        self,
        arrays: ArrayModel | str | Sequence[ArrayModel | str],
        model: NoiseModel | None = None,
        *,
        device: str = "cpu",
    ) -> None:
        self.model = model or NoiseModel()
        self.transducers = TransducerSet(arrays, sound_speed=self.model.sound_speed)
        self._device = wp.get_device(device)
        place, microphone = self.model.places(self.transducers), self.model.microphone_of(self.transducers)
        distance = np.linalg.norm(place - microphone, axis=1)
        away = min(float(distance.min()), float(self.transducers.nearest(microphone[None])[0]))
        if away < CLEARANCE:
            raise StrategyError(
                f"microphone {np.round(microphone, 4).tolist()} m is {away:.3g} m from a source of noise, must be "
                f"{CLEARANCE:g} m at least"
            )
        lag = (distance - distance.min()) / self.model.sound_speed * self.transducers.carrier
        if not self.model.is_late and self.model.kind == "beam":
            lag = np.zeros_like(lag)
        if lag.max() > DELAYED_MOST:
            raise StrategyError(f"microphone {microphone.tolist()} m: sources are up to {np.ptp(distance):.3g} m apart")
        weight = 1 / distance / len(place)
        if self.model.kind == "transducers":
            weight = weight * self.transducers.works
        self._rows, lag, weight = self._propagation(place, lag, weight)
        whole, share = split_lags(lag, weight)
        self._lead = int(whole.max()) + 2  # periods that are looked back
        self._pole = self.model.resonance.per_period(self.transducers.carrier)
        self._lag = wp.array(whole, device=self._device)
        self._weight = wp.array(share, dtype=wp.vec2, device=self._device)

    def __repr__(self) -> str:
        """One line."""
        return f"NoiseListener({', '.join(array.name for array in self.transducers.arrays)}, {self.model!r})"

    def _propagation(
        self, place: np.ndarray, lag: np.ndarray, weight: np.ndarray
    ) -> tuple[wp.array | None, np.ndarray, np.ndarray]:
        """Matrix from transducers to what is squared and added up; with lag and weight of each of these."""
        if self.model.kind == "transducers":
            return None, lag, weight
        parts = [self.transducers.waves(place[first : first + 1024]) for first in range(0, len(place), 1024)]
        waves = np.concatenate(parts)
        if not lag.any() and len(place) > waves.shape[1]:  # as many combinations of transducers do for all sources
            value, vector = np.linalg.eigh((waves.conj().T * weight) @ waves)
            waves, weight = (np.sqrt(np.maximum(value, 0)) * vector).conj().T, np.ones(len(value))
            lag = np.zeros(len(value))
        spare = -len(waves) % (ROWS // 2)  # tiles are whole: places and signals that are added are 0
        rows = wave_rows(np.pad(waves, ((0, spare), (0, 0))))
        rows = np.pad(rows, ((0, 0), (0, -rows.shape[1] % DEPTH)))
        return wp.array(rows, device=self._device), np.pad(lag, (0, spare)), np.pad(weight, (0, spare))

    def listen(self, frames: PlayedFrames, progress: Progress | None = None) -> NoiseSignal:
        """The signal while frames are played from silence; progress: called with periods done and periods in all.

        Raises StrategyError for less than 0.1 s, and for frames of another number of transducers.
        """
        if frames.delay.shape[1] != len(self.transducers.position):
            raise StrategyError(
                f"frames are of {frames.delay.shape[1]} transducers, the arrays have {len(self.transducers.position)}"
            )
        if len(frames.level) != len(frames.delay) or not np.isfinite(frames.level).all():
            raise StrategyError(
                f"frames must have one finite level each, not {len(frames.level)} levels of {len(frames.delay)} frames"
            )
        if frames.delay.dtype != np.uint8:
            raise StrategyError(f"delays must be bytes in 1/256 turn, not {frames.delay.dtype}")
        require_number("update_rate", frames.update_rate, 1.0, self.transducers.carrier, unit="Hz")
        if frames.duration < DURATION_LEAST:
            raise StrategyError(f"{frames.duration:g} s are too short for a spectrum: {DURATION_LEAST:g} s are needed")
        delay = wp.array(np.ascontiguousarray(frames.delay), device=self._device, copy=False)
        level = wp.array(np.ascontiguousarray(frames.level), device=self._device, copy=False)
        return self.signal_of(DeviceFrames(delay, level), frames.update_rate, progress)

    def signal_of(self, frames: DeviceFrames, update_rate: float, progress: Progress | None = None) -> NoiseSignal:
        """The same of frames on the listener's device, which are not looked at."""
        heard = self.hear(frames, update_rate, progress)
        return NoiseSignal(heard.numpy().astype(np.float64), self.transducers.carrier)

    def hear(self, frames: DeviceFrames, update_rate: float, progress: Progress | None = None) -> wp.array:
        """The signal of frames on the listener's device, left there: float32, a sample each period of the carrier."""
        rate = update_rate / self.transducers.carrier
        period_count = round(frames.level.shape[0] / rate)
        size = PERIODS["cuda" if self._device.is_cuda else "cpu"]
        kept = wp.zeros((2 * len(self._lag), self._lead + size), dtype=wp.float32, device=self._device)
        fresh = kept[:, self._lead :]
        signal = fresh
        if self._rows is not None:
            signal = wp.zeros((self._rows.shape[1], size), dtype=wp.float32, device=self._device)
        out = wp.empty(period_count, dtype=wp.float32, device=self._device)
        for first in range(0, period_count, size):
            end = min(first + size, period_count)
            emit_frames(frames, rate=rate, pole=self._pole, begin=first, end=end, origin=first, out=signal)
            if self._rows is not None:
                propagate_signals(self._rows, signal, out=fresh)
            sum_late_power(kept, self._lag, self._weight, skip=self._lead, out=out[first:end])
            wp.copy(kept[:, : self._lead], kept[:, size:])  # what has not arrived yet
            if progress is not None:
                progress(end, period_count)
        return out
