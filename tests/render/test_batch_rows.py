"""A batch is read range by range, as a contour file is."""

from pathlib import Path

import numpy as np

from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import ContourFile, render
from palpate.render.batch_rows import BatchRows


def test_ranges_of_a_batch_are_those_of_its_file(tmp_path):
    pose = np.tile(np.array([0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0], np.float32), (7, 1))
    pose[:, 0] = np.linspace(0.0, 0.12, 7)  # out of the cube
    motion = HandMotion(np.arange(7) / 90.0, pose)
    batch = render("cube", "palm", motion, "cc")
    rows = BatchRows(batch.numpy(), motion, Path("cube"))
    with ContourFile(batch.save(tmp_path / "cube.h5")) as file:
        assert rows.pose_count == file.pose_count == 7
        for first, stop in ((0, 7), (2, 5), (6, 7)):
            mine, theirs = rows.contours(first, stop), file.contours(first, stop)
            for name in ("points", "polyline_start", "pose_start", "polyline_closed"):
                assert np.array_equal(mine[name], theirs[name]), (first, stop, name)
            assert np.array_equal(rows.motion(first, stop)["time"], file.motion(first, stop)["time"])
    ranges = list(rows.blocks(point_limit=6))
    assert [first for first, _ in ranges[1:]] == [stop for _, stop in ranges[:-1]]  # without gaps, in order
    assert (ranges[0][0], ranges[-1][1]) == (0, 7)
    assert len(ranges) > 1
