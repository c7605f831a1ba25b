"""CSV as pandas and Python's own reader find it, NPZ as NumPy loads it: the contour file's own bits, whatever range."""

import csv
import zipfile
from itertools import pairwise

import h5py
import numpy as np
import pandas as pd
import pytest
from export_cases import export_case, polylines_of, quiet

from palpate.datasets.errors import ContourFileError
from palpate.render.exports import pose_choice
from palpate.render.exports.contour_tables import write_csv, write_npz
from palpate.render.exports.pose_choice import choose_poses

NAMES = ["pose", "time [s]", "polyline", "x [m]", "y [m]", "z [m]", "kind", "intensity"]


@pytest.mark.parametrize(("poses", "every"), [("20:60", 1), ("40:201", 7), ("30:", 90)])
@pytest.mark.parametrize("intensity", [False, True])
def test_pandas_reads_the_bits_that_were_written(poses, every, intensity, tmp_path):
    with export_case(tmp_path / "a.h5", intensity=intensity) as file:
        chosen = choose_poses(file, poses, every=every)
        counts = write_csv(file, chosen, tmp_path / "a.csv", watch=quiet)
        # float64 by Python: pandas before 3 rounds the last bit of 17 digits otherwise, 3.1 warns of `float_precision`
        table = pd.read_csv(tmp_path / "a.csv", converters={"time [s]": float})
        assert list(table.columns) == NAMES
        assert len(table) == counts["points"]
        time = file.motion()["time"]
        seen = 0
        for pose in chosen:
            own = table[table["pose"] == pose]
            lines = polylines_of(file, pose)
            assert own["polyline"].nunique() == len(lines)
            for k, line in enumerate(lines):
                part = own[own["polyline"] == k]
                np.testing.assert_array_equal(part[["x [m]", "y [m]", "z [m]"]].to_numpy(np.float32), line)
                np.testing.assert_array_equal(part["time [s]"], time[pose])
                seen += len(line)
            contours = file.contours(pose, pose + 1)
            assert own["kind"].tolist() == [("object", "hand", "made")[kind] for kind in contours["kind"]]
            wanted = contours.get("intensity", np.ones(len(own), np.float32))
            np.testing.assert_array_equal(own["intensity"].to_numpy(np.float32), wanted)
        assert seen == len(table)


def test_poses_without_times_leave_the_column_empty(tmp_path):
    with export_case(tmp_path / "a.h5", 30, time=None) as file:
        write_csv(file, choose_poses(file), tmp_path / "a.csv", watch=quiet)
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == NAMES
    assert {len(row) for row in rows} == {8}
    assert {row[1] for row in rows[1:]} == {""}


@pytest.mark.parametrize("gzip", [0, 6])
def test_a_whole_file_has_the_bits_of_its_hdf5(gzip, tmp_path):
    with export_case(tmp_path / "a.h5", intensity=True, dwell=True) as file:
        write_npz(file, choose_poses(file), tmp_path / "a.npz", gzip=gzip, watch=quiet)
    with np.load(tmp_path / "a.npz", allow_pickle=False) as arrays, h5py.File(tmp_path / "a.h5") as hdf5:
        contours = dict(hdf5["contours"])
        assert set(contours) <= set(arrays)
        groups = dict.fromkeys(contours, "contours")
        groups |= {"pose": "motion", "time": "motion", "vertices": "object", "faces": "object", "length": "metrics"}
        assert set(arrays) == {*groups, "pose_number"}
        for name, group in groups.items():
            assert arrays[name].dtype == hdf5[group][name].dtype
            np.testing.assert_array_equal(arrays[name], hdf5[group][name][()])
        np.testing.assert_array_equal(arrays["pose_number"], np.arange(300))
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.testzip() is None


@pytest.mark.parametrize(("poses", "every"), [("40:201", 7), ("30:", 90), ("5:6", 1), ("0:1", 1)])
def test_a_range_has_the_polylines_of_its_poses(poses, every, tmp_path, monkeypatch):
    """It is read in several blocks."""
    monkeypatch.setattr(pose_choice, "POINTS_A_BLOCK", 100)
    with export_case(tmp_path / "a.h5") as file:
        chosen = choose_poses(file, poses, every=every)
        write_npz(file, chosen, tmp_path / "a.npz", watch=quiet)
        arrays = np.load(tmp_path / "a.npz", allow_pickle=False)
        assert arrays["pose_number"].tolist() == list(chosen)
        np.testing.assert_array_equal(arrays["time"], file.motion()["time"][list(chosen)])
        np.testing.assert_array_equal(arrays["pose"], file.motion()["pose"][list(chosen)])
        np.testing.assert_array_equal(arrays["length"], file.metrics()["length"][list(chosen)])
        assert (arrays["intensity"] == 1).all()
        for k, pose in enumerate(chosen):
            lines = arrays["polyline_start"][arrays["pose_start"][k] : arrays["pose_start"][k + 1] + 1]
            parts = [arrays["points"][a:b] for a, b in pairwise(lines)]
            wanted = polylines_of(file, pose)
            assert len(parts) == len(wanted)
            assert all(np.array_equal(a, b) for a, b in zip(parts, wanted, strict=True))


def test_a_moving_object_has_its_poses(tmp_path):
    moved = np.tile(np.float32([0, 0, 0.2, 0, 0, 0, 1]), (40, 1))
    moved[:, 0] = np.arange(40)
    with export_case(tmp_path / "a.h5", 40, moved=moved) as file:
        write_npz(file, choose_poses(file, "3:20", every=4), tmp_path / "a.npz", watch=quiet)
    assert np.load(tmp_path / "a.npz")["moved"][:, 0].tolist() == [3, 7, 11, 15, 19]


def test_metrics_that_contradict_the_contours_are_refused(tmp_path, monkeypatch):
    with export_case(tmp_path / "a.h5") as file:
        counts = file.metrics()
        monkeypatch.setattr(file, "metrics", lambda *_: counts | {"polylines": counts["polylines"] + 1})
        with pytest.raises(ContourFileError, match="do not fit"):
            write_npz(file, choose_poses(file), tmp_path / "a.npz", watch=quiet)
