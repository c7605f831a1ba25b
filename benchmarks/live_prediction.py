"""Error of predicted and smoothed poses over recorded hands: what prediction gains on a tracker's and a host's delay.

    python benchmarks/live_prediction.py FOLDER                       # FOLDER has leap/*.npz (PALPATE_TEST_DATA)
    python benchmarks/live_prediction.py FOLDER --dampings 0 20 --horizons 0.02

Prints the tables of docs/measured/live.md. Each recorded pose is shaped as it would be live (`PoseShaping`), and
compared with the recording itself at the pose's time plus the horizon: linear between frames, slerp for rotations. So
the recording's noise is part of every figure. For a lower rate frames are left out, so no pose that goes in is
interpolated.
Figures are rms and 95th percentile over the frames of all recordings, in mm and in degrees of the palm's orientation.
It also runs small as a test (tests/house/test_benchmarks.py).
"""

import argparse
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from palpate.datasets import load_recording
from palpate.render.live.sources.shaping import PoseShaping, Prediction, Smoothing

HORIZONS = (0.005, 0.01, 0.02, 0.04)  # [s]
RATES = (60.0, 90.0, 110.0)  # [Hz]
DAMPINGS = (0.0, 5.0, 10.0, 20.0, 40.0, 80.0)  # [1/s]
CUTOFFS = (8.0, 15.0, 30.0)  # [Hz]
USUAL = 90.0  # [Hz], of the tables of dampings and cutoffs
RECORDED = 110.0  # [Hz]; at this rate all frames are used


@dataclass(frozen=True)
class Clip:
    """A palm's recorded poses."""

    time: np.ndarray
    """[s], shape [pose]."""
    pose: np.ndarray
    """x y z [m] and quaternion xyzw, shape [pose, 7]."""

    def thinned(self, rate: float) -> "Clip":
        """The frame that was seen last at each k / rate; the whole clip at the recorded rate."""
        if rate >= RECORDED:
            return self
        at = np.arange(self.time[0], self.time[-1], 1.0 / rate)
        chosen = np.unique(np.searchsorted(self.time, at + 1e-9, side="right") - 1)
        return Clip(self.time[chosen], self.pose[chosen])

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Positions [m] and orientations at any times within the clip."""
        position = np.stack([np.interp(time, self.time, column) for column in self.pose[:, :3].T], axis=1)
        return position, Slerp(self.time, Rotation.from_quat(self.pose[:, 3:]))(time)


@dataclass(frozen=True)
class ShapingError:
    """Errors of shaped poses."""

    position: np.ndarray
    """[mm], shape [pose]."""
    angle: np.ndarray
    """[degree], shape [pose]."""

    @property
    def figures(self) -> tuple[float, float, float, float]:
        """Rms and 95th percentile of positions [mm], and those of angles [degree]."""
        both = (self.position, self.angle)
        return tuple(value for own in both for value in (np.sqrt(np.mean(own**2)), np.percentile(own, 95)))


@cache
def recorded_clip(path: Path) -> Clip:
    """The palm of a recording."""
    hand = load_recording(path)
    return Clip(hand.time[hand.present], hand.skin_pose())


def shaped_poses(clip: Clip, shaping: PoseShaping) -> np.ndarray:
    """A clip's poses, shaped one after the other as if they came live, shape [pose, 7]."""
    shaping.reset()
    return np.stack([shaping.shaped(time, pose) for time, pose in zip(clip.time, clip.pose, strict=True)])


def measure(clips: Iterable[Clip], shaping: PoseShaping, horizon: float, rate: float) -> ShapingError:
    """Errors of all clips' shaped poses at a rate; those whose horizon is beyond the clip's end are left out."""
    position, angle = [], []
    for clip in clips:
        given = clip.thinned(rate)
        shaped = shaped_poses(given, shaping)
        inside = given.time + horizon <= clip.time[-1]
        x, turn = clip.at(given.time[inside] + horizon)
        position.append(1e3 * np.linalg.norm(shaped[inside, :3] - x, axis=1))
        angle.append(np.degrees((turn * Rotation.from_quat(shaped[inside, 3:]).inv()).magnitude()))
    return ShapingError(np.concatenate(position), np.concatenate(angle))


def jitter(clips: Iterable[Clip], shaping: PoseShaping) -> tuple[float, float]:
    """Median change of a shaped pose's step from one frame to the next [mm, degree]: how much the hand shakes."""
    steps, turns = [], []
    for clip in clips:
        shaped = shaped_poses(clip, shaping)
        turn = Rotation.from_quat(shaped[:, 3:])
        steps.append(1e3 * np.linalg.norm(np.diff(shaped[:, :3], 2, axis=0), axis=1))
        turns.append(np.degrees(np.linalg.norm(np.diff((turn[1:] * turn[:-1].inv()).as_rotvec(), axis=0), axis=1)))
    return tuple(float(np.median(np.concatenate(own))) for own in (steps, turns))


def cost(clips: Iterable[Clip], shaping: PoseShaping) -> tuple[float, float]:
    """CPU time of a pose [us]: median and 99th percentile."""
    spent = []
    for clip in clips:
        shaping.reset()
        for time, pose in zip(clip.time, clip.pose, strict=True):
            start = clock.thread_time_ns()
            shaping.shaped(time, pose)
            spent.append(1e-3 * (clock.thread_time_ns() - start))
    return float(np.median(spent)), float(np.percentile(spent, 99))


def cells(error: ShapingError) -> str:
    """Figures as cells of a table."""
    figures = error.figures
    return f"{figures[0]:.2f}, {figures[1]:.2f} mm; {figures[2]:.2f}, {figures[3]:.2f}°"


def row(*parts: str) -> str:
    return f"| {' | '.join(parts)} |"


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--horizons", type=float, nargs="+", default=HORIZONS)
    parser.add_argument("--rates", type=float, nargs="+", default=RATES)
    parser.add_argument("--dampings", type=float, nargs="+", default=DAMPINGS)
    parser.add_argument("--cutoffs", type=float, nargs="+", default=CUTOFFS)
    options = parser.parse_args()
    clips = [recorded_clip(path) for path in sorted((options.folder / "leap").glob("*.npz"))]
    print_horizons(clips, options.horizons, options.rates)
    print_dampings(clips, options.horizons, options.dampings)
    print_cutoffs(clips, options.horizons, options.cutoffs)


def print_horizons(clips: Sequence[Clip], horizons: Sequence[float], rates: Sequence[float]) -> None:
    print(row("poses a second", "horizon", "none", "constant velocity", "damped"))
    for rate in rates:
        for horizon in horizons:
            shapings = [None, Prediction(horizon, 0.0), Prediction(horizon)]
            found = [cells(measure(clips, PoseShaping(own), horizon, rate)) for own in shapings]
            print(row(f"{rate:g}", f"{1e3 * horizon:g} ms", *found))


def print_dampings(clips: Sequence[Clip], horizons: Sequence[float], dampings: Sequence[float]) -> None:
    print(row("damping", *(f"{1e3 * horizon:g} ms" for horizon in horizons)))
    for damping in dampings:
        pairs = [(horizon, PoseShaping(Prediction(horizon, damping))) for horizon in horizons]
        print(row(f"{damping:g} /s", *(cells(measure(clips, shaping, own, USUAL)) for own, shaping in pairs)))


def print_cutoffs(clips: Sequence[Clip], horizons: Sequence[float], cutoffs: Sequence[float]) -> None:
    print(row("smoothing", "prediction", "jitter", *(f"{1e3 * horizon:g} ms" for horizon in horizons), "CPU time"))
    for smoothing in [None, *(Smoothing(cutoff) for cutoff in cutoffs)]:
        for is_predicted in (False, True):
            pairs = [(own, PoseShaping(Prediction(own) if is_predicted else None, smoothing)) for own in horizons]
            label = "none" if smoothing is None else f"{smoothing.cutoff:g} Hz, {1e3 * smoothing.delay:.0f} ms late"
            found = [cells(measure(clips, shaping, own, USUAL)) for own, shaping in pairs]
            steps, turns = jitter(clips, pairs[0][1])
            half, most = cost(clips, pairs[0][1])
            kind = "damped" if is_predicted else "none"
            print(row(label, kind, f"{steps:.2f} mm, {turns:.2f}°", *found, f"{half:.0f}, {most:.0f} us"))


if __name__ == "__main__":
    main()
