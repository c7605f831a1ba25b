"""Contours as lines: every segment is drawn once, in its kind's colour and dashes, paler where it is weaker."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure

from palpate.datasets.storage.schema import KIND_NAMES
from palpate.render import ContourBatch, Palm, load_strategy, render, static_pose
from palpate.render.reports.contour_lines import WIDTH, draw_contours, intensity_runs
from palpate.render.reports.picture_style import COLOURS, HAND_DASHES, paler

POSE = static_pose([0.065, 0.03, 0.2])  # the cube's corner is in the palm


def drawn(strategy):
    batch = render("cube", Palm(), POSE, load_strategy(strategy))
    axes = Figure().add_subplot()
    axes.set(xlim=(0, 100), ylim=(0, 100))
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


def test_weak_parts_are_paler_and_each_intensity_has_one_colour():
    batch, _, (_, lines) = drawn("edges")  # the hand's edges have 0.4
    colours = {to_hex(colour) for colour in lines.get_colors()}
    _, kind, strength = intensity_runs(batch)
    pairs = {(int(k), round(float(s), 2)) for k, s in zip(kind, strength, strict=True)}
    assert {(0, 1.0), (1, 0.4)} <= pairs
    assert colours == {to_hex(paler(COLOURS[KIND_NAMES[k]], s)) for k, s in pairs}
    assert len(colours) == len(pairs)
    np.testing.assert_allclose(paler("#000000", 0.0), [0.85] * 3)
    assert to_hex(paler(COLOURS["hand"], 1.0)) == COLOURS["hand"]


def test_a_drawn_picture_has_as_many_colours_as_the_batch_has_intensities():
    strength = np.array([0.1, 0.3, 0.5, 0.7, 1.0], np.float32)
    parts = [[0.0, 0.2 * k, 0.0] for k in range(10)]
    batch = ContourBatch.from_arrays(
        {
            "pose_start": np.array([0, 5]),
            "polyline_start": np.arange(0, 11, 2),
            "polyline_closed": np.zeros(5, np.uint8),
            "polyline_patch": np.zeros(5, np.int32),
            "points": (np.array(parts) + [[-0.4, 0, 0], [0.4, -0.2, 0]] * 5).astype(np.float32),
            "kind": np.zeros(10, np.uint8),
            "intensity": np.repeat(strength, 2),
        }
    )
    figure = Figure(figsize=(3, 3), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set(xlim=(-1, 1), ylim=(-1, 3))
    draw_contours(axes, batch, lambda points: points[:, :2], width=8.0)
    canvas.draw()
    pixels, count = np.unique(np.array(canvas.buffer_rgba())[..., :3].reshape(-1, 3), axis=0, return_counts=True)
    often = {tuple(pixel) for pixel, times in zip(pixels.tolist(), count, strict=True) if times > 600} - {(255,) * 3}
    expected = {tuple(round(255 * part) for part in paler(COLOURS["object"], s)) for s in strength.tolist()}
    assert len(often) == len(expected) == len(set(strength.tolist()))
    assert max(min(np.abs(np.subtract(a, b)).max() for b in often) for a in expected) <= 1


def luminance(pixels):
    """Relative luminance of colours 0..1, shape [..., 3]; what a greyscale print keeps."""
    linear = np.where(pixels <= 0.04045, pixels / 12.92, ((pixels + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("strategy", ["cc", "edges"])
def test_in_greyscale_the_hands_contours_differ_from_the_objects_by_lightness_and_by_dashes(strategy):
    batch, _, (_, lines) = drawn(strategy)
    assert 0 in batch.kind
    assert 1 in batch.kind
    _, kind, _ = intensity_runs(batch)
    styles = lines.get_linestyle()
    for k in (0, 1):
        dashed = {own[1] is not None for own, of in zip(styles, kind, strict=True) if of == k}
        assert dashed == {k == 1}
    shade = {k: luminance(np.array(to_rgb(COLOURS[KIND_NAMES[k]]))) for k in (0, 1)}
    contrast = (shade[1] + 0.05) / (shade[0] + 0.05)
    assert contrast > 2.0


def test_dashes_go_on_over_the_pieces_of_a_line_whose_intensity_varies():
    _, _, (_, lines) = drawn("corners")
    whole, place = sum(HAND_DASHES), 0.0
    axes = lines.axes
    unit = axes.get_window_extent().width / axes.figure.dpi * 72 / np.ptp(axes.get_xlim()) / WIDTH
    pieces = 0
    for (offset, dashes), path in zip(lines.get_linestyle(), lines.get_paths(), strict=True):
        if dashes is None:
            continue
        apart = (offset / WIDTH - place) % whole
        assert min(apart, whole - apart) < 1e-3
        place += unit * np.linalg.norm(np.diff(path.vertices, axis=0), axis=1).sum()
        pieces += 1
    assert pieces > 3


def test_pauses_are_dots_where_the_batch_pauses():
    batch, _, artists = drawn("corner-pauses")
    dots = artists[-1].get_xydata()
    np.testing.assert_allclose(dots, 1e3 * batch.points[batch.dwell > 0][:, :2])
