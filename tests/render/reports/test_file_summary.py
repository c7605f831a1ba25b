"""Contours that a hand feels as one: known shapes, whose share follows from their distances."""

import numpy as np
import pytest

from palpate.render import ContourFile, MeshObject, render, static_pose
from palpate.render.focal_spot import focal_width
from palpate.render.reports.file_summary import fused_places, fused_share

WIDTH = 0.010  # [m]


def share(*polylines):
    points = np.concatenate([np.asarray(own, np.float32) for own in polylines])
    start = np.concatenate([[0], np.cumsum([len(own) for own in polylines])])
    return float(np.mean(fused_places(points, start, WIDTH)))


def line(length, y, z=0.2):
    return [(0.0, y, z), (length, y, z)]


def circle(radius, count=200):
    angle = np.linspace(0.0, 2 * np.pi, count + 1)
    around = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count + 1, 0.2)], axis=1)
    around[-1] = around[0]
    return around


def test_two_lines_fuse_where_they_are_nearer_than_the_width():
    assert share(line(0.1, 0.0), line(0.1, 0.009)) == 1.0
    assert share(line(0.1, 0.0), line(0.1, 0.011)) == 0.0
    slanted = [(0.0, 0.0, 0.2), (0.1, 0.02, 0.2)]  # from its foot to 20 mm away: half is within 10 mm
    assert share(line(0.1, 0.0), slanted) == pytest.approx(0.5, abs=0.03)
    assert share(line(0.1, 0.0), line(0.1, 0.0, 0.215)) == 0.0  # above it


def test_a_contour_fuses_with_itself_where_it_is_thin_and_not_where_it_bends():
    wall = [(0.0, 0.0, 0.2), (0.1, 0.0, 0.2), (0.1, 0.004, 0.2), (0.0, 0.004, 0.2), (0.0, 0.0, 0.2)]
    assert share(wall) > 0.75  # but for its ends, where the way around is short
    assert share(circle(0.03)) == 0.0
    assert share([(0.0, 0.0, 0.2), (0.05, 0.0, 0.2), (0.05, 0.05, 0.2)]) == 0.0  # a corner
    assert share(line(0.1, 0.0)) == 0.0


def test_a_filled_contact_is_found_as_pair_by_pair():
    """Lines 1 mm apart, each place with 150 within the width: the same places as by a table of all distances."""
    rows = [
        np.array([[0.0, y, 0.2], [0.03, y, 0.2]])[:: 1 if k % 2 else -1] for k, y in enumerate(np.arange(0, 0.03, 1e-3))
    ]
    apart = np.array([[0.0, 0.06, 0.2], [0.03, 0.06, 0.2]])
    zigzag = np.concatenate(rows)
    points = np.concatenate([zigzag, apart])
    found = fused_places(points, np.array([0, len(zigzag), len(points)]), WIDTH)
    step = np.linalg.norm(np.diff(zigzag, axis=0), axis=1)
    way = (np.arange(round(6 * step.sum() / WIDTH)) + 0.5) * step.sum() / round(6 * step.sum() / WIDTH)
    at = np.stack([np.interp(way, np.concatenate([[0], step.cumsum()]), zigzag[:, k]) for k in range(3)], axis=1)
    is_near = np.linalg.norm(at[:, None] - at, axis=2) <= WIDTH
    expected = (is_near & (np.abs(way[:, None] - way) > 2 * WIDTH)).any(axis=1)
    np.testing.assert_array_equal(found, np.concatenate([expected, np.zeros(18, bool)]))
    assert 0.5 < found.mean() < 1.0


def test_walls_of_4_mm_are_one_band_and_those_of_25_mm_are_two(tmp_path):
    width = focal_width(0.2).width
    assert 0.009 < width < 0.011
    for wall, expected in ((0.004, 1.0), (0.025, 0.0)):
        assert share(circle(0.03), circle(0.03 + wall)) == expected
    sphere = render("sphere", "palm", static_pose([0, 0, 0.24]), "cc").save(tmp_path / "sphere.h5")  # one loop
    with ContourFile(sphere) as file:
        assert fused_share(file) == 0.0
    tube = render("tube", "palm", static_pose([0, 0, 0.2]), "cc").save(tmp_path / "tube.h5")
    with ContourFile(tube) as file:  # the inner wall of 40 mm runs 2.5 mm inside the palm's sides of 42.5 mm
        assert 0.5 < fused_share(file) < 0.9
    empty = render("tube", "palm", static_pose([1.0, 0, 0.2]), "cc").save(tmp_path / "empty.h5")
    with ContourFile(empty) as file:
        assert fused_share(file) is None


@pytest.mark.filterwarnings("ignore:.*lengths are in metres")
def test_contours_that_no_array_can_focus_on_have_a_share_too(tmp_path):
    far = render(MeshObject.load("cube", at=(0, 0, 20.0)), "palm", static_pose([0, 0, 20.0]), "cc")
    with ContourFile(far.save(tmp_path / "far.h5")) as file:  # one square
        assert fused_share(file) == 0.0
