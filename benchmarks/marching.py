"""Contours of the tube, as signed distances in 256^3 voxels, on palms of 128 x 128 cells: palpate and scikit-image.

    python benchmarks/marching.py                                  # on one core
    python benchmarks/marching.py --device cuda:0 --poses 100000
    python benchmarks/marching.py --voxels 64 --cells 32 --poses 50

Every round measures each case once, one after the other; figures are medians of the rounds, one line of JSON a case.
On the CPU all run in one thread and its CPU time counts, else wall time until the device is done. scikit-image gets
the palm's nodes and samples them by scipy's map_coordinates; "sampled before" leaves that out. `length`: mean length
of a section's contours [m]; `apart`: mean difference from palpate's, section by section. `floor`: bytes that there is
no way around (4 for each node, the least of the volume that the palm's plane touches, 28 for the pose, and the contours
written) at the rate at which this device copies in this run, bytes read and bytes written both counted.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial

import numpy as np
import warp as wp
from turns import Case, Curves, copying, installed, measure_curves

from palpate.kernels.contours import Contours, measure_contours
from palpate.kernels.fields.bricked_grid import bricked_field, pad_outside
from palpate.kernels.march.contours import march_patches
from palpate.render.bench.cases import random_poses
from palpate.render.hands.hand import Palm, frames_at

PALM = Palm()
SIDE = 0.15  # of the volume [m]
CENTER = np.array([0.0, 0.0, 0.2])
BOUNDS = np.array([CENTER - 0.066, CENTER + 0.066])
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


def tube_distances(size: Size) -> np.ndarray:
    """Signed distance to a tube of radii 65 and 40 mm, 130 mm long [m], float32, shape [voxels, voxels, voxels]."""
    axis = np.linspace(-SIDE / 2, SIDE / 2, size.voxels)
    wall = np.abs(np.hypot(axis[:, None], axis[None]) - 0.0525) - 0.0125
    end = np.abs(axis) - 0.065
    a, b = wall[..., None], end[None, None]
    outer = np.hypot(np.maximum(a, 0), np.maximum(b, 0))
    return (outer + np.minimum(np.maximum(a, b), 0)).astype(np.float32)


def marched(poses: np.ndarray, device: str, size: Size, *, closes: bool) -> Callable[[], Contours]:
    """All stages; the volume, the poses and the palm are on the device."""
    field = bricked_field(pad_outside(tube_distances(size)), size.affine, device)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    patch = PALM.on(device)
    return lambda: march_patches(field, pose, patch, step=size.step, bounds=BOUNDS, bounded=True, closes=closes)


def ours(poses: np.ndarray, device: str, size: Size, *, closes: bool) -> Curves:
    """palpate, until the device is done."""
    march = marched(poses, device, size, closes=closes)
    kept: list[Contours] = []

    def run() -> None:
        kept.clear()
        kept.append(march())
        wp.synchronize_device(device)

    def lengths() -> np.ndarray:
        got = kept[0]
        return measure_contours(got).numpy().sum(axis=1)

    return Curves(run, lengths, len(poses))


def nodes_of(poses: np.ndarray, size: Size) -> np.ndarray:
    """Nodes of each palm as voxel indices, float64, shape [pose, 3, cells + 1, cells + 1]."""
    half = np.array([[PALM.width, PALM.length]]) / 2
    frames = frames_at(poses[:, None], half)
    t = np.linspace(-1.0, 1.0, size.cells + 1)
    along = half[0, 0] * t[:, None, None] * frames.u[:, :, None] + half[0, 1] * t[None, :, None] * frames.v[:, :, None]
    inverse = np.linalg.inv(size.affine)
    return np.moveaxis((frames.origin[:, :, None] + along) @ inverse[:3, :3].T + inverse[:3, 3], -1, 1)


def find_contours(poses: np.ndarray, device: str, size: Size, *, sampled_before: bool) -> Curves:
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

    return Curves(run, lengths, len(nodes))


def floor(poses: np.ndarray, device: str, size: Size) -> Curves:
    """As many bytes copied as must be read and written: half of them read, half written."""
    few = poses[:2000]
    contours = marched(few, device, size, closes=False)()
    columns = (getattr(contours, name) for name in vars(contours))
    written = sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in columns if isinstance(a, wp.array))
    each = 4 * (size.cells + 1) ** 2 + 28 + written / len(few)
    run, times = copying(each * len(poses), device)
    return Curves(run, None, len(poses) * times)


NEEDS = ("skimage", "scipy")
CASES = (
    Case("OC", partial(ours, closes=False)),
    Case("CC", partial(ours, closes=True)),
    Case("floor", floor),
    Case("find_contours", partial(find_contours, sampled_before=False), NEEDS),
    Case("find_contours, sampled before", partial(find_contours, sampled_before=True), NEEDS),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--voxels", type=int, default=256)
    parser.add_argument("--cells", type=int, default=128)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    inputs = random_poses(options.poses), options.device, Size(options.voxels, options.cells)
    for figure in measure_curves(installed(CASES), options.device, options.rounds, *inputs):
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
