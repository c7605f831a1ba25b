"""Contours as lines: every segment is drawn once, in its kind's colour, as wide as it is strong."""

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from palpate.render import Palm, load_strategy, render, static_pose
from palpate.render.reports.contour_lines import WIDTH, draw_contours, intensity_runs
from palpate.render.reports.picture_style import COLOURS

POSE = static_pose([0.065, 0.03, 0.2])  # the cube's corner is in the palm


def drawn(strategy):
    batch = render("cube", Palm(), POSE, load_strategy(strategy))
    axes = Figure().add_subplot()
    artists = draw_contours(axes, batch, lambda points: 1e3 * points[:, :2])
    return batch, axes, artists


@pytest.mark.parametrize("strategy", ["oc", "cc", "hatch", "corners", "edges"])
def test_lines_are_as_long_as_the_contours_whatever_the_intensity(strategy):
    batch = render("cube", Palm(), POSE, load_strategy(strategy))
    lines, kind, strength = intensity_runs(batch)
    length = sum(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)
    assert length == pytest.approx(float(batch.length()[0]), rel=1e-4)
    assert len(lines) == len(kind) == len(strength)
    assert set(kind.tolist()) == {int(k) for k in batch.kind}
    assert 0 <= strength.min() <= strength.max() <= 1


def test_closed_contours_have_a_line_for_each_kind_and_not_for_each_segment():
    _, _, (halo, lines) = drawn("cc")
    assert isinstance(lines, LineCollection)
    colours = {to_hex(colour) for colour in lines.get_colors()}
    assert colours == {COLOURS["object"], COLOURS["hand"]}
    assert len(lines.get_paths()) <= 3
    assert (np.array(halo.get_linewidths()) > np.array(lines.get_linewidths())).all()
    assert max(lines.get_linewidths()) == pytest.approx(min(lines.get_linewidths())) == pytest.approx(WIDTH)


def test_weak_parts_are_thinner_and_paler():
    batch, _, (_, lines) = drawn("edges")  # the hand's edges are weak
    widths, alphas = np.array(lines.get_linewidths()), np.array(lines.get_colors())[:, 3]
    assert batch.intensity.min() < 0.5
    assert widths.min() < 0.6 * widths.max()
    assert alphas[np.argmin(widths)] < 0.6 < alphas[np.argmax(widths)]


def test_pauses_are_dots_where_the_batch_pauses():
    batch, _, artists = drawn("corner-pauses")
    dots = artists[-1].get_xydata()
    np.testing.assert_allclose(dots, 1e3 * batch.points[batch.dwell > 0][:, :2])
