"""One struct of contours: every column goes along when rows are kept, and stays when others are replaced."""

import numpy as np
import pytest
import warp as wp
from contour_random import bare, weighted_batch

from palpate.kernels.contours import LINE_COLUMNS, POINT_COLUMNS, Contours, keep_rows, with_columns, with_room
from palpate.render import ContourBatch
from palpate.render.contour_batch import array_names

STARTS = {"polyline_start", "pose_start"}


def test_the_columns_are_those_of_a_batch_and_each_is_of_points_or_of_polylines():
    assert set(Contours.vars) == set(array_names()) == {*POINT_COLUMNS, *LINE_COLUMNS, *STARTS}


@pytest.mark.parametrize("weighted", [True, False])
def test_rows_that_stay_keep_all_that_they_have(weighted, device, rng):
    batch = weighted_batch(rng, 20) if weighted else bare(weighted_batch(rng, 20))
    line_of = np.repeat(np.arange(batch.polyline_count), np.diff(batch.polyline_start))
    lines = rng.random(batch.polyline_count) < 0.7
    points = lines[line_of] & (rng.random(batch.point_count) < 0.8)
    keeps = (wp.array(np.append(keep, 0), dtype=wp.int64, device=device) for keep in (points, lines))
    got = ContourBatch.from_struct(keep_rows(batch.to(device).struct, *keeps)).numpy()
    assert got.by_name().keys() == batch.by_name().keys()
    for name, column in batch.by_name().items():
        if name not in STARTS:
            kept = column[points if name in POINT_COLUMNS else lines]
            np.testing.assert_array_equal(getattr(got, name), kept, err_msg=name)
    sizes = np.bincount(line_of[points], minlength=batch.polyline_count)[lines]
    np.testing.assert_array_equal(got.polyline_start, np.cumsum([0, *sizes]))
    np.testing.assert_array_equal(got.pose_start, np.append(0, np.cumsum(lines))[batch.pose_start])


def test_replacing_a_column_leaves_the_others_and_the_contours_it_is_made_of(device, rng):
    contours = bare(weighted_batch(rng, 5)).to(device).struct
    points, level = contours.points, wp.ones(contours.points.shape[0], dtype=wp.float32, device=device)
    other = with_columns(contours, intensity=level)
    assert (other.intensity, other.points, other.dwell, contours.intensity) == (level, points, None, None)
    room = with_room(other, 7)
    assert (room.points.shape, room.intensity.shape, room.dwell) == ((7,), (7,), None)
    assert room.polyline_patch is contours.polyline_patch
