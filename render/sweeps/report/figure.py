"""A picture of a sweep: its metrics over one axis that varies, by colour and column over two more."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import SweepError
from ...reports.picture_style import SUFFIXES, save_picture
from .table import AXIS_UNITS, USER_COLUMN, is_missing, is_user_column
from .table_axes import Axis, axis_of, follows, telling_axes

COLOURS = ("#2b2d42", "#c1121f", "#1d6fa5", "#2a9d8f", "#f4a261", "#9b5de5", "#bc6c25", "#e56b9f", "#8d99ae", "#606c38")
MARKERS = "osD^vPX<>*"
COLUMNS_MOST = 6
NUMBERS_FEW = 3  # values from which a number makes a curve
REPLICATES = ("seed", "explorer")  # how often a person, and another person, explores: a point is their mean
METRICS_MOST = 5  # rows of panels
LOG_FROM = 40.0  # greatest over least from which an axis is logarithmic
NAME_MOST, TITLE_MOST = 32, 100  # characters of a name: of a value, of the sweep
UNITS_SHOWN = {"m": ("mm", 1e3), "m2": ("cm²", 1e4), "1": ("", 1.0)}
"""Other units are shown as they are."""
TITLES: dict[str, tuple[str, str]] = {
    "length_mean": ("length", "m"),
    "r": ("r = |CC| / |OC|", "1"),
    "noise_db_300_10k": ("noise, 300 Hz to 10 kHz", "dB"),
    "pressure_focus_pressure": ("pressure at the focal point", "Pa"),
    "draw_frequency_actual": ("draw frequency", "Hz"),
    "jumps": ("jumps, all causes", "1"),
    "area_mean": ("area of contact", "m2"),
    "polylines_mean": ("polylines a pose", "1"),
    "revisit_rate": ("revisit rate", "Hz"),
    "dwell_spread": ("spread of dwell", "1"),
}
"""Metrics shown, the first that there are: title and unit. A user's own metrics come before the draw frequency."""


@dataclass(frozen=True)
class FigureLayout:
    """Where axes stand."""

    x: Axis
    hue: Axis | None
    column: Axis | None
    averaged: tuple[Axis, ...]
    """Replicates, and what there is no room for."""


def draw_sweep(columns: Mapping[str, Sequence[Any] | np.ndarray], picture: Path, *, name: str) -> None:
    """Draw a sweep's table (`tidy_columns`) into a PNG, SVG or PDF.

    Metrics are rows of panels; see `choose_layout` for the axes. A point is the mean over the axes that have no place,
    a bar one standard deviation to each side; the caption names these axes.

    name: of the plan. Raises SweepError for another kind of picture, a table without a result, and where the picture
    cannot be written.
    """
    if picture.suffix not in SUFFIXES:
        raise SweepError(f"{picture}: a picture must end in one of {', '.join(SUFFIXES)}")
    figure = sweep_figure(columns, name=name)
    try:
        save_picture(figure, picture, dpi=120)
    except OSError as error:
        raise SweepError(f"{picture}: the picture cannot be written ({error.strerror or error})") from error


def sweep_figure(columns: Mapping[str, Sequence[Any] | np.ndarray], *, name: str) -> Any:
    """The same as a matplotlib figure."""
    import matplotlib as mpl  # 0.7 s that only pictures cost
    from matplotlib.figure import Figure

    total = len(columns["recipe_hash"])
    rows = np.flatnonzero(np.asarray(columns["complete"], bool)) if "complete" in columns else np.arange(total)
    table: dict[str, list[Any]] = {key: [values[i] for i in rows.tolist()] for key, values in columns.items()}
    metrics = shown_metrics(table) if len(rows) else {}
    if not metrics:
        raise SweepError(f"{name}: no recipe has a result of {', '.join(TITLES)}, so there is nothing to draw")
    layout = choose_layout(table)
    across = len(layout.column.values) if layout.column else 1
    style = {"font.size": 8, "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left"}
    with mpl.rc_context(style):
        size = max(6.4, 1.9 + 2.1 * across), 1.35 + 1.6 * len(metrics)
        figure = Figure(figsize=size, layout="constrained")
        panels = figure.subplots(len(metrics), across, sharex=True, sharey="row", squeeze=False)
        for line, (metric, values) in zip(panels, metrics.items(), strict=True):
            for k, panel in enumerate(line):
                _draw_panel(
                    panel, layout, values, layout.column.code == k if layout.column else np.ones(len(rows), bool)
                )
            title, unit = _shown(metric)[:2]
            line[0].set_ylabel(f"{title} [{unit}]" if unit else title)
            if _spans_decades(values):
                line[0].set_yscale("log")
        for k, panel in enumerate(panels[0] if layout.column else ()):
            panel.set_title(_value(layout.column, k), fontweight="bold")
        for panel in panels[-1]:
            _label_x(panel, layout.x)
        if layout.hue:
            figure.legend(*panels[0, 0].get_legend_handles_labels(), title=_with_unit(layout.hue.name),
                          loc="outside right upper", frameon=False)  # fmt: skip
        _add_texts(figure, layout, table, name, total)
    return figure


def choose_layout(table: Mapping[str, Sequence[Any]]) -> FigureLayout:
    """Give axes that vary their places.

    | place | takes | at most |
    |---|---|---|
    | x | a number of 3 values or more, else words; of several the one with the most values, strategies last | |
    | colours | the strategy, else words, else a number | 10 |
    | columns | the object, else words, else a number | 6 |
    | averaged over | seeds and explorers, and the rest | |

    An axis that follows from those that have a place (the scale of each object, say) needs none.
    """
    axes = telling_axes(table)
    left = [axis for axis in axes if not axis.name.endswith(REPLICATES)]
    x = max(left, key=_rank_as_x, default=None)
    if x is None:
        x = axis_of("strategy", table.get("strategy") or [""] * len(table["recipe_hash"]))
    placed: list[Axis] = [x]
    places: list[Axis | None] = []
    for first, most in (("strategy", len(COLOURS)), ("object", COLUMNS_MOST)):
        able = [axis for axis in left if axis not in placed and len(axis.values) <= most and not follows(axis, placed)]
        own = min(able, key=lambda axis: (axis.name != first, axis.is_numeric), default=None)
        places.append(own)
        placed += [own] if own else []
    rest = [axis for axis in axes if not any(axis is own for own in placed) and not follows(axis, placed)]
    return FigureLayout(x, places[0], places[1], tuple(rest))


def _rank_as_x(axis: Axis) -> tuple[bool, bool, int]:
    is_curve = axis.is_numeric and len(axis.values) >= NUMBERS_FEW
    return is_curve, axis.name != "strategy" or len(axis.values) > len(COLOURS), len(axis.values)


def _draw_panel(panel: Any, layout: FigureLayout, values: np.ndarray, rows: np.ndarray) -> None:
    """One metric over x, a line or a row of points for each colour."""
    x, hue = layout.x, layout.hue
    lanes = len(hue.values) if hue else 1
    for lane in range(lanes):
        mine = rows & np.isfinite(values) & (hue.code == lane if hue else True)
        codes = np.unique(x.code[mine])
        groups = [values[mine & (x.code == code)] for code in codes]
        middle, spread = (np.array([f(group) for group in groups]) for f in (np.mean, np.std))
        # Words get a place each, beside which the colours stand.
        across = (
            np.array([x.values[k] for k in codes], float)
            if x.is_numeric
            else codes + 0.7 * ((lane + 0.5) / lanes - 0.5)
        )
        panel.errorbar(
            across, middle, spread if spread.any() else None, ls="-" if x.is_numeric else "", lw=1.1, elinewidth=0.8,
            ms=3.5, marker=MARKERS[lane], color=COLOURS[lane], label=_value(hue, lane) if hue else None,
        )  # fmt: skip
    panel.grid(axis="y", color="#e5e5e5", lw=0.6)
    panel.set_axisbelow(True)


def _label_x(panel: Any, x: Axis) -> None:
    panel.set_xlabel(_with_unit(x.name))
    if not x.is_numeric:
        labels = [_value(x, k) for k in range(len(x.values))]
        is_long = sum(map(len, labels)) > 24
        panel.set_xticks(range(len(labels)), labels, rotation=45 if is_long else 0, ha="right" if is_long else "center")
    elif _spans_decades(np.array(x.values, float)):
        panel.set_xscale("log")


def _spans_decades(values: np.ndarray) -> bool:
    """Whether values are above 0 and differ so much that most would lie on each other on a linear axis."""
    known = values[np.isfinite(values)]
    return bool(len(known) and known.min() > 0 and known.max() > LOG_FROM * known.min())


def _add_texts(figure: Any, layout: FigureLayout, table: Mapping[str, Sequence[Any]], name: str, total: int) -> None:
    """Title and caption; total: recipes, with those that are left out."""
    parts = [f"{total:,} recipe{'s' * (total != 1)}"]
    if "poses" in table:
        parts.append(f"{np.nansum(_numbers(table['poses'])):,.0f} poses")
    parts += sorted({str(maker).partition(", ")[0] for maker in table.get("maker", ())})[:2]
    notes = [", ".join(parts)]
    if layout.averaged:
        over = ", ".join(f"{_words(axis.name)} ({len(axis.values)})" for axis in layout.averaged)
        notes.append(f"Means over {over}; bars: one standard deviation.")
    if left_out := total - len(table["recipe_hash"]):
        notes.append(f"{left_out:,} recipe{'s' * (left_out != 1)} without whole results left out.")
    figure.suptitle(shown_name(name, TITLE_MOST), x=0.01, ha="left", fontsize=11, fontweight="bold")
    figure.supxlabel("\n".join(notes), x=0.01, ha="left", fontsize=7, color="#555555", wrap=True)


def shown_name(name: str, most: int = NAME_MOST) -> str:
    """A user's name as matplotlib may have it: on one line, no longer than `most`, `$` not the begin of a formula.

    A long one keeps its begin and its end. Formulas are not turned off for all: ticks of logarithmic axes are some.
    """
    line = " ".join(name.split())
    if len(line) > most:
        line = f"{line[: most // 2]}…{line[len(line) - (most - 1) // 2 :]}"
    return line.replace("$", r"\$")


def _value(axis: Axis, k: int) -> str:
    word = f"{_words(axis.name)} {axis.word(k)}" if axis.is_numeric else axis.word(k)
    return shown_name(word)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _with_unit(name: str) -> str:
    unit = AXIS_UNITS.get(name, "1")
    return _words(name) if unit == "1" else f"{_words(name)} [{unit}]"


def shown_metrics(table: Mapping[str, Sequence[Any]]) -> dict[str, np.ndarray]:
    """Metrics that have values, a few at most, in shown units; what never differs comes only if nothing else does."""
    # What was asked for beyond contours and draw frequency comes first, but for the length.
    own = [name for name in table if is_user_column(name) and name.endswith("_mean")]
    place = list(TITLES).index("draw_frequency_actual")
    names = [*list(TITLES)[:place], *own, *list(TITLES)[place:]]
    source: dict[str, np.ndarray] = {key: _numbers(table[key]) for key in names if key in table}
    if jumps := [_numbers(table[key]) for key in table if key.startswith("jumps_")]:
        source["jumps"] = np.sum(jumps, axis=0)
    there = {key: source[key] for key in names if key in source and np.isfinite(source[key]).any()}
    telling = {key: values for key, values in there.items() if np.nanmax(values) > np.nanmin(values)} or there
    return {key: _shown(key)[2] * values for key, values in list(telling.items())[:METRICS_MOST]}


def _shown(metric: str) -> tuple[str, str, float]:
    """Title, shown unit and factor; a user's own metric has the name of its function, and no unit."""
    own = _words(metric.removeprefix(USER_COLUMN).removesuffix("_mean"))
    title, unit = TITLES.get(metric, (own, "1"))
    return title, *UNITS_SHOWN.get(unit, (unit, 1.0))


def _numbers(values: Sequence[Any]) -> np.ndarray:
    """float64, NaN for what is missing."""
    return np.array([math.nan if is_missing(value) else value for value in values], np.float64)
