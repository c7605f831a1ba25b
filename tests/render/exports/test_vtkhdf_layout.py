"""VTKHDF files read by the format's description, step by step, where VTK is not installed."""

import h5py
import numpy as np
from export_cases import export_case, quiet

from palpate.render.exports import pose_choice
from palpate.render.exports.pose_choice import choose_poses
from palpate.render.exports.vtkhdf import write_vtkhdf

LINES = 1  # place of lines among the kinds of cells: vertices, lines, polygons, strips


def test_offsets_of_each_step_lead_to_its_contours(tmp_path, monkeypatch):
    """They are written in several blocks."""
    monkeypatch.setattr(pose_choice, "POINTS_A_BLOCK", 50)
    with export_case(tmp_path / "a.h5", 100) as file:
        write_vtkhdf(file, choose_poses(file), tmp_path / "a.vtkhdf", watch=quiet)
        with h5py.File(tmp_path / "a.vtkhdf") as hdf5:
            root, steps = hdf5["VTKHDF"], hdf5["VTKHDF/Steps"]
            np.testing.assert_array_equal(steps["Values"], file.motion()["time"])
            cell_count, point_count = root["Lines/NumberOfCells"][()], root["NumberOfPoints"][()]
            row = np.concatenate([[0], np.cumsum(cell_count + 1)])  # of each part's first offset
            for step in range(100):
                own, part = file.contours(step, step + 1), steps["PartOffsets"][step]
                points = slice(first := steps["PointOffsets"][step], first + point_count[part])
                cells = slice(first := steps["CellOffsets"][step, LINES], first + cell_count[part])
                np.testing.assert_array_equal(root["Points"][points], own["points"])
                np.testing.assert_array_equal(root["PointData/kind"][points], own["kind"])
                np.testing.assert_array_equal(root["CellData/closed"][cells], own["polyline_closed"])
                np.testing.assert_array_equal(root["CellData/patch"][cells], own["polyline_patch"])
                offsets = root["Lines/Offsets"][row[part] : row[part] + cell_count[part] + 1]
                np.testing.assert_array_equal(offsets, own["polyline_start"])
