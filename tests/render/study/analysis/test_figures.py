"""Figures of an analysis: what is drawn where, what the words beside say, and that nothing raises or overlaps."""

import re
from itertools import combinations
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from palpate.render.study.analysis import figures
from palpate.render.study.analysis.answer_measures import Cell, Measure

pytestmark = pytest.mark.exhaustive

OBJECTS = ("cube", "tube", "dog")


def measure(values, objects=OBJECTS, opacities=(1.0, 0.7), **more):
    """A measure of cells by object and opacity; values: shape [participant, cell]."""
    cells = tuple(Cell(f"{own}-{at:g}", {"object": own, "opacity": at}) for own in objects for at in opacities)
    values = np.array(values, dtype=float)
    codes = tuple(f"P{k + 1:02}" for k in range(len(values)))
    named = {"name": "p_cc", "title": "proportion of answers for cc", "low": 0.0, "high": 1.0, "chance": 0.5}
    return Measure(**{**named, "codes": codes, **more}, cells=cells, values=values)


def proportions(count, objects=OBJECTS, **more):
    """Tenths, of which every third participant has the opposite."""
    k = np.arange(count * len(objects) * 2).reshape(count, -1)
    values = 0.6 + (k * 7 % 5) / 10
    values[2::3] = 1.0 - values[2::3]
    return measure(values, objects, **more)


def points(values, high, **more):
    return measure(
        values, **{"name": "confidence", "title": "confidence", "low": 1.0, "high": high, "chance": None, **more}
    )


def fitted(count, **more):
    """Participants with answers at seven levels and a curve through them, as far as figures read them."""
    x = np.arange(1.0, 8.0)
    block = SimpleNamespace(name="roughness", reversals=3, trials_max=60)
    answers = {"block": block, "x": x, "successes": np.array([0, 1, 2, 5, 8, 9, 10]), "counts": np.full(7, 10)}
    answers |= {"guess": 0.0, "lapses_both_ways": True, "reason": "", "counted": "answers for the comparison"}
    threshold = SimpleNamespace(value=4.1, low=3.6, high=None)
    fit = SimpleNamespace(mu=threshold, predict=lambda at: 1 / (1 + np.exp(-(at - 4.1))))
    return [
        SimpleNamespace(answers=SimpleNamespace(**{"code": f"P{k + 1:02}", **answers, **more}), fit=fit)
        for k in range(count)
    ]


def stairs(count, **more):
    """Two tracks a participant, of which the first turns after the trials 2, 3 and, by its last answer, 5."""
    block = SimpleNamespace(name="threshold", reversals=3, trials_max=60)
    tracks = ((4.0, 3.0, 2.0, 3.0, 2.0, 1.0), (4.0, 4.0, 3.0, 3.0, 2.0))
    own = {"block": block, "track_levels": tracks, "reversal_mean": 2.5}
    return [SimpleNamespace(**{"code": f"P{k + 1:02}", **own, **more}) for k in range(count)]


def estimates(count, **more):
    x = np.array([1.0, 2.0, 4.0, 8.0])
    exponents = np.linspace(0.5, 0.9, count)
    own = {"block": SimpleNamespace(name="loudness"), "codes": tuple(f"P{k}" for k in range(count)), "x": x}
    return SimpleNamespace(
        **{**own, "means": 10 * x ** exponents[:, None], "exponents": exponents, "reason": "", **more}
    )


@pytest.fixture
def drawn(monkeypatch):
    """The matplotlib figures that are drawn, in their order."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    kept = []

    def keep(figure, kind, *, dpi):
        FigureCanvasAgg(figure).draw()
        kept.append(figure)
        return b"<svg/>"

    monkeypatch.setattr(figures, "picture_bytes", keep)
    return kept


def shown_texts(figure):
    """Texts that are drawn, and their extents [pixel]."""
    from matplotlib.text import Text

    renderer = figure.canvas.get_renderer()
    hidden = set()
    for axes in figure.axes:
        for axis, (low, high), place in ((axes.xaxis, axes.get_xlim(), 0), (axes.yaxis, axes.get_ylim(), 1)):
            for text in axis.get_ticklabels(which="both"):
                if not min(low, high) <= text.get_position()[place] <= max(low, high):
                    hidden.add(text)
    found = [own for own in figure.findobj(Text) if own.get_visible() and own.get_text().strip() and own not in hidden]
    return [(own.get_text(), own.get_window_extent(renderer)) for own in found if own.axes is None or own.axes.axison]


def require_apart(figure):
    """No text lies on another one, or beyond the figure."""
    texts = shown_texts(figure)
    assert texts
    for text, box in texts:
        beyond = max(-box.x0, -box.y0, box.x1 - figure.bbox.x1, box.y1 - figure.bbox.y1)
        assert beyond <= 1.0, text
    for (a, one), (b, other) in combinations(texts, 2):
        wide = min(one.x1, other.x1) - max(one.x0, other.x0)
        high = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert min(wide, high) <= 1.0, (a, b)


def lines_of(axes, marker):
    return [own for own in axes.lines if own.get_marker() == marker]


def test_a_measure_has_dots_means_and_chance_within_its_scale(drawn):
    found = proportions(6)
    picture = figures.draw_measure(found, "object", "opacity")
    (axes,) = drawn[0].axes
    means = [own for own in lines_of(axes, "D") if own.get_markerfacecolor() == "white"]
    cells = found.values.mean(axis=0)
    assert [float(own.get_ydata()[0]) for own in means] == pytest.approx(list(cells))
    assert [float(own.get_xdata()[0]) for own in means] == pytest.approx([-0.2, 0.2, 0.8, 1.2, 1.8, 2.2])
    dots = lines_of(axes, "o") + lines_of(axes, "s")
    assert sorted(np.concatenate([own.get_ydata() for own in dots])) == sorted(found.values.ravel())
    assert len(axes.collections) == 6  # violins
    assert any(set(own.get_ydata()) == {0.5} for own in axes.lines)
    assert axes.get_ylim() == pytest.approx((-0.05, 1.05))
    assert [own.get_text() for own in axes.get_xticklabels()] == list(OBJECTS)
    require_apart(drawn[0])
    assert f"cube, 1: mean {cells[0]:.3g} of 6 values; cube, 0.7: mean {cells[1]:.3g} of 6 values" in picture.alt
    assert picture.alt.endswith("Chance is 0.5.")
    assert picture.file == "p_cc_by_object_opacity.svg"


def test_dots_of_a_level_do_not_lie_on_each_other(drawn):
    figures.draw_measure(measure(np.full((12, 6), 0.5)), "opacity")
    dots = np.concatenate([own.get_xdata() for own in lines_of(drawn[0].axes[0], "o")])
    assert len(np.unique(np.round(dots, 3))) == len(dots) == 72


def test_participants_stand_in_the_order_of_their_means(drawn):
    found = measure([[0.9] * 6, [0.1] * 6, [np.nan] * 6, [0.5, 0.5, 0.6, 0.6, np.nan, np.nan]])
    picture = figures.draw_participants(found)
    (axes,) = drawn[0].axes
    assert [own.get_text() for own in axes.get_yticklabels()] == ["P02", "P04", "P01"]
    (means,) = lines_of(axes, "D")
    assert list(means.get_xdata()) == pytest.approx([0.1, 0.55, 0.9])
    (dots,) = lines_of(axes, "o")
    assert len(dots.get_xdata()) == 16
    assert len(set(zip(dots.get_xdata(), dots.get_ydata(), strict=True))) == 16
    assert np.abs(dots.get_ydata() - np.rint(dots.get_ydata())).max() < 0.45
    assert "from 0.1 (P02) to 0.9 (P01). 2 are above chance, 0.5, and 1 below." in picture.alt
    assert picture.caption.endswith("1 more participants without values are left out.")
    require_apart(drawn[0])


@pytest.mark.parametrize("high", [7, 6])
def test_a_scale_is_centred_on_its_middle(drawn, high):
    found = points([[1, 2, 3, high, high, 4], [1, 4, 3, high, 2, np.nan], [1, 3, 4, 1, 2, np.nan]], high)
    picture = figures.draw_scale(found)
    (axes,) = drawn[0].axes
    bars = {(round(own.get_y() + 0.36), k): own for k, bars in enumerate(axes.containers, 1) for own in bars}
    assert len(bars) == 6 * high
    middle = bars[4, 4 if high == 7 else 3]  # of the second cell: a 2, a 3 and a 4
    centre = middle.get_x() + middle.get_width() / 2 if high == 7 else middle.get_x() + middle.get_width()
    assert centre == pytest.approx(0.0, abs=1e-9)
    assert [bars[5, 1].get_width(), bars[2, high].get_width()] == pytest.approx([100, 200 / 3])
    counted = [int(own.get_text()) for own in axes.texts]
    assert sum(counted) == 16
    assert "cube, 1: mean 1 of 3 values" in picture.alt
    require_apart(drawn[0])


def test_a_psychometric_panel_has_answers_curve_and_threshold(drawn):
    picture = figures.draw_psychometric(fitted(1))
    (axes,) = drawn[0].axes
    (answers,) = [own for own in axes.collections if len(own.get_offsets()) == 7]
    assert answers.get_offsets()[:, 1].tolist() == [0, 0.1, 0.2, 0.5, 0.8, 0.9, 1]
    assert [own for own in axes.lines if set(own.get_xdata()) == {4.1}]
    assert [own for own in axes.lines if set(own.get_ydata()) == {0.5}]  # answers at random
    (band,) = axes.patches
    assert band.get_x() == pytest.approx(3.6)
    assert band.get_x() + band.get_width() == pytest.approx(axes.get_xlim()[1])  # its interval is open above
    assert axes.get_title() == "P01: 4.1"
    assert "P01: 4.1" in picture.alt
    require_apart(drawn[0])


def test_reversals_of_a_staircase_are_marked_with_the_one_that_ended_it(drawn):
    picture = figures.draw_staircases(stairs(1))
    (axes,) = drawn[0].axes
    turns = [own for own in axes.lines if own.get_linestyle() == "None"]
    assert [list(own.get_xdata()) for own in turns] == [[3, 4, 6], []]
    assert [list(own.get_ydata()) for own in turns] == [[2.0, 3.0, 1.0], []]
    assert picture.alt == "Means at the reversals of block threshold. P01: 2.5."
    require_apart(drawn[0])


def test_magnitudes_are_logarithmic_with_a_line_of_the_mean_exponent(drawn):
    picture = figures.draw_magnitudes(estimates(3))
    (axes,) = drawn[0].axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert [own.get_text() for own in axes.get_xticklabels()] == ["1", "2", "4", "8"]
    line = max(axes.lines, key=lambda own: own.get_linewidth() if own.get_linestyle() == "-" else 0)
    slope = np.polyfit(np.log(line.get_xdata()), np.log(line.get_ydata()), 1)[0]
    assert slope == pytest.approx(0.7)
    assert "at 1: 10; at 2: 16.2" in picture.alt
    assert picture.alt.endswith("Exponents are mean 0.7 of 3 values.")
    require_apart(drawn[0])


def test_a_picture_is_the_same_every_time_holds_its_texts_and_loads_nothing():
    found = proportions(4, ("<script>", "$\\frac{$", "日本語"), codes=("a", "b", "c", "--> <x>"))
    contents = [figures.draw_measure(found, "object", "opacity").content for _ in range(2)]
    assert contents[0] == contents[1]
    root = ElementTree.fromstring(contents[0])
    texts = [own.text for own in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"<script>", "$\\frac{$", "日本語", "opacity: 0.7"} <= set(texts)
    assert not list(root.iter("{http://www.w3.org/2000/svg}script"))
    assert not re.search(rb"(?:href|src)\s*=\s*[\"'](?!#)", contents[0])
