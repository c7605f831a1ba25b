"""Complex pressure at points: palpate's kernels beside NumPy, and what errors they have.

    python benchmarks/pressure.py                                      # on one core
    python benchmarks/pressure.py --device cuda:0 --points 1000000

256 transducers 10.5 mm apart, driven to a focus at (30, -20, 200) mm, random points 20 to 400 mm above them. On the CPU
all run in one thread and its CPU time counts, by turns; on CUDA wall time until the device is done, the points being
there. `error`: the greatest |difference| from float64 with exact Bessel functions over the greatest |p|, at 2000 of the
points. Other packages: benchmarks/pressure_peers.py.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import warp as wp
from turns import Case, installed, seconds_by_turns

from palpate.kernels.acoustics.pressure_sum import pack_sources, sum_waves, write_waves
from palpate.kernels.acoustics.propagation import COLUMNS, DEPTH, ROWS, propagate_signals
from palpate.kernels.driving.wave import piston_polynomial
from palpate.render.acoustics.transducers import TransducerSet

FOCUS = (0.03, -0.02, 0.2)
COMPARED = 2000  # points
FRAMES = 64  # of the cases of many frames
NUMPY_AT_ONCE = 512  # points: their waves stay in the processor's cache


@dataclass(frozen=True)
class Sums:
    """A case with its input."""

    run: Callable[[], object]
    pressure: Callable[[], np.ndarray]
    """Complex, of the last run, shape [point]; of many frames the first one's."""
    pair_count: int
    """Points times transducers, times frames."""


@dataclass(frozen=True)
class PairFigure:
    """What a case came to."""

    case: str
    pairs: int
    """Points times transducers, times frames."""
    milliseconds: float
    nanoseconds_a_pair: float
    error: float
    rounds: int


def arrangement() -> tuple[TransducerSet, np.ndarray]:
    """Transducers, and the drives that focus them."""
    transducers = TransducerSet("emulator")
    return transducers, np.exp(2j * np.pi / transducers.wavelength * transducers.distances(np.array([FOCUS]))[0])


def random_points(count: int) -> np.ndarray:
    """Points [m], float32, the first at the focus."""
    points = np.random.default_rng(19).uniform([-0.1, -0.1, 0.02], [0.1, 0.1, 0.4], (count, 3)).astype(np.float32)
    points[0] = FOCUS
    return points


def by_kernel(points: np.ndarray, device: str) -> Sums:
    t, drive = arrangement()
    sources = pack_sources(t.position, t.normal, drive, wavelength=t.wavelength, radius=t.piston_radius, device=device)
    there = wp.array(points, dtype=wp.vec3, device=device)
    out = wp.empty(len(points), dtype=wp.vec2, device=device)

    def run() -> None:
        sum_waves(there, sources, out=out)
        wp.synchronize_device(device)

    return Sums(run, lambda: out.numpy().view(np.complex64).ravel(), len(points) * len(t.position))


def by_kernel_of_many(points: np.ndarray, device: str) -> Sums:
    """Waves once, then a product for all frames."""
    t, drive = arrangement()
    count = len(t.position)
    few = points[: max(len(points) // FRAMES // ROWS, 1) * ROWS]
    few = np.resize(few, (-(-len(few) // ROWS) * ROWS, 3))
    sources = pack_sources(t.position, t.normal, wavelength=t.wavelength, radius=t.piston_radius, device=device)
    there = wp.array(few, dtype=wp.vec3, device=device)
    signal = np.zeros((-(-2 * count // DEPTH) * DEPTH, -(-2 * FRAMES // COLUMNS) * COLUMNS), np.float32)
    drives = drive[:, None] * np.exp(2j * np.pi * np.arange(FRAMES) / FRAMES)
    signal[:count, :FRAMES], signal[count : 2 * count, :FRAMES] = drives.real, -drives.imag
    signal[:count, FRAMES : 2 * FRAMES], signal[count : 2 * count, FRAMES : 2 * FRAMES] = drives.imag, drives.real
    on_device = wp.array(signal, device=device)
    waves = wp.zeros((len(few), len(signal)), dtype=wp.float32, device=device)
    out = wp.empty((len(few), signal.shape[1]), dtype=wp.float32, device=device)

    def run() -> None:
        write_waves(there, sources, out=waves)
        propagate_signals(waves, on_device, out=out)
        wp.synchronize_device(device)

    def pressure() -> np.ndarray:
        both = out.numpy()
        return both[:, 0] + 1j * both[:, FRAMES]

    return Sums(run, pressure, len(few) * count * FRAMES)


def by_numpy(points: np.ndarray, device: str, *, whole: bool) -> Sums:
    """float32, |x - t|^2 as one product, the same polynomial; or float64 as `TransducerSet.waves` has it."""
    t, drive = arrangement()
    few = points[: 20_000 if whole else 5000]
    kept = [np.empty(0, np.complex64)]
    position = t.position.astype(np.float32)
    coefficients = np.float32(piston_polynomial(2 * np.pi * t.piston_radius / t.wavelength))
    right = np.vstack([-2 * position.T, np.ones((1, 256)), (position**2).sum(axis=1)[None]]).astype(np.float32)
    narrow = drive.astype(np.complex64)

    def some(x: np.ndarray) -> np.ndarray:
        if not whole:
            return t.waves(x.astype(float)) @ drive
        left = np.column_stack([x, (x**2).sum(axis=1), np.ones(len(x))]).astype(np.float32)
        square = left @ right
        sine = 1 - x[:, 2:] ** 2 / square
        a, b, c, d = coefficients
        distance = np.sqrt(square)
        level = (1 + sine * (a + sine * (b + sine * (c + sine * d)))) / distance
        angle = distance * np.float32(-2 * np.pi / t.wavelength)
        return (level * np.cos(angle)) @ narrow + 1j * ((level * np.sin(angle)) @ narrow)

    def run() -> None:
        kept[0] = np.concatenate([some(few[k : k + NUMPY_AT_ONCE]) for k in range(0, len(few), NUMPY_AT_ONCE)])

    return Sums(run, lambda: kept[0], len(few) * 256)


CASES = (
    Case("kernel, one frame", by_kernel),
    Case(f"kernel and product, {FRAMES} frames", by_kernel_of_many),
    Case("NumPy, float32", partial(by_numpy, whole=True)),
    Case("NumPy, float64", partial(by_numpy, whole=False)),
)


def exact(points: np.ndarray) -> np.ndarray:
    """Pressures in float64, by Bessel functions."""
    from scipy.special import j1

    t, drive = arrangement()
    offset = points[:, None].astype(float) - t.position
    distance = np.linalg.norm(offset, axis=2)
    k = 2 * np.pi / t.wavelength
    x = np.maximum(k * t.piston_radius * np.linalg.norm(offset[..., :2], axis=2) / distance, 1e-9)
    return (2 * j1(x) / x / distance * np.exp(-1j * k * distance)) @ drive


def measure(cases: tuple[Case, ...], points: np.ndarray, device: str, rounds: int) -> list[PairFigure]:
    """Figures of the cases."""
    ready = [case.prepare(points, device) for case in cases]
    seconds = seconds_by_turns([one.run for one in ready], device, rounds)
    wanted = exact(points[:COMPARED])
    figures = []
    for case, one, taken in zip(cases, ready, seconds, strict=True):
        got = one.pressure()[:COMPARED]
        error = float(np.abs(got - np.resize(wanted, len(got))).max() / np.abs(wanted).max())
        figures.append(PairFigure(case.name, one.pair_count, 1e3 * taken, 1e9 * taken / one.pair_count, error, rounds))
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--points", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    cases = CASES if options.device == "cpu" else CASES[:2]
    for figure in measure(tuple(installed(cases)), random_points(options.points), options.device, options.rounds):
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
