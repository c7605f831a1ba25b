"""A print on the page is what `palpate field` computes on a finer grid, and it moves with the focal points."""

import numpy as np
import pytest

from palpate.render import flat_hand, load_rig, pressure_metrics, render, static_pose
from palpate.render.acoustics.field_metrics import sampling_for
from palpate.render.acoustics.skin_print import SkinPrint
from palpate.render.view.file_scene import FileScene
from palpate.render.view.pressure_print import PressurePrinter, planes_of_patches

ARRAYS = load_rig("emulator")


def moment_of(tmp_path, hand="palm", place=(0, 0.06, 0.2), strategy="cc"):
    with FileScene(render("cube", hand, static_pose(place), strategy).save(tmp_path / "a.h5", overwrite=True)) as scene:
        return scene.moment(0), scene.looks


def printer():
    return PressurePrinter(ARRAYS, sampling_for(None, ARRAYS))


def test_pressure_lies_along_the_contour(tmp_path):
    moment, _ = moment_of(tmp_path)
    printed = printer().compute(moment, "skin")
    assert printed.on_vertices is None
    lines = [line.astype(float) for line in moment.contours[0]]
    share = SkinPrint(printed.planes, printed.on_planes, 0.0).share_within(lines, 0.012)
    assert share > 0.85  # a focal width around it holds most of the force
    force = sum(part.sum() * plane.cell_area for part, plane in zip(printed.on_planes, printed.planes, strict=True))
    assert force == pytest.approx(pressure_metrics(tmp_path / "a.h5").force, rel=0.05)  # on a grid of 3 mm, all frames


def test_the_print_of_a_hand_mesh_is_at_its_vertices(tmp_path):
    moment, looks = moment_of(tmp_path, hand="skin")
    printed = printer().compute(moment, "skin")
    assert printed.planes == []
    assert printed.on_vertices.shape == (len(moment.hand.vertices),)
    hottest = moment.hand.vertices[printed.on_vertices.argmax()]
    assert np.linalg.norm(moment.contours.points - hottest, axis=1).min() < 0.015
    assert looks.faces.max() < len(printed.on_vertices)


def test_nothing_is_drawn_where_there_are_no_contours(tmp_path):
    moment, _ = moment_of(tmp_path, place=(0, 0.3, 0.2))
    assert moment.length == 0.0
    assert printer().compute(moment, "skin").peak == 0.0


def test_grids_cover_patches():
    hand = flat_hand()
    corners = hand.corners(static_pose([0, 0, 0.2]).pose)[0]
    for plane, patch, quad in zip(planes_of_patches(corners), hand.patches, corners, strict=True):
        assert plane.extent == pytest.approx((patch.width, patch.length))
        assert np.cross(plane.u, plane.v) @ np.array([0, 0, 1.0]) == pytest.approx(
            1.0
        )  # into a hand with its palm down
        spread = plane.points - quad.mean(axis=0)
        assert np.abs(spread @ plane.u).max() < patch.width / 2
        assert np.abs(spread @ plane.v).max() < patch.length / 2
