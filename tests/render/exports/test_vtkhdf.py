"""VTKHDF files as VTK's own reader shows them, whichever way it is asked for a step, and at each step exactly."""

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from contour_cases import everything
from export_cases import export_case, quiet

from palpate.datasets import ContourFile
from palpate.render import (
    HandMotion,
    HandPatch,
    MeshHand,
    MeshObject,
    Palm,
    PlaneHand,
    flat_hand,
    load_strategy,
    record,
    render,
    static_pose,
)
from palpate.render.exports.pose_choice import choose_poses
from palpate.render.exports.vtkhdf import PolyDataSteps, StepCells, write_vtkhdf

vtk = pytest.importorskip("vtk", reason="vtk is not installed: nothing to read VTKHDF with")
from vtk.util.numpy_support import vtk_to_numpy  # noqa: E402


def opened(path):
    reader = vtk.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    return reader


def by_step(reader, step, moment):
    reader.SetStep(step)
    reader.Update()
    return reader.GetOutputDataObject(0)


def by_time(reader, step, moment):
    """As ParaView asks."""
    reader.UpdateTimeStep(moment)
    return reader.GetOutputDataObject(0)


def values(data, name):
    return vtk_to_numpy(data.GetArray(name))


def assert_shows(poly, own):
    """The PolyData of a step has exactly the contours of a pose."""
    assert poly.GetNumberOfCells() == poly.GetNumberOfLines() == len(own["polyline_closed"])
    assert poly.GetNumberOfPoints() == len(own["points"])
    if len(own["points"]) == 0:
        return
    np.testing.assert_array_equal(vtk_to_numpy(poly.GetPoints().GetData()), own["points"])
    lines = poly.GetLines()
    np.testing.assert_array_equal(vtk_to_numpy(lines.GetOffsetsArray()), own["polyline_start"])
    np.testing.assert_array_equal(vtk_to_numpy(lines.GetConnectivityArray()), np.arange(len(own["points"])))
    point, cell = poly.GetPointData(), poly.GetCellData()
    np.testing.assert_array_equal(values(point, "kind"), own["kind"])
    np.testing.assert_array_equal(values(point, "intensity"), own.get("intensity", np.ones(len(own["kind"]))))
    np.testing.assert_array_equal(values(cell, "closed"), own["polyline_closed"])
    np.testing.assert_array_equal(values(cell, "patch"), own["polyline_patch"])
    if "dwell" in own:
        np.testing.assert_array_equal(values(point, "dwell"), own["dwell"])


@pytest.mark.exhaustive
@pytest.mark.parametrize("ask", [by_step, by_time])
@pytest.mark.parametrize("gzip", [0, 4])
def test_vtk_shows_each_of_thousands_of_poses_most_of_them_empty(ask, gzip, tmp_path, rng):
    with export_case(tmp_path / "a.h5", 5000, intensity=True, dwell=True) as file:
        empty = file.metrics()["polylines"] == 0
        assert empty.mean() > 0.6
        assert empty[0]
        assert empty[-1]
        counts = write_vtkhdf(file, choose_poses(file), tmp_path / "a.vtkhdf", gzip=gzip, watch=quiet)
        assert counts == {"polylines": file.polyline_count, "points": file.point_count}
        reader, moments = opened(tmp_path / "a.vtkhdf"), file.motion()["time"]
        assert reader.GetNumberOfSteps() == 5000
        for step in [*range(5000), *rng.permutation(5000)[:500]]:
            assert_shows(ask(reader, int(step), moments[step]), file.contours(int(step), int(step) + 1))


@pytest.mark.parametrize("ask", [by_step, by_time])
@pytest.mark.parametrize(
    ("poses", "every"),
    [pytest.param(None, 1, marks=pytest.mark.exhaustive), ("40:60", 1), ("40:201", 7), ("1:", 100), ("0:1", 1)],
)
def test_vtk_shows_the_chosen_poses_with_their_times_and_numbers(poses, every, ask, tmp_path):
    with export_case(tmp_path / "a.h5") as file:
        chosen = choose_poses(file, poses, every=every)
        write_vtkhdf(file, chosen, tmp_path / "a.vtkhdf", watch=quiet)
        reader, moments = opened(tmp_path / "a.vtkhdf"), file.motion()["time"][list(chosen)]
        steps = reader.GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
        if len(chosen) > 1:  # VTK knows no time of a single step
            np.testing.assert_array_equal(steps, moments)
        for step, pose in enumerate(chosen):
            shown = ask(reader, step, moments[step])
            assert_shows(shown, file.contours(pose, pose + 1))
            assert values(shown.GetFieldData(), "pose").tolist() == [pose]


def blocks_of(shown):
    return {shown.GetMetaData(k).Get(vtk.vtkCompositeDataSet.NAME()): shown.GetBlock(k) for k in range(3)}


def corners_of(poly, count):
    """Corners of polygons of `count` corners each [m], shape [polygon, corner, 3]."""
    place = vtk_to_numpy(poly.GetPolys().GetConnectivityArray()).reshape(-1, count)
    assert np.diff(vtk_to_numpy(poly.GetPolys().GetOffsetsArray())).tolist() == [count] * len(place)
    return vtk_to_numpy(poly.GetPoints().GetData())[place]


@pytest.mark.parametrize("ask", [by_step, by_time])
@pytest.mark.parametrize(("every", "is_moving"), [pytest.param(1, False, marks=pytest.mark.exhaustive), (7, True)])
def test_vtk_shows_object_and_hand_as_blocks(ask, every, is_moving, tmp_path):
    if is_moving:
        moved = everything(300)["moved"]
        moved[:, 0] = np.linspace(0, 1, 300)
    with export_case(tmp_path / "a.h5", **({"moved": moved} if is_moving else {})) as file:
        chosen = choose_poses(file, every=every)
        write_vtkhdf(file, chosen, tmp_path / "a.vtkhdf", scene=True, watch=quiet)
        reader, moments = opened(tmp_path / "a.vtkhdf"), file.motion()["time"]
        solid, corners = file.object(), Palm(0.085, 0.085).corners(file.motion()["pose"])[:, 0]
        middle = np.array([0.5, 0.5, 0.5])  # of the tetrahedron's bounding box
        for step, pose in enumerate(chosen):
            shown = blocks_of(ask(reader, step, moments[pose]))
            assert_shows(shown["contours"], file.contours(pose, pose + 1))
            triangles = solid["vertices"][solid["faces"]]
            if is_moving:  # and not turned
                triangles = triangles - middle + solid["moved"][pose, :3]
            np.testing.assert_allclose(corners_of(shown["object"], 3), triangles, atol=1e-6)
            np.testing.assert_array_equal(corners_of(shown["hand"], 4)[0], corners[pose].astype(np.float32))


def test_patches_of_a_hand_of_planes_are_shown_at_each_pose(tmp_path):
    hand, motion = flat_hand(), static_pose([0, 0, 0.2])
    record(tmp_path / "a.h5", MeshObject.load("cube"), hand, motion, load_strategy("cc"))
    with ContourFile(tmp_path / "a.h5") as file:
        write_vtkhdf(file, choose_poses(file), tmp_path / "a.vtkhdf", scene=True, watch=quiet)
        shown = blocks_of(by_step(opened(tmp_path / "a.vtkhdf"), 0, 0.0))
        assert_shows(shown["contours"], file.contours())
        assert len(file.contours()["points"]) > 0
    np.testing.assert_allclose(corners_of(shown["hand"], 4), hand.corners(motion.pose)[0], atol=1e-7)


def test_a_skin_is_shown_where_it_is(tmp_path):
    motion = HandMotion(
        np.arange(3) / 90, np.float32([[0, 0, 0.2 + 0.01 * k, 0.7071068, 0, 0, 0.7071068] for k in range(3)])
    )
    path = render("cube", "skin", motion, "cc").save(tmp_path / "a.h5")
    with ContourFile(path) as file:
        hand = MeshHand.from_file(file.hand, file.hand_arrays())
        write_vtkhdf(file, choose_poses(file, every=2), tmp_path / "a.vtkhdf", scene=True, watch=quiet)
    reader = opened(tmp_path / "a.vtkhdf")
    for step, pose in enumerate((0, 2)):
        shown = blocks_of(by_step(reader, step, 0.0))["hand"]
        np.testing.assert_allclose(corners_of(shown, 3), hand.triangles(motion.pose[pose : pose + 1])[0], atol=1e-7)


@pytest.mark.parametrize("every", [1, 2])
def test_a_patch_that_is_absent_at_a_pose_has_no_size(every, tmp_path):
    own = np.tile(np.float32([0, 0, 0, 0, 0, 0, 1]), (5, 2, 1))
    own[:, 1, 2] = -0.06
    own[:, 0, 0] = np.arange(5) * 0.01
    own[2, 1] = np.nan
    hand = PlaneHand((HandPatch("palm", 0.06, 0.06), HandPatch("finger", 0.02, 0.03)), patch_pose=own)
    motion = HandMotion(np.arange(5) / 90, np.tile(np.float32([0, 0, 0.2, 0.7071068, 0, 0, 0.7071068]), (5, 1)))
    record(tmp_path / "a.h5", MeshObject.load("cube"), hand, motion, load_strategy("cc"))
    with ContourFile(tmp_path / "a.h5") as file:
        write_vtkhdf(file, choose_poses(file, every=every), tmp_path / "a.vtkhdf", scene=True, watch=quiet)
    reader = opened(tmp_path / "a.vtkhdf")
    for step, pose in enumerate(range(0, 5, every)):
        shown = corners_of(blocks_of(by_step(reader, step, 0.0))["hand"], 4)
        corners = hand.corners(motion.pose)[pose]
        np.testing.assert_allclose(shown[0], corners[0], atol=1e-7)
        wanted = np.tile(motion.pose[pose, :3], (4, 1)) if pose == 2 else corners[1]
        np.testing.assert_allclose(shown[1], wanted, atol=1e-7)


def test_poses_without_times_are_shown_by_their_numbers(tmp_path):
    with export_case(tmp_path / "a.h5", 30, time=None) as file:
        write_vtkhdf(file, choose_poses(file, "3:9"), tmp_path / "a.vtkhdf", watch=quiet)
    steps = opened(tmp_path / "a.vtkhdf").GetOutputInformation(0).Get(vtk.vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    assert list(steps) == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]


def test_a_file_uses_no_filter_that_vtk_lacks_and_no_boolean(tmp_path):
    with export_case(tmp_path / "a.h5") as file:
        for gzip, wanted in ((0, {None}), (5, {"gzip"})):
            write_vtkhdf(file, choose_poses(file), tmp_path / f"{gzip}.vtkhdf", gzip=gzip, watch=quiet)
            with h5py.File(tmp_path / f"{gzip}.vtkhdf") as hdf5:
                names = []
                hdf5.visit(names.append)
                found = [hdf5[name] for name in names if isinstance(hdf5[name], h5py.Dataset)]
                assert {item.compression for item in found} == wanted
                assert {item.dtype.kind for item in found} <= set("iuf")


def test_the_documents_lines_for_pyvista_show_a_step(tmp_path, monkeypatch, capsys):
    pytest.importorskip("pyvista", reason="pyvista is not installed: its lines in the document are not run")
    text = (Path(__file__).parents[3] / "docs/formats/exports.md").read_text()
    (code,) = re.findall(r"^```python no-run\n(import pyvista\n.*?)^```", text, re.MULTILINE | re.DOTALL)
    monkeypatch.chdir(tmp_path)
    with export_case(tmp_path / "a.h5") as file:
        own = file.contours(100, 101)
        for scene in (False, True):
            write_vtkhdf(file, choose_poses(file), tmp_path / "tube.vtkhdf", scene=scene, watch=quiet)
            shown = {}
            exec(code.replace("contours.", 'contours["contours"].') if scene else code, shown)
            assert capsys.readouterr().out.startswith(f"300 {len(own['points'])} ")
            if scene:
                assert shown["contours"]["hand"].n_cells == 1
            (tmp_path / "tube.vtkhdf").unlink()


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
