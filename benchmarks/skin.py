"""Where the tube crosses a hand mesh of 5,248 triangles: palpate, and VTK where it is installed.

    python benchmarks/skin.py                              # on one core
    python benchmarks/skin.py --device cuda:0 --poses 20000

Every round measures each case once, one after the other; figures are medians of the rounds, one line of JSON a case.
On the CPU all run in one thread and its CPU time counts, else wall time until the device is done. `length`: mean length
of the curves of a pose [m], `apart`: mean difference from palpate's, pose by pose. VTK gets hands that are placed
already. "rows" has vertices of its own for each pose. Floors are the bytes that must be read (vertices) and written
(signs, contours), at the rate at which this device copies in this run.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from time import perf_counter, thread_time
from typing import Any

import numpy as np
import warp as wp
from poses import random_poses

from palpate.datasets.hand_shape import hand_shape
from palpate.datasets.shapes import shape
from palpate.kernels.draw import Contours
from palpate.kernels.measure import measure_contours
from palpate.kernels.skin import skin_contours
from palpate.kernels.skin_sign import WORD
from palpate.kernels.solid import mesh_field
from palpate.render.mesh_hand import MeshHand
from palpate.render.objects import MeshObject

COPIED = 2**28  # bytes that a rate is measured with on a GPU, 2**24 on a CPU
VTK_POSES = 20  # a run: it takes milliseconds each


@dataclass(frozen=True)
class Ready:
    """A case with its input: what is timed, and what it gives."""

    run: Callable[[], object]
    lengths: Callable[[], np.ndarray] | None
    """Length of each pose's curves of the last run [m]; None: it makes none."""
    pose_count: int


@dataclass(frozen=True)
class Case:
    """One way to the curves."""

    name: str
    prepare: Callable[[np.ndarray, str], Ready]
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
    poses: int
    microseconds: float
    """A pose, median."""
    length: float | None
    apart: float | None
    rounds: int


def tube() -> MeshObject:
    return MeshObject(*shape("tube"), name="tube")


def hand(row_count: int = 0) -> MeshHand:
    """The project's hand, all of its skin; with rows, a hand that grows by 10 %."""
    skin = hand_shape(detail=2)
    if not row_count:
        return MeshHand(skin.vertices, skin.faces)
    return MeshHand(skin.vertices * np.linspace(1, 1.1, row_count, dtype=np.float32)[:, None, None], skin.faces)


def ours(poses: np.ndarray, device: str, *, rows: bool, closes: bool) -> Ready:
    """All stages; what does not change from pose to pose is on the device, and the poses' vertices are."""
    thing, skin = tube(), hand(len(poses) if rows else 0)
    field = mesh_field(thing.on(device), thing.bounds)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    vertex, region = skin.vertices_on(device, 0, len(poses)), skin.skin_on(device)
    kept: list[Contours] = []

    def run() -> None:
        kept[:] = [skin_contours(field, pose, region, vertex, closes=closes, bounds=thing.bounds)]
        wp.synchronize_device(device)

    def lengths() -> np.ndarray:
        got = kept[0]
        return measure_contours(got.points, got.kind, got.polyline_start, got.section_start).numpy().sum(axis=1)

    return Ready(run, lengths, len(poses))


def floor(poses: np.ndarray, device: str, *, rows: bool) -> Ready:
    """As many bytes copied as must be read and written: half of them read, half written."""
    case = ours(poses, device, rows=rows, closes=True)
    case.run()
    thing, skin = tube(), hand()
    field = mesh_field(thing.on(device), thing.bounds)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    got = skin_contours(field, pose, skin.skin_on(device), skin.vertices_on(device), closes=True)
    vertex_count = skin.skin_on(device).vertex_count
    read = 12 * vertex_count * (len(poses) if rows else 1) + 28 * len(poses)
    written = len(poses) * 4 * -(-vertex_count // WORD) + sum(
        array.size * wp.types.type_size_in_bytes(array.dtype) for array in got
    )
    least = COPIED if wp.get_device(device).is_cuda else 2**24
    times = max(1, least // (read + written))  # so that the rate is that of memory
    source = wp.zeros(times * (read + written) // 2, dtype=wp.uint8, device=device)
    target = wp.empty_like(source)

    def run() -> None:
        wp.copy(target, source)
        wp.synchronize_device(device)

    return Ready(run, None, len(poses) * times)


def placed(poses: np.ndarray) -> list[np.ndarray]:
    """The hand's vertices in the array's frame, one array a pose."""
    from palpate.render.hands import rotated

    vertices = hand().vertices[0].astype(np.float64)
    return [(p[:3] + rotated(p[None, 3:], vertices)).astype(np.float32) for p in poses.astype(np.float64)]


def vtk_surface(vertices: np.ndarray, faces: np.ndarray) -> Any:
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    points, cells, out = vtk.vtkPoints(), vtk.vtkCellArray(), vtk.vtkPolyData()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(vertices), deep=1))
    cells.SetData(3, numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces, np.int64).ravel(), deep=1))
    out.SetPoints(points)
    out.SetPolys(cells)
    return out


def vtk_length(lines: Any) -> float:
    from vtk.util.numpy_support import vtk_to_numpy

    if not lines.GetNumberOfLines():
        return 0.0
    points = vtk_to_numpy(lines.GetPoints().GetData())
    ends = vtk_to_numpy(lines.GetLines().GetConnectivityArray()).reshape(-1, 2)
    return float(np.linalg.norm(np.diff(points[ends], axis=1), axis=2).sum())


def vtk_case(poses: np.ndarray, device: str, *, filtered: Callable[[Any], Callable[[Any], Any]]) -> Ready:
    """A filter, given the tube once and then each placed hand."""
    import vtk

    vtk.vtkSMPTools.Initialize(1)
    poses = poses[:VTK_POSES]
    thing, skin = tube(), hand()
    cut = filtered(vtk_surface(thing.vertices, thing.faces))
    hands = [vtk_surface(vertices, skin.faces) for vertices in placed(poses)]
    kept: list[Any] = []

    def run() -> None:
        kept[:] = [cut(one) for one in hands]

    return Ready(run, lambda: np.array([vtk_length(lines) for lines in kept]), len(poses))


def vtk_intersection(surface: Any) -> Callable[[Any], Any]:
    """Triangles against triangles: exact, segments in no order."""
    import vtk

    def cut(one: Any) -> Any:
        step = vtk.vtkIntersectionPolyDataFilter()
        step.SetInputData(0, one)
        step.SetInputData(1, surface)
        step.SplitFirstOutputOff()
        step.SplitSecondOutputOff()
        step.Update()
        return step.GetOutput()

    return cut


def vtk_cutter(surface: Any) -> Callable[[Any], Any]:
    """Where the signed distance to the tube, linear along the hand's edges, is 0: the same chords, nearly."""
    import vtk

    distance = vtk.vtkImplicitPolyDataDistance()
    distance.SetInput(surface)

    def cut(one: Any) -> Any:
        step = vtk.vtkCutter()
        step.SetInputData(one)
        step.SetCutFunction(distance)
        step.SetValue(0, 0.0)
        step.Update()
        return step.GetOutput()

    return cut


CASES = (
    Case("OC", partial(ours, rows=False, closes=False)),
    Case("CC", partial(ours, rows=False, closes=True)),
    Case("CC, rows", partial(ours, rows=True, closes=True)),
    Case("floor", partial(floor, rows=False)),
    Case("floor, rows", partial(floor, rows=True)),
    Case("vtkIntersectionPolyDataFilter", partial(vtk_case, filtered=vtk_intersection), ("vtk",)),
    Case("vtkCutter of signed distance", partial(vtk_case, filtered=vtk_cutter), ("vtk",)),
)


def measure(cases: tuple[Case, ...], poses: np.ndarray, device: str, rounds: int) -> list[Figure]:
    """Figures of the cases whose packages are installed; the first one's curves are what others are compared with."""
    here = [case for case in cases if not case.missing]
    ready = [case.prepare(poses, device) for case in here]
    times: list[list[float]] = [[] for _ in here]
    clock = thread_time if device == "cpu" else perf_counter
    for one in ready:
        one.run()  # the first run compiles
    for _ in range(rounds):
        for one, taken in zip(ready, times, strict=True):
            started = clock()
            one.run()
            taken.append(clock() - started)
    if ready[0].lengths is None:
        raise ValueError(f"{here[0].name} makes no curves that others can be compared with")
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
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    for case in CASES:
        if case.missing:
            print(json.dumps({"case": case.name, "skipped": f"not installed: {', '.join(case.missing)}"}))
    for figure in measure(CASES, random_poses(options.poses), options.device, options.rounds):
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
