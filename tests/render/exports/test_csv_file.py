"""CSV as pandas and Python's own reader find it: the same bits, a row a point, units in the header."""

import csv

import numpy as np
import pandas as pd
import pytest
from export_cases import export_case, polylines_of, quiet

from palpate.render.exports.csv_file import write_csv
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
