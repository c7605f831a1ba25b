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
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np
import warp as wp
from turns import Case, Curves, copying, installed, measure_curves

from palpate.datasets.hand_model.shape import hand_shape
from palpate.datasets.rigid import rotate
from palpate.datasets.shapes.built_in import shape
from palpate.kernels.contours import Contours, measure_contours
from palpate.kernels.fields.mesh_inside import mesh_field
from palpate.kernels.skin.curves import skin_contours
from palpate.kernels.skin.sign import WORD
from palpate.render.bench.cases import random_poses
from palpate.render.hands.mesh_hand import MeshHand
from palpate.render.objects.mesh.solid_mesh import MeshObject

VTK_POSES = 20  # a run: it takes milliseconds each


def tube() -> MeshObject:
    return MeshObject(*shape("tube"), name="tube")


def hand(row_count: int = 0) -> MeshHand:
    """The project's hand, all of its skin; with rows, a hand that grows by 10 %."""
    skin = hand_shape(detail=2)
    if not row_count:
        return MeshHand(skin.vertices, skin.faces)
    return MeshHand(skin.vertices * np.linspace(1, 1.1, row_count, dtype=np.float32)[:, None, None], skin.faces)


def ours(poses: np.ndarray, device: str, *, rows: bool, closes: bool) -> Curves:
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
        return measure_contours(got).numpy().sum(axis=1)

    return Curves(run, lengths, len(poses))


def floor(poses: np.ndarray, device: str, *, rows: bool) -> Curves:
    """As many bytes copied as must be read and written: half of them read, half written."""
    thing, skin = tube(), hand()
    field = mesh_field(thing.on(device), thing.bounds)
    pose = wp.array(poses[:, None], dtype=wp.transform, device=device)
    got = skin_contours(field, pose, skin.skin_on(device), skin.vertices_on(device), closes=True)
    vertex_count = skin.skin_on(device).vertex_count
    read = 12 * vertex_count * (len(poses) if rows else 1) + 28 * len(poses)
    signs = len(poses) * 4 * -(-vertex_count // WORD)
    drawn = sum(a.size * wp.types.type_size_in_bytes(a.dtype) for a in vars(got).values() if isinstance(a, wp.array))
    run, times = copying(read + signs + drawn, device)
    return Curves(run, None, len(poses) * times)


def placed(poses: np.ndarray) -> list[np.ndarray]:
    """The hand's vertices in the array's frame, one array a pose."""
    vertices = hand().vertices[0].astype(np.float64)
    return [(p[:3] + rotate(p[None, 3:], vertices)).astype(np.float32) for p in poses.astype(np.float64)]


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


def vtk_case(poses: np.ndarray, device: str, *, filtered: Callable[[Any], Callable[[Any], Any]]) -> Curves:
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

    return Curves(run, lambda: np.array([vtk_length(lines) for lines in kept]), len(poses))


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--poses", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    inputs = random_poses(options.poses), options.device
    for figure in measure_curves(installed(CASES), options.device, options.rounds, *inputs):
        print(json.dumps(asdict(figure)))


if __name__ == "__main__":
    main()
