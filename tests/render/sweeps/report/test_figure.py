"""The picture of a sweep: which axis stands where, what is averaged over, and what it says of itself."""

from itertools import product

import numpy as np
import pytest
from sweep_rows import table

from palpate.render.errors import SweepError
from palpate.render.sweeps.report.figure import ROWS, caption, draw_sweep, shown_metrics, sweep_figure
from palpate.render.sweeps.report.layout import choose_layout, choose_views, varying_axes

OBJECTS = ["cube", "sphere", "tube", "dog", "dog-detailed", "rock"]
MESHES = [f"mesh {k}" for k in range(40)]
MANY = [f"strategy {k}" for k in range(17)]


def swept(**axes):
    """A table over all combinations of some axes, with metrics that vary."""
    rng = np.random.default_rng(7)
    rows = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    names = ("length_mean", "r", "draw_frequency_actual", "area_mean")
    return table(*(row | {name: float(rng.uniform(0.1, 0.2)) for name in names} for row in rows))


TWO, SPEEDS = ["oc", "cc"], [5.0, 7.0, 9.0]
FIVE = {"strategy": TWO, "object": OBJECTS, "hand": ["palm", "planes"], "speed": SPEEDS, "object_fit": [0.08, 0.1]}
PLACES = [  # axes; x, colours, columns, dashes; averaged over
    ({}, "strategy - - -", []),
    ({"strategy": TWO}, "strategy - - -", []),
    ({"seed": range(9)}, "strategy - - -", ["seed"]),
    ({"strategy": TWO, "object": OBJECTS}, "object strategy - -", []),
    ({"strategy": MANY, "object": OBJECTS}, "strategy object - -", []),
    ({"strategy": TWO, "explorer": range(1, 11), "object": OBJECTS}, "object strategy - -", ["explorer"]),
    ({"strategy": TWO, "object": OBJECTS, "speed": SPEEDS}, "speed strategy object -", []),
    ({"strategy": TWO, "speed": SPEEDS, "seed": range(3)}, "speed strategy - -", ["seed"]),
    (FIVE | {"seed": range(2)}, "speed strategy object hand", ["seed", "object_fit"]),
    ({"object": MESHES, "strategy": TWO}, "strategy - - -", ["object"]),
    ({"object": MESHES[:20], "strategy": TWO}, "object strategy - -", []),
    ({"strategy": MANY, "speed": np.linspace(1, 9, 30).tolist()}, "speed strategy - -", []),
]


@pytest.mark.parametrize(("axes", "places", "averaged"), PLACES, ids=lambda given: str(given)[:40])
def test_axes_have_their_places(axes, places, averaged):
    layout = choose_layout(swept(**axes))
    placed = [axis.name if axis else "-" for axis in (layout.x, layout.hue, layout.column, layout.dash)]
    assert " ".join(placed) == places
    assert [axis.name for axis in layout.averaged] == averaged


def test_columns_that_tell_the_same_rows_apart_are_one_axis():
    rows = table(*({"palm_width": w, "palm_length": 1.2 * w, "seed": s} for w in (0.06, 0.085) for s in (1, 2)))
    assert [axis.name for axis in varying_axes(rows)] == ["palm_width", "seed"]


def test_what_follows_from_an_axis_has_no_place_and_is_not_averaged_over():
    fit = {"cube": 0.1, "tube": 0.2, "rock": 0.1}
    layout = choose_layout(
        table(*({"object": name, "object_fit": fit[name], "strategy": s} for name in fit for s in TWO))
    )
    assert layout.hue is not None
    assert [layout.x.name, layout.hue.name] == ["object", "strategy"]
    assert (layout.column, layout.dash, layout.averaged) == (None, None, ())


def test_a_number_that_some_rows_lack_is_a_word():
    rows = table(*({"palm_width": width} for width in (0.06, 0.085, None)))
    axis = varying_axes(rows)[0]
    assert not axis.is_numeric
    assert [axis.word(k) for k in range(3)] == ["0.06", "0.085", "none"]


def texts(figure):
    """All that a figure says."""
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


@pytest.mark.exhaustive
def test_small_multiples_have_a_column_an_object_and_a_row_a_metric():
    axes = {"strategy": ["oc", "cc"], "object": OBJECTS, "palm_width": [0.05, 0.07, 0.09], "seed": range(3)}
    figure = sweep_figure(swept(**axes), name="my study")
    assert len(figure.axes) == 6 * 4
    assert [panel.get_title(loc="left") for panel in figure.axes[:6]] == OBJECTS
    labels = [panel.get_ylabel() for panel in figure.axes[::6]]
    assert labels == ["length [mm]", "r = |CC| / |OC|", "draw frequency [Hz]", "area of contact [cm²]"]
    assert {panel.get_xlabel() for panel in figure.axes[-6:]} == {"palm width [m]"}
    assert all(len(panel.lines) == 2 for panel in figure.axes)
    assert all(len(panel.collections) == 2 for panel in figure.axes)  # bands
    said = texts(figure)
    assert "my study" in said
    assert any(
        t.startswith("108 recipes, 10,800 poses, hand\nMeans over seed (3); spread: one standard deviation.")
        for t in said
    )
    assert {"strategy", "  oc", "  cc"} <= set(said)


def test_means_and_spreads_are_those_of_the_replicates():
    rows = table(*({"duration": v, "seed": s, "length_mean": 0.1 * v + 0.01 * s} for v in (5, 6, 7) for s in (1, 3)))
    panel = sweep_figure(rows, name="x").axes[0]
    assert panel.lines[0].get_xdata().tolist() == [5, 6, 7]
    assert panel.lines[0].get_ydata() == pytest.approx([520, 620, 720])
    assert panel.collections[0].get_paths()[0].get_extents().ymin == pytest.approx(510)


def test_words_stand_at_the_left_where_no_axis_takes_the_columns():
    figure = sweep_figure(swept(strategy=MANY, seed=range(3)), name="x")
    assert len(figure.axes) == 4
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == MANY
    low, high = figure.axes[0].get_ylim()
    assert low > high  # the first on top


def test_metrics_that_never_differ_make_room_and_lacking_ones_are_no_hindrance():
    rows = table({"seed": 1, "length_mean": 0.1, "r": None}, {"seed": 2, "length_mean": 0.2, "r": None})
    assert list(shown_metrics(rows)) == ["length_mean"]
    assert list(shown_metrics(table({}))) == ["length_mean", "r", "draw_frequency_actual", "jumps", "area_mean"]
    assert len(shown_metrics(table({}))) <= ROWS
    asked = {"noise_db_300_10k": 40.0, "pressure_focus_pressure": 3000.0, "metric_share_mean": 0.5}
    chosen = shown_metrics(table(*({"seed": k} | {name: k * v for name, v in asked.items()} for k in (1, 2))))
    assert list(chosen) == list(asked)  # what a plan asks for is shown; contours are in every table
    both = table({"jumps_pose": 1}, {"jumps_pose": 2}) | {"jumps_order": [3, None]}
    assert shown_metrics(both)["jumps"][0] == 4


def rendered(**axes):
    """A table as `swept`, whose lengths do not depend on the sampling, as a sweep's do not."""
    rows = swept(**axes)
    names = [name for name in axes if name not in ("speed", "sampling", "array")]
    first = {}
    for name in ("length_mean", "r", "area_mean"):
        for row, key in enumerate(zip(*(rows[axis] for axis in names), strict=True)):
            rows[name][row] = first.setdefault((name, key), rows[name][row])
    return rows


def test_a_metric_is_drawn_over_the_axes_that_it_depends_on_only():
    figure = sweep_figure(rendered(strategy=TWO, object=OBJECTS, speed=SPEEDS, seed=range(2)), name="x")
    lengths, frequencies = figure.subfigs
    assert {panel.get_xlabel() for panel in frequencies.axes} - {""} == {"speed [m/s]"}
    assert [label.get_text() for label in lengths.axes[0].get_yticklabels()] == OBJECTS
    assert [panel.get_title(loc="left") for panel in lengths.axes] == [
        "length [mm]", "r = |CC| / |OC|", "area of contact [cm²]",
    ]  # fmt: skip
    (note,) = (text for text in texts(figure) if "palpate" in text or "recipes" in text)
    assert "length, r = |CC| / |OC|, area of contact: the same for every speed; means over seed (2)" in " ".join(
        note.split()
    )
    assert "draw frequency: means over seed (2)" in " ".join(note.split())


def test_equal_results_count_once_however_many_recipes_share_them():
    rows = table(
        *(
            {"strategy": s, "seed": k, "sampling": sampling, "length_mean": length, "draw_frequency_actual": length * n}
            for s in TWO
            for k, length in ((1, 0.1), (2, 0.3))
            for n, sampling in enumerate(("stm", "pendulum", "still")[: 3 if k == 1 else 1], 1)
        )
    )
    views = {metric: view for view in choose_views(rows, shown_metrics(rows)) for metric in view.metrics}
    lengths, frequencies = views["length_mean"], views["draw_frequency_actual"]
    assert lengths.metrics["length_mean"].tolist() == [100, 300] * 2
    assert (lengths.omitted, frequencies.omitted) == (("sampling",), ())
    assert len(frequencies.metrics["draw_frequency_actual"]) == 8
    panel = sweep_figure(rows, name="x").axes[0]
    assert [line.get_xdata().tolist() for line in panel.lines if len(line.get_xdata()) == 2][-1] == [200, 200]


def test_an_axis_that_nothing_depends_on_has_no_place():
    rows = swept(strategy=TWO, speed=SPEEDS)
    alike = {name: [value for value in values for _ in range(2)] for name, values in rows.items()}
    alike |= {"array": ["emulator", "pat"] * 6, "recipe_hash": [f"{k:032x}" for k in range(12)]}
    for view in choose_views(alike, {"draw_frequency_actual": np.array(alike["draw_frequency_actual"])}):
        assert view.omitted == ("array",)
        assert view.layout.places == ("speed", "strategy", "", "")
        assert len(view.layout.x.code) == 6
        assert caption([view], 0, 80) == ["The same for every array."]


ODD = ["a$^$b", "$", r"\$x$", "two\nlines", "$" * 7, "long " * 30]


@pytest.mark.exhaustive
@pytest.mark.parametrize("axis", ["strategy", "object"])
def test_names_are_shown_as_they_are_and_long_ones_cut(tmp_path, axis):
    rows = swept(**{axis: ODD, "speed": [5.0, 7.0]})
    rows["length_mean"] = [0.1**k for k in range(len(rows["speed"]))]  # a logarithmic axis, whose ticks are formulas
    draw_sweep(rows, tmp_path / "sweep.svg", name="a$^$b")
    figure = sweep_figure(rows, name="a$^$b " * 50)
    figure.draw_without_rendering()
    shown = [text.replace(r"\$", "$").strip() for text in texts(figure)]
    assert {"a$^$b", "$", r"\$x$", "two lines", "$" * 7} <= set(shown)
    assert len(figure.get_suptitle().replace(r"\$", "$")) == 100
    assert not any("long " * 9 in text for text in shown)
    assert any(text.startswith(r"$\mathdefault") for text in texts(figure))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("suffix", "begin"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures_are_written(tmp_path, suffix, begin):
    path = tmp_path / f"sweep{suffix}"
    draw_sweep(swept(strategy=["oc", "cc"], object=OBJECTS), path, name="x")
    assert path.read_bytes().startswith(begin)


def test_bad_pictures_are_refused(tmp_path):
    with pytest.raises(SweepError, match="must end in one of"):
        draw_sweep(table({}), tmp_path / "sweep.jpg", name="x")
    with pytest.raises(SweepError, match="cannot be written"):
        draw_sweep(table({}), tmp_path / "missing" / "sweep.png", name="x")
    with pytest.raises(SweepError, match="nothing to draw"):
        draw_sweep({"recipe_hash": ["a"], "strategy": ["cc"]}, tmp_path / "sweep.png", name="x")
