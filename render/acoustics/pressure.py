"""Complex pressure of driven arrays at points, in free air: no hand, no echo, no absorption, no non-linearity."""

from collections.abc import Iterator, Sequence

import numpy as np
import warp as wp

from ...device.array import ArrayModel
from ...kernels.acoustics.pressure_sum import Sources, pack_sources, sum_waves, write_waves
from ...kernels.acoustics.propagation import COLUMNS, DEPTH, ROWS, propagate_signals
from ..errors import StrategyError
from ..focal_spot import PISTON_RADIUS, SOUND_SPEED
from ..playback.drive import Drives, round_drives
from ..validation import require_number
from .emission import PlayedFrames
from .transducers import PRESSURE_AT_1M, Resonance, TransducerSet

NEAREST = 5e-3  # [m] of a point to a transducer's face: nearer, a piston is no point
POINTS_AT_ONCE = 4096  # with FRAMES_AT_ONCE frames: 32 MB of pressures
FRAMES_AT_ONCE = 1024

AnyDrives = Drives | PlayedFrames | np.ndarray


def pressure_at(
    points: np.ndarray,
    drives: AnyDrives,
    array: ArrayModel | str | Sequence[ArrayModel | str] = "emulator",
    *,
    quantised: bool = False,
    resonance: Resonance | None = None,
    update_rate: float | None = None,
    pressure_at_1m: float = PRESSURE_AT_1M,
    sound_speed: float = SOUND_SPEED,
    piston_radius: float = PISTON_RADIUS,
    device: str = "cpu",
) -> np.ndarray:
    """Complex pressure amplitude [Pa] that arrays make at points; its magnitude is the peak, not the RMS.

    p(x) = P sum_n q_n D(angle_n) / r_n exp(-j k r_n), time factor exp(+j w t), D the directivity of a piston. Within
    1e-5 of the field's peak of exact arithmetic. The same field is given behind a transducer as before it.

    Args:
        points: [m], common frame, shape [..., 3].
        drives: `Drives`; played frames; or complex amplitudes, shape [transducer] or [frame, transducer]. Several
            arrays stand side by side in their order.
        array: models in the common frame, or names.
        quantised: phases and amplitudes as the boards round them; not for complex amplitudes.
        resonance: the frames are played one after the other from silence, and the pressure is that at the end of
            each, when transducers have followed their drives as far as they can; None: they follow at once.
        update_rate: frames a second [Hz] for `resonance`; played frames have their own.
        pressure_at_1m: of a transducer at full drive, 1 m in front of it [Pa m]. Published values lie between 3.4 and
            8, so absolute pressures are right to some 50 %; 1 gives pressures relative to a single transducer's.
        sound_speed: [m/s]. piston_radius: of a transducer [m]; 0: a monopole. device: Warp's.

    Returns:
        complex64, shape [frame, ...], or [...] for amplitudes of shape [transducer].

    Raises:
        StrategyError: a point or drive that is not finite; a point within 5 mm of a transducer's face; no transducers;
            drives of another number of transducers.

    >>> import numpy as np
    >>> from palpate.render import FocalPoints, drive_focus, pressure_at
    >>> focus = np.float32([[0.03, -0.02, 0.2]])
    >>> drives = drive_focus(FocalPoints(focus, np.ones(1, np.float32)), "emulator")
    >>> aside = focus + [0.02, 0, 0]
    >>> np.abs(pressure_at([*focus, *aside], drives)).round(-1)  # [Pa], at the focal point and 2 cm aside
    array([[3470.,  520.]], dtype=float32)
    """
    transducers = TransducerSet(array, sound_speed=sound_speed, piston_radius=piston_radius)
    require_number("pressure_at_1m", pressure_at_1m, 0.0, 1000.0, unit="Pa m")
    place = require_places(points, transducers)
    drive = complex_drives(drives, transducers, quantised=quantised)
    rate = drives.update_rate if isinstance(drives, PlayedFrames) else update_rate
    if resonance is not None:
        drive = follow_drives(drive, resonance, carrier=transducers.carrier, update_rate=rate)
    out = np.empty((len(drive), len(place)), np.complex64)
    for first, part in PressureSum(transducers, device=device).blocks(place, drive):
        out[:, first : first + part.shape[1]] = part * np.float32(pressure_at_1m)
    shape = np.shape(points)[:-1]
    return out.reshape(shape if isinstance(drives, np.ndarray) and drives.ndim == 1 else (len(drive), *shape))


def require_places(points: np.ndarray, transducers: TransducerSet) -> np.ndarray:
    """Points as float64, shape [point, 3]; StrategyError for one that is not finite or at a transducer's face."""
    place = np.asarray(points, np.float64)
    if place.ndim < 1 or place.shape[-1] != 3:
        raise StrategyError(f"points must have the shape [..., 3] of x y z [m], not {place.shape}")
    place = place.reshape(-1, 3)
    bad = np.flatnonzero(~np.isfinite(place).all(axis=1))
    if len(bad):
        raise StrategyError(f"point {bad[0]} is {place[bad[0]].tolist()}: it must be finite [m]")
    reach = NEAREST + transducers.piston_radius
    low, high = transducers.position.min(axis=0) - reach, transducers.position.max(axis=0) + reach
    near = np.flatnonzero(((place >= low) & (place <= high)).all(axis=1))
    for first in range(0, len(near), POINTS_AT_ONCE):
        rows = near[first : first + POINTS_AT_ONCE]
        # From each transducer's disc to the points [m], shape [point, transducer].
        offset = place[rows][:, None] - transducers.position
        height = np.einsum("ptk,tk->pt", offset, transducers.normal)
        aside = np.sqrt(np.maximum((offset**2).sum(axis=2) - height**2, 0))
        distance = np.hypot(height, np.maximum(aside - transducers.piston_radius, 0))
        if len(rows) and distance.min() < NEAREST:
            at = int(np.argmin(distance.min(axis=1)))
            raise StrategyError(
                f"point {rows[at]} at {np.round(place[rows[at]], 5).tolist()} m is {distance[at].min():.3g} m from a "
                f"transducer's face, must be {NEAREST:g} m at least"
            )
    return place


def complex_drives(drives: AnyDrives, transducers: TransducerSet, *, quantised: bool = False) -> np.ndarray:
    """Amplitudes that delays and levels stand for, complex64, shape [frame, transducer]: a exp(-2 pi j delay).

    Transducers of gain 0 in a board file emit nothing.
    """
    count = len(transducers.position)
    if isinstance(drives, np.ndarray):
        if quantised:
            raise StrategyError("complex amplitudes cannot be quantised: boards round delays and levels (Drives)")
        out = np.atleast_2d(drives).astype(np.complex64)
        _require_width(out, count)
    else:
        delay, level = (drives.delay, drives.level) if isinstance(drives, PlayedFrames) else drives[:2]
        _require_width(delay, count)
        if isinstance(drives, PlayedFrames):
            delay = delay.astype(np.float32) / np.float32(256)
        elif quantised:
            rounded = round_drives(Drives(delay, level, 0), transducers.arrays)
            delay, level = rounded.delay.numpy() / np.float32(256), rounded.amplitude.numpy()
        turn = np.float32(-2 * np.pi) * (delay - np.rint(delay))
        out = np.empty(delay.shape, np.complex64)
        np.cos(turn, out=out.real)
        np.sin(turn, out=out.imag)
        out *= np.asarray(level, np.float32)[:, None] * transducers.works
    bad = np.argwhere(~np.isfinite(out))
    if len(bad):
        raise StrategyError(f"drive of transducer {bad[0][1]} in frame {bad[0][0]} is {out[tuple(bad[0])]}: not finite")
    return out


def _require_width(drive: np.ndarray, count: int) -> None:
    if drive.ndim != 2 or drive.shape[1] != count:
        raise StrategyError(f"drives have the shape {drive.shape}, but the arrays take [frame, {count}]")


def follow_drives(drive: np.ndarray, resonance: Resonance, *, carrier: float, update_rate: float | None) -> np.ndarray:
    """What resonant transducers emit at the end of each frame, played from silence; complex64, shapes as `drive`.

    a <- d + z (a - d) once a period of the carrier [Hz]; z: `Resonance.per_period`. update_rate: frames a second [Hz].
    Raises StrategyError for an update rate outside 0..carrier.
    """
    if update_rate is None or not 0 < update_rate <= carrier:
        raise StrategyError(f"resonance needs an update_rate in 0..{carrier:g} Hz, not {update_rate}")
    left = np.complex64(resonance.per_period(carrier) ** (carrier / update_rate))
    out = np.empty_like(drive)
    emitted = np.zeros(drive.shape[1], np.complex64)
    for f, wanted in enumerate(drive):
        emitted = wanted + left * (emitted - wanted)
        out[f] = emitted
    return out


class PressureSum:
    """Sums the waves of transducers at points, relative to the pressure of one at 1 m.

    transducers: in the common frame. device: Warp's.
    """

    def __init__(self, transducers: TransducerSet, *, device: str = "cpu") -> None:
        self._transducers, self._device = transducers, wp.get_device(device)

    def blocks(self, place: np.ndarray, drive: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
        """Blocks of points: the first one's number, and pressures, complex64, shape [frame, point].

        place: [m], shape [point, 3]. drive: complex, shape [frame, transducer]. The waves of a block are made once.
        """
        sources = self._sources(drive[0]) if len(drive) == 1 else self._sources(None)
        step = 256 * POINTS_AT_ONCE if len(drive) == 1 else POINTS_AT_ONCE
        for first in range(0, len(place) if len(drive) else 0, step):
            part = wp.array(place[first : first + step].astype(np.float32), dtype=wp.vec3, device=self._device)
            yield first, self._one(part, sources) if len(drive) == 1 else self._many(part, sources, drive)

    def _sources(self, drive: np.ndarray | None) -> Sources:
        t = self._transducers
        options = {"wavelength": t.wavelength, "radius": t.piston_radius, "device": self._device}
        return pack_sources(t.position, t.normal, drive, **options)

    def _one(self, points: wp.array, sources: Sources) -> np.ndarray:
        out = wp.empty(len(points), dtype=wp.vec2, device=self._device)
        sum_waves(points, sources, out=out)
        return out.numpy().view(np.complex64).reshape(1, -1)

    def _many(self, points: wp.array, sources: Sources, drive: np.ndarray) -> np.ndarray:
        count = sources.count
        rows, depth = len(points), 2 * count
        if self._device.is_cuda:  # tiles are whole
            rows, depth = -(-rows // ROWS) * ROWS, -(-depth // DEPTH) * DEPTH
        waves = wp.zeros((rows, depth), dtype=wp.float32, device=self._device)
        write_waves(points, sources, out=waves)
        out = np.empty((len(drive), len(points)), np.complex64)
        for first in range(0, len(drive), FRAMES_AT_ONCE):
            part = drive[first : first + FRAMES_AT_ONCE]
            out[first : first + len(part)] = self._product(waves, part, count)[:, : len(points)]
        return out

    def _product(self, waves: wp.array, drive: np.ndarray, count: int) -> np.ndarray:
        """Pressures of some frames, shape [frame, row], from waves: real parts, then imaginary ones along each row."""
        some = len(drive)
        columns = -(-2 * some // COLUMNS) * COLUMNS if self._device.is_cuda else 2 * some
        signal = np.zeros((waves.shape[1], columns), np.float32)
        signal[:count, :some], signal[count : 2 * count, :some] = np.real(drive).T, -np.imag(drive).T
        signal[:count, some : 2 * some], signal[count : 2 * count, some : 2 * some] = np.imag(drive).T, np.real(drive).T
        out = wp.empty((waves.shape[0], columns), dtype=wp.float32, device=self._device)
        propagate_signals(waves, wp.array(signal, device=self._device), out=out)
        both = out.numpy()
        return (both[:, :some] + 1j * both[:, some : 2 * some]).T
