"""The picture of a sweep: which axis stands where, what is averaged over, and what it shows in words."""

from itertools import product

import numpy as np
import pytest
from sweep_rows import table

from palpate.render.errors import SweepError
from palpate.render.sweeps.report.figure import METRICS_MOST, choose_layout, draw_sweep, shown_metrics, sweep_figure

OBJECTS = ["cube", "sphere", "tube", "dog", "dog-detailed", "rock"]
MANY = [f"strategy {k}" for k in range(17)]
TWO, SPEEDS = ["oc", "cc"], [5.0, 7.0, 9.0]
PLACES = [  # axes; x, colours, columns; averaged over
    ({}, "strategy - -", []),
    ({"strategy": TWO}, "strategy - -", []),
    ({"strategy": TWO, "object": OBJECTS}, "object strategy -", []),
    ({"strategy": MANY, "object": OBJECTS}, "strategy object -", []),
    ({"strategy": TWO, "object": OBJECTS, "speed": SPEEDS}, "speed strategy object", []),
    ({"strategy": TWO, "speed": SPEEDS, "seed": range(3)}, "speed strategy -", ["seed"]),
    ({"hand": TWO, "strategy": TWO, "object": OBJECTS, "speed": SPEEDS, "explorer": range(2)},
     "speed strategy object", ["hand", "explorer"]),
]  # fmt: skip


def swept(**axes):
    """A table over all combinations of some axes, with metrics that vary."""
    rng = np.random.default_rng(7)
    rows = [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]
    names = ("length_mean", "r", "draw_frequency_actual", "area_mean")
    return table(*(row | {name: float(rng.uniform(0.1, 0.2)) for name in names} for row in rows))


@pytest.mark.parametrize(("axes", "places", "averaged"), PLACES, ids=lambda given: str(given)[:40])
def test_axes_have_their_places(axes, places, averaged):
    layout = choose_layout(swept(**axes))
    assert " ".join(axis.name if axis else "-" for axis in (layout.x, layout.hue, layout.column)) == places
    assert sorted(axis.name for axis in layout.averaged) == sorted(averaged)


def test_what_follows_from_an_axis_has_no_place_and_is_not_averaged_over():
    fit = {"cube": 0.1, "tube": 0.2, "rock": 0.1}
    rows = table(*({"object": name, "object_fit": fit[name], "strategy": s} for name in fit for s in TWO))
    layout = choose_layout(rows)
    assert (layout.x.name, layout.hue and layout.hue.name, layout.column) == ("object", "strategy", None)
    assert layout.averaged == ()


@pytest.mark.exhaustive
def test_panels_have_a_column_an_object_and_a_row_a_metric_and_names_stand_as_they_are(tmp_path):
    rows = swept(strategy=["a$^$b", "long " * 30], object=OBJECTS, palm_width=[0.05, 0.07, 0.09], seed=range(3))
    rows["length_mean"] = [0.1**k for k in range(len(rows["seed"]))]  # a logarithmic axis, whose ticks are formulas
    figure = sweep_figure(rows, name="my study")
    figure.draw_without_rendering()
    assert len(figure.axes) == 6 * 4
    assert [panel.get_title(loc="left") for panel in figure.axes[:6]] == OBJECTS
    labels = [panel.get_ylabel() for panel in figure.axes[::6]]
    assert labels == ["length [mm]", "r = |CC| / |OC|", "draw frequency [Hz]", "area of contact [cm²]"]
    assert {panel.get_xlabel() for panel in figure.axes[-6:]} == {"palm width [m]"}
    assert figure.get_suptitle() == "my study"
    note = figure.get_supxlabel()
    assert note.startswith("108 recipes, 10,800 poses, hand\nMeans over seed (3); bars: one standard deviation.")
    first, second = (text.get_text() for text in figure.legends[0].get_texts())
    assert (first, len(second)) == (r"a\$^\$b", 32)
    draw_sweep(rows, tmp_path / "sweep.svg", name="a$^$b")
    assert (tmp_path / "sweep.svg").read_bytes().startswith(b"<?xml")


def test_means_and_spreads_are_those_of_the_replicates():
    rows = table(*({"duration": v, "seed": s, "length_mean": 0.1 * v + 0.01 * s} for v in (5, 6, 7) for s in (1, 3)))
    panel = sweep_figure(rows, name="x").axes[0]
    assert panel.lines[0].get_xdata().tolist() == [5, 6, 7]
    assert panel.lines[0].get_ydata() == pytest.approx([520, 620, 720])
    assert panel.collections[0].get_segments()[0][:, 1] == pytest.approx([510, 530])


def test_metrics_that_never_differ_make_room_and_lacking_ones_are_no_hindrance():
    rows = table({"seed": 1, "length_mean": 0.1, "r": None}, {"seed": 2, "length_mean": 0.2, "r": None})
    assert list(shown_metrics(rows)) == ["length_mean"]
    assert list(shown_metrics(table({}))) == ["length_mean", "r", "draw_frequency_actual", "jumps", "area_mean"]
    assert len(shown_metrics(table({}))) <= METRICS_MOST
    asked = {"noise_db_300_10k": 40.0, "pressure_focus_pressure": 3000.0, "metric_share_mean": 0.5}
    chosen = shown_metrics(table(*({"seed": k} | {name: k * v for name, v in asked.items()} for k in (1, 2))))
    assert list(chosen) == list(asked)  # what a plan asks for is shown; contours are in every table
    both = table({"jumps_pose": 1}, {"jumps_pose": 2}) | {"jumps_order": [3, None]}
    assert shown_metrics(both)["jumps"][0] == 4


def test_bad_pictures_are_refused(tmp_path):
    with pytest.raises(SweepError, match="must end in one of"):
        draw_sweep(table({}), tmp_path / "sweep.jpg", name="x")
    with pytest.raises(SweepError, match="cannot be written"):
        draw_sweep(table({}), tmp_path / "missing" / "sweep.png", name="x")
    with pytest.raises(SweepError, match="nothing to draw"):
        draw_sweep({"recipe_hash": ["a"], "strategy": ["cc"]}, tmp_path / "sweep.png", name="x")
