"""Pages are as wide as asked for, texts are cut to their room, and no text or panel of a figure overlaps another."""

import json
import re
from itertools import combinations

import numpy as np
import pytest
from matplotlib.lines import Line2D
from PIL import Image

from palpate.datasets import HandMotion, static_pose
from palpate.render import IntersectionStrategy, MeshObject, Palm, StrategyError, load_strategy, record
from palpate.render.reports.contour_figure import contour_figure
from palpate.render.reports.picture_page import EDGE, GAP, WIDTHS, Page, fit_text, font_of, text_width, width_of
from palpate.render.reports.picture_style import save_figure
from palpate.render.reports.strategy_figure import strategies_figure

NAME = "a name of exactly eighty characters, as a mesh from an archive of scans may have"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Four renderings by names of 80 characters of a motion over a cube with such a name."""
    folder = tmp_path_factory.mktemp("named")
    cube = MeshObject.load("cube")
    solid = MeshObject(cube.vertices, cube.faces, name=NAME)
    pose = np.tile(static_pose([0.03, 0, 0.2]).pose, (30, 1))
    pose[:, 0] += np.linspace(0, 0.06, 30)
    paths = {}
    for k, name in enumerate(("oc", "cc", "edges", "hatch")):
        paths[f"{k} {NAME[2:]}"] = folder / f"{name}.h5"
        record(folder / f"{name}.h5", solid, Palm(), HandMotion(np.arange(30) / 30, pose), load_strategy(name))
    return paths


def overlaps(figure, font):
    """What lies on something else, or outside the figure; texts within their axes may lie on what these show."""
    figure.draw_without_rendering()
    boxes = {f"axes {k}": own.get_window_extent() for k, own in enumerate(figure.axes)}
    drawn, found = [*figure.texts], []
    for legend in figure.legends:
        drawn += legend.get_texts()
    for axes in figure.axes:
        free = [text for text in axes.texts if not axes.bbox.overlaps(text.get_window_extent())]
        names = [axes.xaxis.label, axes._left_title]
        for number, axis in enumerate((axes.xaxis, axes.yaxis)):
            low, high = (axes.get_xlim, axes.get_ylim)[number]()
            names += [text for text in axis.get_ticklabels() if low <= text.get_position()[number] <= high]
        drawn += [*free, *(names if axes.axison else [])]
    for k, text in enumerate(drawn):
        if text.get_fontsize() < font:
            found.append(f"{text.get_text()} has {text.get_fontsize()} pt")
        if text.get_text().strip():
            boxes[f"{k} {text.get_text()!r}"] = text.get_window_extent()
    edge = figure.bbox
    for name, box in boxes.items():
        if box.x0 < edge.x0 - 1 or box.x1 > edge.x1 + 1 or box.y0 < edge.y0 - 1 or box.y1 > edge.y1 + 1:
            found.append(f"{name} leaves the picture")
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > 0.5 and up > 0.5:
            found.append(f"{one} lies on {other} by {across:.1f} x {up:.1f} pixels")
    return found


def page_of_texts(width, font):
    """A page with titles, two panels and a legend, all by names of 80 characters."""
    page = Page(width_of(width), font_of(font))
    top = EDGE + page.text(NAME, EDGE, EDGE, page.inner, lines=2, fontweight="bold")
    wide = (page.inner - GAP) / 2
    lefts = (EDGE, EDGE + wide + GAP)
    top += page.row([NAME, "short"], lefts, top, wide, lines=3)
    for left in lefts:
        page.axes(left, top, wide, 1.0).set_axis_off()
    top += 1.0 + GAP
    top += page.legend(
        [(Line2D([], []), NAME), (Line2D([], []), "a line"), (Line2D([], []), "dots")], EDGE, top, page.inner
    )
    page.finish(top + EDGE)
    return page.figure


@pytest.mark.parametrize("width", [*WIDTHS, 0.06])
def test_a_page_holds_long_names_and_the_check_finds_a_text_that_it_does_not_hold(width):
    figure = page_of_texts(width, 12.0)
    assert overlaps(figure, 12.0) == []
    figure.text(0.1, figure.texts[0].get_position()[1], "on the title", fontsize=14)
    figure.text(0.9, 0.01, "a text that ends outside", fontsize=6)
    words = " ".join(overlaps(figure, 12.0))
    assert all(word in words for word in ("lies on", "leaves the picture", "has 6.0 pt"))


@pytest.mark.exhaustive
@pytest.mark.parametrize("font", [5.0, 12.0])
@pytest.mark.parametrize(
    ("width", "count"), [*((width, 4) for width in (*WIDTHS, None, 0.06, 0.6)), ("single", 1), (None, 1)]
)
def test_no_text_runs_into_another_or_a_panel_at_any_size(files, width, font, count):
    for times in (None, [0.5], [0.0, 0.2, 0.4, 0.6, 0.8, 0.9]):
        figure = contour_figure(dict(list(files.items())[:count]), times=times, width=width, font_size=font)
        assert overlaps(figure, font) == []


@pytest.mark.exhaustive
def test_no_text_runs_into_another_where_strategies_have_many_stages():
    some = [
        "simplify",
        "resample",
        {"stage": "smooth", "rounds": 2},
        "smooth",
        {"stage": "inset", "distance": 0.004},
    ]
    stages = [["close", *some[:k]] for k in range(2, 6)]
    described = [{"prune": ["outside"], "transform": own} for own in stages]
    chosen = {f"{k} {NAME}": IntersectionStrategy.from_json(json.dumps(own)) for k, own in enumerate(described)}
    assert overlaps(strategies_figure(chosen), 8.0) == []


def test_a_text_is_cut_to_its_room_and_keeps_both_ends():
    shown = fit_text(NAME, 1.0, 8.0, lines=2)
    lines = shown.split("\n")
    assert len(lines) == 2
    assert lines[0] == NAME[: len(lines[0])]
    assert "…" in lines[1]
    assert NAME.endswith(lines[1].split("…")[1])
    assert all(text_width(line, 8.0) <= 1.0 for line in lines)
    assert fit_text("short", 1.0, 8.0, lines=2) == "short"
    assert fit_text("x" * 80, 0.5, 8.0).count("…") == 1
    assert text_width("mmm", 16.0) == pytest.approx(2 * text_width("mmm", 8.0), rel=0.02)


def assert_width(folder, metres):
    """Assert that a PNG, an SVG and a PDF called `a` are so wide [m]."""
    with Image.open(folder / "a.png") as image:
        assert image.width / image.info["dpi"][0] * 0.0254 == pytest.approx(metres, abs=1e-5)
        assert image.info["dpi"][0] == pytest.approx(300, rel=1e-3)
    points = float(re.search(r'width="([\d.]+)pt"', (folder / "a.svg").read_text()).group(1))
    assert points / 72 * 0.0254 == pytest.approx(metres, abs=1e-6)
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ", (folder / "a.pdf").read_bytes())
    assert float(box.group(1)) / 72 * 0.0254 == pytest.approx(metres, abs=1e-6)


@pytest.mark.parametrize(("width", "metres"), [("single", 0.089), ("Double", 0.183), ("0.1", 0.1), (0.07, 0.07)])
def test_a_page_is_exactly_as_wide_as_asked_for_in_every_kind_of_file(tmp_path, width, metres):
    page = Page(width_of(width), 7.0)
    page.finish(0.5)
    for suffix in ("png", "svg", "pdf"):
        save_figure(page.figure, tmp_path / f"a.{suffix}", in_print=True)
    assert_width(tmp_path, metres)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda: width_of("singel"), r"unknown width 'singel'.*single \(89.0 mm\)"),
        (lambda: width_of(89), r"width must lie in 0.06..0.6 m, not 89; lengths are in metres, 89 mm are 0.089"),
        (lambda: width_of("0.001"), "width must lie in 0.06..0.6 m"),
        (lambda: width_of(float("nan")), "width must lie in"),
        (lambda: font_of(72.0), "font size must lie in 4..14 points, not 72"),
        (lambda: font_of("large"), "font size must be a number in 4..14 points, not 'large'"),
    ],
)
def test_sizes_out_of_range_are_refused_with_the_bounds(ask, message):
    with pytest.raises(StrategyError, match=message):
        ask()
