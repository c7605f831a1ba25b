"""The bookkeeping of steps by itself: a million of them, read by VTK at random."""

import h5py
import numpy as np
import pytest

from palpate.render.exports.vtkhdf_steps import PolyDataSteps, StepCells, same_cells

vtk = pytest.importorskip("vtk", reason="vtk is not installed: nothing to read VTKHDF with")
from vtk.util.numpy_support import vtk_to_numpy  # noqa: E402


def written(path, blocks, step_count):
    with h5py.File(path, "w") as file:
        steps = PolyDataSteps(file.create_group("VTKHDF"), "Lines", version=(2, 0), gzip=0)
        for cells in blocks:
            steps.append(cells, {}, {})
        steps.finish(np.arange(step_count) * 0.5, {})
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    return reader


def read(reader, step):
    reader.SetStep(int(step))
    reader.Update()
    shown = reader.GetOutputDataObject(0)
    points = vtk_to_numpy(shown.GetPoints().GetData()) if shown.GetNumberOfPoints() else np.zeros((0, 3))
    return points, vtk_to_numpy(shown.GetLines().GetOffsetsArray())


def numbered(first, lines):
    """Steps of so many lines of two points; all coordinates of a step's points are the step's number."""
    count = 2 * np.asarray(lines)
    points = np.repeat(np.arange(first, first + len(lines)), count)[:, None] * np.ones(3)
    cells = np.arange(np.sum(lines) + 1) * 2
    return StepCells(points.astype(np.float32), cells, np.concatenate([[0], np.cumsum(lines)]))


@pytest.mark.parametrize("lines", [[2, 0, 3], [0, 0, 1, 0], [0], [0, 0, 0], [1], [0, 5, 0, 0, 2]])
def test_steps_after_empty_ones_are_read_right(lines, tmp_path):
    """VTK's own writer and reader disagree on the first of these."""
    for blocks in ([numbered(0, lines)], [numbered(k, [n]) for k, n in enumerate(lines)]):
        reader = written(tmp_path / f"{len(blocks)}.vtkhdf", blocks, len(lines))
        for step, count in enumerate(lines):
            points, offsets = read(reader, step)
            assert points.shape == (2 * count, 3)
            assert (points == step).all()
            if count:
                assert offsets.tolist() == list(range(0, 2 * count + 1, 2))


@pytest.mark.exhaustive
def test_a_million_steps_are_read_right_at_random(tmp_path, rng):
    lines = rng.integers(0, 3, 10**6) * (rng.random(10**6) < 0.5)
    blocks = (numbered(first, lines[first : first + 10**5]) for first in range(0, 10**6, 10**5))
    reader = written(tmp_path / "a.vtkhdf", blocks, 10**6)
    for step in [*rng.integers(0, 10**6, 200), *range(10**6 - 50, 10**6)]:
        points, _ = read(reader, step)
        assert points.shape == (2 * lines[step], 3)
        assert (points == step).all()  # float32 holds a million exactly


def test_polygons_of_equal_shape_are_counted_by_steps():
    cells = same_cells(np.zeros((4, 5, 3, 3)), 3, 4)
    assert cells.points.shape == (60, 3)
    assert cells.cell_start.tolist() == list(range(0, 61, 3))
    assert cells.step_start.tolist() == [0, 5, 10, 15, 20]
