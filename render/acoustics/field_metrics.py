"""Numbers of pressure for a whole contour file: a sample of its poses, each drawn once around while it stays."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ..contour_input import takes_batches
from ..errors import StrategyError
from ..focal_spot import focal_width
from ..hands.hand import Hand
from ..hands.stored_hand import hand_from
from ..playback.drive import Driver, DriveStrategy
from ..playback.focal_points import ContourRows, sampling_for
from ..playback.placed_arrays import PlacedArray, load_rig
from ..sampling.strategy import SamplingStrategy
from ..validation import require_number
from .drawn_frames import DrawnPose, cycle_of, drawn_row, drives_of, is_reachable
from .pressure import NEAREST, PressureSum, complex_drives, follow_drives
from .radiation import mean_square
from .sampled_places import SampledPlane, sample_patches, sample_plane
from .skin_print import CELLS, points_along, print_on, unevenness
from .transducers import PRESSURE_AT_1M, Resonance, TransducerSet

SAMPLE = 20  # poses
AROUND = 0.2  # [m]; side of the square in the palm's plane in which foci elsewhere are looked for
FRAMES_LOOKED_AT = 64  # of a cycle, for these
SETTLED = 2.55  # time that a resonance needs, times its pole: 16 nepers


@dataclass(frozen=True)
class PressureMetrics:
    """Pressure of a rendering, means over sampled poses; a value is None where no sampled pose has it.

    >>> from palpate.render import pressure_metrics, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0.06, 0.2]), "oc").save("cube.h5", overwrite=True)
    >>> pressure_metrics(path)
    PressureMetrics(1 poses, 3140 Pa at the focal point, 0.00945 N, 92 % of it along the contours)
    """

    poses: int
    """Sampled poses; all have contours."""
    seed: int
    """Of the sample."""
    focal_width: float | None
    """Mean FWHM of p^2 across the focus at the palms' places [m]."""
    focus_pressure: float | None
    """Pressure amplitude at the focal point, as the boards round it [Pa], right to some 50 %; mean over frames."""
    focus_pressure_least: float | None
    """Least of these over all frames that emit [Pa]."""
    force: float | None
    """Mean radiation force on the patches of skin [N]."""
    share_on_contour: float | None
    """Share of that force within one focal width of the contour."""
    unevenness: float | None
    """Coefficient of variation along the contour of the mean |p|^2: 0 is even."""
    elsewhere: float | None
    """Largest |p|^2 farther than one focal width from all focal points, in the palm's plane, over that at the focal
    point: side lobes, grating lobes, unwanted foci. A focus is some 7 cm long, so a tilted palm has more."""
    speed_factor: float | None
    """Pressure at the moving focal point with resonant transducers, over that of transducers that follow at once."""

    def __repr__(self) -> str:
        """One line."""
        if self.focus_pressure is None or self.share_on_contour is None:
            return f"PressureMetrics({self.poses} poses, no pressure)"
        return (
            f"PressureMetrics({self.poses} poses, {self.focus_pressure:.0f} Pa at the focal point, {self.force:.3g} N, "
            f"{100 * self.share_on_contour:.0f} % of it along the contours)"
        )

    def as_dict(self) -> dict[str, float | int | None]:
        """By name, for JSON."""
        return asdict(self)


@takes_batches
def pressure_metrics(
    path: str | Path,
    *,
    array: str | Sequence[PlacedArray] = "emulator",
    sampling: SamplingStrategy | str | None = None,
    drive: DriveStrategy | None = None,
    poses: int = SAMPLE,
    seed: int = 0,
    resonance: Resonance | None = None,
    pressure_at_1m: float = PRESSURE_AT_1M,
    device: str = "cpu",
    progress: Callable[[int, int], object] | None = None,
) -> PressureMetrics:
    """Pressure, force and what lies elsewhere for a random sample of a contour file's poses that have contours.

    Each pose is drawn for one cycle as if it stayed. Neither the hand's shadow nor its echo is in it.

    Args:
        path: a contour file of a hand of planes.
        array: name of an array, or several placed arrays.
        sampling: how contours become focal points; by default stm at the array's own update rate.
        drive: how focal points become drives.
        poses: most of the sample. seed: of its choice.
        resonance: of the transducers, for `speed_factor`; by default a pole of 1 kHz.
        pressure_at_1m: see `pressure_at`. device: Warp's.
        progress: called with poses done and all.

    Raises:
        ContourFileError: no contour file. StrategyError: a hand mesh, and values out of range.

    >>> from palpate.render import pressure_metrics, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0.06, 0.2]), "oc").save("cube.h5", overwrite=True)
    >>> found = pressure_metrics(path)
    >>> round(found.focus_pressure, -2), round(found.speed_factor, 2)  # [Pa]; 3 % less as the focal point moves
    (3100.0, 0.97)
    """
    require_number("poses", poses, 1, 1_000_000, whole=True)
    arrays = load_rig(array) if isinstance(array, str) else tuple(array)
    strategy = sampling_for(sampling, arrays)
    meter = PoseMeter(arrays, strategy, drive, resonance or Resonance(), pressure_at_1m, device)
    with ContourFile(path) as file:
        hand = hand_from(file.hand, file.hand_arrays())
        return measure_sample(file, hand, file.metrics()["length"], meter, poses=poses, seed=seed, progress=progress)


def measure_sample(
    rows: ContourRows,
    hand: Hand,
    length: np.ndarray,
    meter: "PoseMeter",
    *,
    poses: int = SAMPLE,
    seed: int = 0,
    progress: Callable[[int, int], object] | None = None,
) -> PressureMetrics:
    """The same of contours on a hand; length: of each pose's contours [m]."""
    candidates = np.flatnonzero(length > 0)
    some = min(poses, len(candidates))
    chosen = np.sort(np.random.default_rng(seed).choice(candidates, some, replace=False)) if some else candidates
    found = []
    for done, index in enumerate(chosen.tolist()):
        found.append(meter.measure(drawn_row(rows, index, hand)))
        if progress is not None:
            progress(done + 1, len(chosen))
    return PressureMetrics(
        poses=len(found),
        seed=seed,
        focal_width=_mean([each["focal_width"] for each in found]),
        focus_pressure=_mean([each["focus_pressure"] for each in found]),
        focus_pressure_least=min(
            (each["focus_pressure_least"] for each in found if each["focus_pressure_least"] is not None), default=None
        ),
        **{
            name: _mean([each[name] for each in found])
            for name in ("force", "share_on_contour", "unevenness", "elsewhere", "speed_factor")
        },
    )


def _mean(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


class PoseMeter:
    """Measures the pressure of single poses."""

    def __init__(
        self,
        arrays: tuple[PlacedArray, ...],
        sampling: SamplingStrategy,
        drive: DriveStrategy | None,
        resonance: Resonance,
        pressure_at_1m: float,
        device: str,
    ) -> None:
        models = [placed.model for placed in arrays]
        strategy = drive or DriveStrategy()
        self._arrays, self._sampling, self._resonance = arrays, sampling, resonance
        self._driver = Driver(models, strategy, update_rate=sampling.update_rate, device=device)
        self._transducers = TransducerSet(
            models, sound_speed=strategy.sound_speed, piston_radius=strategy.piston_radius
        )
        self._field = PressureSum(self._transducers, device=device)
        self._scale = pressure_at_1m

    def measure(self, drawn: DrawnPose) -> dict[str, float | None]:
        """Numbers of one pose, by the names of `PressureMetrics`."""
        focus = cycle_of(drawn, self._sampling)
        drive = complex_drives(drives_of(self._driver, focus), self._transducers, quantised=True)
        position = focus.position.reshape(len(drive), -1, 3)
        emits = is_reachable(position, focus.intensity.reshape(position.shape[:2]), self._arrays)
        width = width_at(drawn.pose[:3], self._transducers)
        planes = planes_of(drawn, width / CELLS)
        planes = [plane for plane in planes if len(self._clear_of_faces(plane.points)) == len(plane.points)]
        skin = print_on(planes, self._field, drive, pressure_at_1m=self._scale)
        lines = drawn.polylines()
        along, _ = mean_square(self._field, points_along(lines, width / CELLS), drive)
        at_focus = self._at_focus(position, drive)
        reached = at_focus[emits]
        return {
            "focal_width": width,
            "focus_pressure": self._scale * float(reached.mean()) if reached.size else None,
            "focus_pressure_least": self._scale * float(reached.min()) if reached.size else None,
            "force": skin.force,
            "share_on_contour": skin.share_within(lines, width),
            "unevenness": unevenness(along),
            "elsewhere": self._elsewhere(drawn, position, emits, at_focus, drive, width),
            "speed_factor": self._speed_factor(position, emits, at_focus, drive),
        }

    def _at_focus(self, position: np.ndarray, drive: np.ndarray) -> np.ndarray:
        """|p| of each frame at its own focal points, shape [frame, focus]."""
        out = np.empty(position.shape[:2])
        for first in range(0, len(position), 256):
            rows = slice(first, first + 256)
            waves = self._transducers.waves(position[rows].reshape(-1, 3).astype(float))
            waves = waves.reshape(*position[rows].shape[:2], -1)
            out[rows] = np.abs(np.einsum("fmt,ft->fm", waves, drive[rows]))
        return out

    def _elsewhere(
        self,
        drawn: DrawnPose,
        position: np.ndarray,
        emits: np.ndarray,
        at_focus: np.ndarray,
        drive: np.ndarray,
        width: float,
    ) -> float | None:
        frames = np.flatnonzero(emits.all(axis=1))
        if not len(frames):
            return None
        frames = frames[np.unique(np.linspace(0, len(frames) - 1, FRAMES_LOOKED_AT).astype(int))]
        patch = drawn.hand.frames(drawn.pose[None], drawn.index)
        plane = sample_plane(patch.origin[0, 0], patch.u[0, 0], patch.v[0, 0], (AROUND, AROUND), width / CELLS)
        place = self._clear_of_faces(plane.points)
        most = 0.0
        for first, pressure in self._field.blocks(place, drive[frames]):
            points = place[first : first + pressure.shape[1]]
            apart = np.linalg.norm(points[None, :, None] - position[frames][:, None], axis=3).min(axis=2)
            square = np.where(apart > width, np.real(pressure) ** 2 + np.imag(pressure) ** 2, 0)
            most = max(most, float((square / at_focus[frames].max(axis=1)[:, None] ** 2).max(initial=0.0)))
        return most

    def _clear_of_faces(self, place: np.ndarray) -> np.ndarray:
        """Points from which all transducers are 5 mm and a piston's radius away."""
        from scipy.spatial import KDTree

        apart = KDTree(self._transducers.position).query(place)[0]
        return place[apart > NEAREST + self._transducers.piston_radius]

    def _speed_factor(
        self, position: np.ndarray, emits: np.ndarray, at_focus: np.ndarray, drive: np.ndarray
    ) -> float | None:
        if not emits.any():
            return None
        rate = self._sampling.update_rate
        again = 1 + int(np.ceil(SETTLED / self._resonance.pole * rate / len(drive)))
        emitted = follow_drives(
            np.tile(drive, (again, 1)), self._resonance, carrier=self._transducers.carrier, update_rate=rate
        )[-len(drive) :]
        moving = self._at_focus(position, emitted)
        return float((moving[emits] / np.maximum(at_focus[emits], 1e-9)).mean())


def width_at(place: np.ndarray, transducers: TransducerSet) -> float:
    """Width of a focal point at a place [m], shape [3]: of the array that focuses best there [m]."""
    widths = []
    for array in transducers.arrays:
        try:
            size = focal_width(
                np.round(np.asarray(place, float), 2),  # centimetres: few are computed, and kept
                array=array,
                speed_of_sound=transducers.sound_speed,
                piston_radius=transducers.piston_radius,
            )
        except StrategyError:  # behind this array, or too near
            continue
        widths.append(size.width)
    return min(widths, default=focal_width().width)


def planes_of(drawn: DrawnPose, spacing: float) -> list[SampledPlane]:
    """Grids over the patches of a drawn pose's hand; raises StrategyError for a hand mesh, which has none."""
    if drawn.hand.described().get("kind") == "mesh":
        raise StrategyError("pressure on a hand mesh is not computed: it needs a hand of planes (palm, planes)")
    return sample_patches(drawn.hand.frames(drawn.pose[None], drawn.index), spacing)
