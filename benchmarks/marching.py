"""Contours of the tube, as signed distances in 256^3 voxels, on palms of 128 x 128 cells: palpate and scikit-image.

    python benchmarks/marching.py                                  # on one core
    python benchmarks/marching.py --device cuda:0 --poses 100000
    python benchmarks/marching.py --voxels 64 --cells 32 --poses 50

Every round measures each case once, one after the other; figures are medians of the rounds, one line of JSON a case.
On the CPU all run in one thread and its CPU time counts, else wall time until the device is done. "bricks" is what
voxels are rendered with, "rows" the same volume without what tells where it is uniform. scikit-image gets the palm's
nodes and samples them by scipy's map_coordinates; "sampled before" leaves that out. `length`: mean length of a
section's contours [m]; `apart`: mean difference from palpate's, section by section. `floor`: bytes that there is no
way around (4 for each node, the least of the volume that the palm's plane touches, 28 for the pose, and the contours
written) at the rate at which this device copies in this run, bytes read and bytes written both counted.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from time import perf_counter, thread_time

import numpy as np
import warp as wp
from poses import random_poses

from palpate.kernels.brick import bricked_field
from palpate.kernels.dense import dense_field, pad_outside
from palpate.kernels.draw import Contours
from palpate.kernels.march import march_patches
from palpate.kernels.measure import measure_contours
from palpate.render.hands import Palm, frames_at

PALM = Palm()
SIDE = 0.15  # of the volume [m]
CENTER = np.array([0.0, 0.0, 0.2])
BOUNDS = np.array([CENTER - 0.066, CENTER + 0.066])
COPIED = 2**28  # bytes that a rate is measured with on a GPU, 2**24 on a CPU
OTHERS_POSES = 50  # a run of scikit-image: it takes milliseconds each


@dataclass(frozen=True)
class Size:
    """How fine everything is."""

    voxels: int = 256
    """Of the volume, each way."""
    cells: int = 128
    """Of the palm's grid, each way."""

    @property
    def step(self) -> float:
        """Of the palm's grid [m]."""
        return PALM.width / self.cells

    @property
    def affine(self) -> np.ndarray:
        """From voxel indices to the array's frame [m]."""
        spacing = SIDE / (self.voxels - 1)
        out = np.diag([spacing, spacing, spacing, 1.0])
        out[:3, 3] = CENTER - SIDE / 2
        return out


@dataclass(frozen=True)
class Ready:
    """A case with its input: what is timed, and what it gives."""

    run: Callable[[], object]
    lengths: Callable[[], np.ndarray] | None
    """Length of each section's contours of the last run [m]; None: it makes none."""
    pose_count: float
    """Sections of a run; of the floor, how many sections' bytes are copied."""
    contours: list[Contours] | None = None
    """Of the last run; None: another library's."""


@dataclass(frozen=True)
class Case:
    """One way to the contours."""

    name: str
    prepare: Callable[[np.ndarray, str, Size], Ready]
    """From poses, float32 [pose, 7], and a device."""
    needs: tuple[str, ...] = ()
    """Packages."""

    @property
    def missing(self) -> list[str]:
        """Packages that are not installed."""
        return [name for name in self.needs if find_spec(name) is None]


@dataclass(frozen=True)
class Figure:
    """What a case came to."""

    case: str
    poses: float
    microseconds: float
    """A section, median."""
    length: float | None
    apart: float | None
    rounds: int


def tube_distances(size: Size) -> np.ndarray:
    """Signed distance to a tube of radii 65 and 40 mm, 130 mm long [m], float32, shape [voxels, voxels, voxels]."""
    axis = np.linspace(-SIDE / 2, SIDE / 2, size.voxels)
    wall = np.abs(np.hypot(axis[:, None], axis[None]) - 0.0525) - 0.0125
    end = np.abs(axis) - 0.065
    a, b = wall[..., None], end[None, None]
    outer = np.hypot(np.maximum(a, 0), np.maximum(b, 0))
    return (outer + np.minimum(np.maximum(a, b), 0)).astype(np.float32)


def ours(poses: np.ndarray, device: str, size: Size, *, bricks: bool, closes: bool) -> Ready:
    """All stages; the volume, the poses and the palm are on the device."""
    field = (bricked_field if bricks else dense_field)(pad_outside(tube_distances(size)), size.affine, device)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    patch = PALM.on(device)
    kept: list[Contours] = []

    def run() -> None:
        kept.clear()
        kept.append(march_patches(field, pose, patch, step=size.step, bounds=BOUNDS, bounded=True, closes=closes))
        wp.synchronize_device(device)

    def lengths() -> np.ndarray:
        got = kept[0]
        return measure_contours(got.points, got.kind, got.polyline_start, got.section_start).numpy().sum(axis=1)

    return Ready(run, lengths, len(poses), kept)


def nodes_of(poses: np.ndarray, size: Size) -> np.ndarray:
    """Nodes of each palm as voxel indices, float64, shape [pose, 3, cells + 1, cells + 1]."""
    half = np.array([[PALM.width, PALM.length]]) / 2
    frames = frames_at(poses[:, None], half)
    t = np.linspace(-1.0, 1.0, size.cells + 1)
    along = half[0, 0] * t[:, None, None] * frames.u[:, :, None] + half[0, 1] * t[None, :, None] * frames.v[:, :, None]
    inverse = np.linalg.inv(size.affine)
    return np.moveaxis((frames.origin[:, :, None] + along) @ inverse[:3, :3].T + inverse[:3, 3], -1, 1)


def find_contours(poses: np.ndarray, device: str, size: Size, *, sampled_before: bool) -> Ready:
    """scikit-image on the same nodes; what is sampled outside the volume has the value at its border."""
    from scipy.ndimage import map_coordinates
    from skimage import measure as skimage_measure

    volume = tube_distances(size)
    nodes = nodes_of(poses[:OTHERS_POSES], size)
    scale = PALM.width / size.cells
    kept: list[list[np.ndarray]] = []

    def sampled(at: np.ndarray) -> np.ndarray:
        return map_coordinates(volume, at, order=1, mode="nearest", prefilter=False)

    before = [sampled(at) for at in nodes] if sampled_before else None

    def run() -> None:
        levels = map(sampled, nodes) if before is None else before
        kept[:] = [skimage_measure.find_contours(level, 0.0) for level in levels]

    def lengths() -> np.ndarray:
        steps = [[np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines] for lines in kept]
        return np.array([scale * sum(line) for line in steps])

    return Ready(run, lengths, len(nodes))


def floor(poses: np.ndarray, device: str, size: Size) -> Ready:
    """As many bytes copied as must be read and written: half of them read, half written."""
    few = poses[:2000]
    case = ours(few, device, size, bricks=True, closes=False)
    case.run()
    assert case.contours is not None
    written = sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in case.contours[0])
    each = 4 * (size.cells + 1) ** 2 + 28 + written / len(few)
    least = COPIED if wp.get_device(device).is_cuda else 2**24
    size_copied = min(max(least, int(each * len(poses))), 2**31)  # an array has so many at most; the rate is the same
    source = wp.zeros(size_copied // 2, dtype=wp.uint8, device=device)
    target = wp.empty_like(source)

    def run() -> None:
        wp.copy(target, source)
        wp.synchronize_device(device)

    return Ready(run, None, 2 * source.size / each)


NEEDS = ("skimage", "scipy")
CASES = (
    Case("OC, bricks", partial(ours, bricks=True, closes=False)),
    Case("OC, rows", partial(ours, bricks=False, closes=False)),
    Case("CC, bricks", partial(ours, bricks=True, closes=True)),
    Case("floor", floor),
    Case("find_contours", partial(find_contours, sampled_before=False), NEEDS),
    Case("find_contours, sampled before", partial(find_contours, sampled_before=True), NEEDS),
)


def measure(cases: tuple[Case, ...], poses: np.ndarray, device: str, rounds: int, size: Size) -> list[Figure]:
    """Figures of the cases whose packages are installed; the first one's contours are what others are compared with."""
    here = [case for case in cases if not case.missing]
    ready = [case.prepare(poses, device, size) for case in here]
    times: list[list[float]] = [[] for _ in here]
    clock = thread_time if device == "cpu" else perf_counter
    for one in ready:
        one.run()  # the first run compiles
    for _ in range(rounds):
        for one, taken in zip(ready, times, strict=True):
            started = clock()
            one.run()
            taken.append(clock() - started)
    assert ready[0].lengths is not None
    wanted = ready[0].lengths()
    figures = []
    for case, one, taken in zip(here, ready, times, strict=True):
        each = float(np.median(taken)) / one.pose_count * 1e6
        length = apart = None
        if one.lengths is not None:
            got = one.lengths()
            length, apart = float(got.mean()), float(np.abs(got - wanted[: len(got)]).mean())
        figures.append(Figure(case.name, one.pose_count, each, length, apart, rounds))
    return figures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--voxels", type=int, default=256)
    parser.add_argument("--cells", type=int, default=128)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    for case in CASES:
        if case.missing:
            print(json.dumps({"case": case.name, "skipped": f"not installed: {', '.join(case.missing)}"}))
    size = Size(options.voxels, options.cells)
    for figure in measure(CASES, random_poses(options.poses), options.device, options.rounds, size):
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
