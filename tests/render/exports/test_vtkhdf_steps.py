"""The bookkeeping of steps by itself: a million of them, read by VTK at random."""

import h5py
import numpy as np
import pytest

from palpate.render.exports.vtkhdf import PolyDataSteps, StepCells

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
