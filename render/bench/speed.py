"""`palpate bench`: seconds a pose of contours on this machine, by object and strategy."""

import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
import warp as wp

from ...datasets.known_names import unknown_name
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..hands.hand import Palm
from ..intersection.mesh_section import intersect
from ..objects.mesh.solid_mesh import MeshObject
from ..runtime.span_workers import warp_device
from ..runtime.warp_start import start_warp
from ..strategies.intersection_strategy import PRESETS, IntersectionStrategy, load_strategy
from ..terminal import bars, console
from ..terminal.foreign_text import show_table
from .cases import bench_object, random_poses

CHUNK_POINTS = {True: 200_000_000, False: 10_000_000}  # of one launch, by whether it is on CUDA: 2.6 GB and 130 MB
CHUNK_POSES = {True: 4_000_000, False: 20_000}  # 4 GB of working arrays; 20 MB, which caches like
POSES_LEAST, POSES_MOST = 1_000, 200_000  # on the CPU
POSES_CUDA, POSES_CUDA_LARGE = 4_000_000, 200_000  # on a GPU, and there of a mesh of at least ...
TRIANGLES_LARGE = 50_000
SECONDS = 0.5  # of one repetition on the CPU
REPEATS = 5
PROBE_POSES = 500  # rendered to estimate how many points a pose has


class OwnTurn:
    """Renders all poses on a device and leaves the results there; poses are uploaded beforehand."""

    def __init__(self, mesh: MeshObject, hand: Palm, pose: np.ndarray, strategy: IntersectionStrategy, device: str):
        self.mesh, self.hand, self.strategy, self.device = mesh, hand, strategy, device
        is_cuda = wp.get_device(device).is_cuda
        probe = wp.array(pose[:: max(1, len(pose) // PROBE_POSES)], dtype=wp.transform, device=device)
        points = intersect(mesh, hand, probe, strategy)[0].point_count / len(probe)
        size = max(1, min(CHUNK_POSES[is_cuda], int(CHUNK_POINTS[is_cuda] / max(points, 1.0))))
        self._parts = [
            wp.array(pose[first : first + size], dtype=wp.transform, device=device)
            for first in range(0, len(pose), size)
        ]

    def __call__(self, timing: dict[str, float] | None = None) -> list[ContourBatch]:
        """All chunks; returns when the device is done."""
        batches = [intersect(self.mesh, self.hand, part, self.strategy, timing=timing)[0] for part in self._parts]
        wp.synchronize_device(self.device)
        return batches

    def stages(self) -> dict[str, float]:
        """Share of the time of each stage; each is waited for, which costs a little."""
        timing: dict[str, float] = {}
        self(timing)
        total = sum(timing.values())
        return {stage: seconds / total for stage, seconds in timing.items()} if total else {}


def timed(call: Callable[[], Any]) -> tuple[float, float]:
    """CPU time of the process and wall time of one call [s].

    The result is freed after the clocks are read. The device is then waited for, since a GPU's pool gives memory back
    to the system at its next synchronisation, which would otherwise count as the next call's time.
    """
    cpu, wall = process_time(), perf_counter()
    kept = call()
    out = process_time() - cpu, perf_counter() - wall
    del kept
    wp.synchronize()
    return out


@dataclass(frozen=True)
class SpeedRow:
    """Speed of an object with a strategy; medians over the repetitions."""

    object: str
    triangles: int
    strategy: str
    poses: int
    hit: float
    """Share of poses with contours."""
    points_per_pose: float
    seconds_per_pose: float
    """Wall time, results left on the device [s]."""
    poses_per_second: float
    cpu_seconds_per_pose: float
    """CPU time of the whole process, all threads [s]."""


def measure_speed(name: str, strategy: str, device: str, poses: int | None = None, repeats: int = REPEATS) -> SpeedRow:
    """Render random palms several times; poses: None for as many as the device needs to show its speed.

    Raises StrategyError for an unknown object or strategy, MeshError where the strategy needs a closed object.
    """
    mesh = bench_object(name)
    count = fitting_poses(mesh, strategy, device) if poses is None else poses
    own = OwnTurn(mesh, Palm(), random_poses(count), load_strategy(strategy), device)
    batches = own()  # compiles kernels, too
    hit = sum(np.count_nonzero(np.diff(batch.numpy().pose_start)) for batch in batches)
    points = sum(batch.point_count for batch in batches)
    del batches
    cpu, wall = np.median(np.array([timed(own) for _ in range(repeats)]), axis=0).tolist()
    return SpeedRow(
        name, len(mesh.faces), strategy, count, hit / count, points / count, wall / count, count / wall, cpu / count
    )


def fitting_poses(mesh: MeshObject, strategy: str, device: str) -> int:
    """Poses that fill a GPU; on the CPU as many as take about `SECONDS`, rounded down to 1, 2 or 5 times 10^n."""
    if device != "cpu":
        return POSES_CUDA_LARGE if len(mesh.faces) >= TRIANGLES_LARGE else POSES_CUDA
    own = OwnTurn(mesh, Palm(), random_poses(POSES_LEAST), load_strategy(strategy), device)
    own()
    return fitting_count(timed(own)[1] / POSES_LEAST, SECONDS, POSES_LEAST, POSES_MOST)


def fitting_count(seconds_a_pose: float, seconds: float, least: int, most: int) -> int:
    """Poses that take about so long, as 1, 2 or 5 times a power of ten, within bounds."""
    wanted = max(1.0, seconds / max(seconds_a_pose, 1e-12))
    decade = 10 ** int(np.log10(wanted))
    rounded = max(step * decade for step in (1, 2, 5) if step * decade <= wanted)
    return max(least, min(most, rounded))


def run_bench(objects: str, strategies: str, device: str, poses: int | None, *, as_json: bool) -> None:
    """Measure each object with each strategy, and show one table.

    Raises StrategyError for unknown names before anything is measured.
    """
    names, asked = _names_in(objects), _names_in(strategies.lower())
    for name in asked:
        if name not in PRESETS:
            raise StrategyError(unknown_name("strategy", name, PRESETS))
    start_warp()
    for name in names:
        bench_object(name)
    device = warp_device(device)
    rows: list[SpeedRow] = []
    with bars.progress_bar("bench", quiet=as_json) as bar:
        for name in names:
            for strategy in asked:
                rows.append(measure_speed(name, strategy, device, poses))
                bar(len(rows), len(names) * len(asked))
    machine = machine_facts(device)
    if as_json:
        values = {"palpate": version("palpate"), "warp": wp.__version__, "machine": machine}
        console.show_values(values | {"rows": [asdict(row) for row in rows]}, as_json=True, title="")
        return
    cells = [
        (
            row.object,
            f"{row.triangles:,}",
            row.strategy.upper(),
            f"{row.poses:,}",
            f"{100 * row.hit:.0f} %",
            f"{1e6 * row.seconds_per_pose:.3g}",
            f"{row.poses_per_second:,.0f}",
        )
        for row in rows
    ]
    title = f"contours of random palms on {machine['device']} ({machine['cpu']})"
    show_table(title, cells, ("object", "triangles", "", "poses", "hit", "us a pose", "poses/s"))


def _names_in(text: str) -> list[str]:
    """Names separated by commas, each once."""
    return list(dict.fromkeys(name.strip() for name in text.split(",")))


def machine_facts(device: str) -> dict[str, str]:
    """Names of the processor, the device and the system."""
    target = wp.get_device(device)
    processor = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        processor = names[0] if names else processor
    facts = {"cpu": processor, "device": target.name if target.is_cuda else "cpu", "system": platform.platform()}
    if target.is_cuda:
        facts["cuda_driver"] = ".".join(str(part) for part in wp.get_cuda_driver_version() or ())
    return facts
