"""A picture of a sweep: small multiples of its metrics over the axes that vary."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import SweepError
from ...reports.picture_style import SUFFIXES, save_picture
from .layout import Axis, FigureLayout, View, choose_views
from .table import AXIS_UNITS, USER_COLUMN, is_missing, is_user_column

COLOURS = ("#2b2d42", "#c1121f", "#1d6fa5", "#2a9d8f", "#f4a261", "#9b5de5", "#bc6c25", "#e56b9f", "#8d99ae", "#606c38")
MARKERS = "osD^vPX<>*"
DASHES = ("-", "--", ":", "-.")
ACROSS = 3  # panels in a row where no axis takes the columns
REMARKS = {
    "length_mean": "Length: mean over all poses; one without contact counts as 0.",
    "draw_frequency_actual": "Draw frequency: mean over poses with contours; few short contours can dominate it.",
}
"""Of metrics shown: what a reader of the picture would not guess."""
ROWS = 5  # metrics shown at most
SHOWN_UNITS = {
    "m": ("mm", 1e3),
    "m2": ("cm²", 1e4),
    "Hz": ("Hz", 1.0),
    "dB": ("dB", 1.0),
    "Pa": ("Pa", 1.0),
    "1": ("", 1.0),
}
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
"""Metrics shown, the first that there are: title and unit. A user's own metrics come before the last of them."""

LOG_FROM = 40.0  # greatest over least from which an axis is logarithmic
SINGLE_MOST = 40  # results of a point that are drawn one by one
BANDS_CLEAR = 4  # series of which a reader can distinguish the spreads
MARKED_MOST = 25  # points of a line that have markers
NAME_MOST, TITLE_MOST = 32, 100  # characters of a name: of a value, of the sweep
WIDE = 9  # characters of a tick label from which labels stand on end
COMMA = ", "


def draw_sweep(
    columns: Mapping[str, Sequence[Any] | np.ndarray],
    picture: Path,
    *,
    name: str,
) -> None:
    """Draw a sweep's table (`tidy_columns`) into a PNG, SVG or PDF.

    Metrics are rows of panels; x, colours, columns and dashes are those of `choose_layout`, for each metric of the axes
    that it depends on. What is left is averaged over: a point is a mean, a band or bar one standard deviation to each
    side. The caption names what is averaged over, and what metrics do not depend on.

    name: of the plan. Raises SweepError for another kind of picture, a table without a
    result, and where the picture cannot be written.
    """
    if picture.suffix not in SUFFIXES:
        raise SweepError(f"{picture}: a picture must end in one of {COMMA.join(SUFFIXES)}")
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
    if not len(rows):
        raise SweepError(f"{name}: no recipe has its results, so there is nothing to draw")
    table: dict[str, list[Any]] = {key: [values[i] for i in rows.tolist()] for key, values in columns.items()}
    metrics = shown_metrics(table)
    if not metrics:
        raise SweepError(f"{name}: the table has none of {COMMA.join(TITLES)}, so there is nothing to draw")
    views = choose_views(table, metrics)
    style = {"font.size": 8, "axes.spines.top": False, "axes.spines.right": False, "axes.titlelocation": "left"}
    with mpl.rc_context(style):
        # Views whose axes have the same places are one block; metrics keep their order.
        rows_of = {metric: (view.layout, values) for view in views for metric, values in view.metrics.items()}
        found: dict[tuple[str, ...], dict[str, tuple[FigureLayout, np.ndarray]]] = {}
        for metric in metrics:
            found.setdefault(rows_of[metric][0].places, {})[metric] = rows_of[metric]
        blocks = [_Block(own) for own in found.values()]
        heights = [block.height for block in blocks]
        figure = Figure(figsize=(max(block.width for block in blocks), 1.35 + sum(heights)), layout="constrained")
        figure.get_layout_engine().set(w_pad=0.05, h_pad=0.05)  # type: ignore[union-attr]  # given one line before
        areas = figure.subfigures(len(blocks), 1, height_ratios=heights) if blocks[1:] else [figure]
        for area, block in zip(areas, blocks, strict=True):
            _draw_block(area, block)
        _label(figure, views, table, name, total)
    return figure


@dataclass(frozen=True)
class _Block:
    """Panels that share their axes."""

    metrics: Mapping[str, tuple[FigureLayout, np.ndarray]]
    """Layouts have the same places, and differ in their rows."""

    @property
    def layout(self) -> FigureLayout:
        """Of any of them."""
        return next(iter(self.metrics.values()))[0]

    @property
    def grid(self) -> tuple[int, int]:
        """Panels below and beside each other."""
        return (1, len(self.metrics)) if _lies(self.layout) else _grid(len(self.metrics), self.layout)

    @property
    def width(self) -> float:
        """[inch]."""
        return max(6.4, 1.9 + 2.1 * self.grid[1])

    @property
    def height(self) -> float:
        """[inch]."""
        if not _lies(self.layout):
            return 1.6 * self.grid[0]
        return 0.3 + len(self.layout.x.values) * max(0.17, 0.08 * (1 + _lanes(self.layout)))


def _draw_block(area: Any, block: _Block) -> None:
    """Draw panels and their legend into a figure or a part of one."""
    layout, lies = block.layout, _lies(block.layout)
    share_y = "row" if layout.column or lies else False
    axes = area.subplots(*block.grid, sharex=not lies, sharey=share_y, squeeze=False)
    _draw_panels(axes, layout, block.metrics)
    handles = [
        handle
        for axis in (layout.hue, layout.dash)
        if axis is not None
        for handle in _legend(axis, layout, _with_unit(axis.name))
    ]
    if handles:
        legend = area.legend(handles=handles, loc="outside right upper", frameon=False, handlelength=1.8)
        for text in legend.get_texts():
            text.set_fontweight("normal" if text.get_text().startswith(" ") else "bold")


def _grid(metric_count: int, layout: FigureLayout) -> tuple[int, int]:
    if layout.column is not None:
        return metric_count, len(layout.column.values)
    across = min(metric_count, 2 if metric_count == 4 else ACROSS)
    return -(-metric_count // across), across


def _lies(layout: FigureLayout) -> bool:
    """Whether words stand one below the other at the left, metrics side by side: words are read best like that."""
    return not layout.x.is_numeric and layout.column is None


def _lanes(layout: FigureLayout) -> int:
    """Series in a panel."""
    return math.prod(len(axis.values) for axis in (layout.hue, layout.dash) if axis)


def _draw_panels(
    axes: np.ndarray, layout: FigureLayout, metrics: Mapping[str, tuple[FigureLayout, np.ndarray]]
) -> None:
    column, panels_all = layout.column, axes.ravel()
    for i, (metric, (own, values)) in enumerate(metrics.items()):
        panels = axes[i] if column else [panels_all[i]]
        for k, panel in enumerate(panels):
            rows = np.flatnonzero(own.column.code == k) if own.column else np.arange(len(values))
            _draw_panel(panel, own, values, rows)
            if i == 0 and column:
                title = f"{_words(column.name)} {column.word(k)}" if column.is_numeric else _value(column, k)
                panel.set_title(title, fontsize=9, fontweight="bold")
        title, unit = titled(metric)
        shown = SHOWN_UNITS[unit][0]
        (panels[0].set_ylabel if column else panels[0].set_title)(f"{title} [{shown}]" if shown else title, fontsize=8)
        # Logarithmic if most would else lie on top of each other; with zeros, linear below the small ones.
        positive = values[values > 0]
        low = float(np.quantile(positive, 0.1)) if len(positive) else 0.0
        if low and positive.max() > LOG_FROM * low:
            set_scale = panels[0].set_xscale if _lies(layout) else panels[0].set_yscale
            has_zero = len(positive) < np.isfinite(values).sum()
            set_scale("symlog", linthresh=low) if has_zero else set_scale("log")
    for panel in () if column else panels_all[len(metrics) :]:
        panel.remove()
    if _lies(layout):
        labels = [_value(layout.x, k) for k in range(len(layout.x.values))]
        panels_all[0].set_yticks(range(len(labels)), labels)
        panels_all[0].set_ylim(len(labels) - 0.4, -0.6)  # the first on top
        panels_all[0].set_ylabel(_words(layout.x.name))
    else:
        for panel in axes[-1] if column else panels_all[: len(metrics)][-axes.shape[1] :]:
            _label_x(panel, layout.x)


def _label_x(panel: Any, x: Axis) -> None:
    panel.tick_params(labelbottom=True)
    panel.set_xlabel(_with_unit(x.name))
    if not x.is_numeric:
        labels = [_value(x, k) for k in range(len(x.values))]
        on_end = max(map(len, labels)) * len(labels) > 24 or max(map(len, labels)) > WIDE
        panel.set_xticks(range(len(labels)), labels, rotation=45 if on_end else 0, ha="right" if on_end else "center")
        if on_end:
            for label in panel.get_xticklabels():
                label.set_rotation_mode("anchor")
        panel.set_xlim(-0.6, len(labels) - 0.4)
    elif x.values[0] > 0 and x.values[-1] > LOG_FROM * x.values[0]:
        panel.set_xscale("log")


def _draw_panel(panel: Any, layout: FigureLayout, values: np.ndarray, rows: np.ndarray) -> None:
    """One metric over x, a line or a row of points for each colour and dash."""
    hues, dashes, lanes = layout.hue, layout.dash, _lanes(layout)
    dash_count = len(dashes.values) if dashes else 1
    for lane in range(lanes):
        h, d = divmod(lane, dash_count)
        mine = rows[hues.code[rows] == h] if hues else rows
        mine = mine[dashes.code[mine] == d] if dashes else mine
        mine = mine[np.isfinite(values[mine])]
        if not len(mine):
            continue
        look = {"color": _colour(hues, h), "marker": MARKERS[h % len(MARKERS)], "ls": DASHES[d]}
        face = "white" if d else look["color"]
        if layout.x.is_numeric:
            _draw_line(
                panel, layout.x, values, mine, {**look, "mfc": face}, alpha=0.13 if lanes <= BANDS_CLEAR else 0.06
            )
        else:
            shift = 0.7 * ((lane + 0.5) / lanes - 0.5)
            points = _Points(shift, look["color"], look["marker"], face, lanes <= BANDS_CLEAR, _lies(layout))
            _draw_points(panel, layout.x, values, mine, points)
    panel.grid(axis="y", color="#e5e5e5", lw=0.6)
    if _lies(layout):
        panel.grid(axis="x", color="#e5e5e5", lw=0.6)
    panel.set_axisbelow(True)


def _groups(x: Axis, values: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Places on x that rows have, and the values at each."""
    codes = np.unique(x.code[rows])
    return codes, [values[rows[x.code[rows] == code]] for code in codes.tolist()]


def _draw_line(
    panel: Any, x: Axis, values: np.ndarray, rows: np.ndarray, look: dict[str, Any], *, alpha: float
) -> None:
    codes, groups = _groups(x, values, rows)
    middle, spread = (np.array([f(group) for group in groups]) for f in (np.mean, np.std))
    across = np.array([x.values[k] for k in codes.tolist()], float)
    marker = look["marker"] if len(codes) <= MARKED_MOST else ""
    panel.plot(across, middle, lw=1.1, ms=3.5, **look | {"marker": marker})
    if spread.any():
        panel.fill_between(across, middle - spread, middle + spread, color=look["color"], alpha=alpha, lw=0)


@dataclass(frozen=True)
class _Points:
    """How points over words look."""

    shift: float
    colour: Any
    marker: str
    face: Any
    singles: bool
    """Whether there is room for every result."""
    lies: bool


def _draw_points(panel: Any, x: Axis, values: np.ndarray, rows: np.ndarray, points: _Points) -> None:
    codes, groups = _groups(x, values, rows)
    middle, spread = (np.array([f(group) for group in groups]) for f in (np.mean, np.std))
    turn = -1 if points.lies else 1  # y comes after x
    for code, group in zip(codes.tolist(), groups, strict=True):
        if points.singles and 1 < len(group) <= SINGLE_MOST:
            pair = (np.full(len(group), code + points.shift), group)[::turn]
            panel.plot(*pair, ".", color=points.colour, alpha=0.2, ms=3, mew=0)
    bars = {"xerr" if points.lies else "yerr": spread} if spread.any() else {}
    look = {"marker": points.marker, "color": points.colour, "mfc": points.face, "ms": 4, "elinewidth": 1.0}
    panel.errorbar(*(codes + points.shift, middle)[::turn], ls="", **bars, **look)


def _colour(hues: Axis | None, k: int) -> Any:
    import matplotlib as mpl

    if hues is None:
        return COLOURS[0]
    if hues.is_numeric and len(hues.values) > 2:
        return mpl.colormaps["viridis"](0.9 * k / (len(hues.values) - 1))
    return COLOURS[k] if len(hues.values) <= len(COLOURS) else mpl.colormaps["tab20"](k % 20)


def _label(figure: Any, views: Sequence[View], table: Mapping[str, Sequence[Any]], name: str, total: int) -> None:
    """Title and caption; total: recipes, with those that are left out."""
    poses = np.nansum(numbers(table["poses"])) if "poses" in table else None
    parts = [f"{total:,} recipe{'s' * (total != 1)}", *([f"{poses:,.0f} poses"] if poses else [])]
    parts += sorted({str(maker).partition(COMMA)[0] for maker in table.get("maker", ())})[:2]
    figure.suptitle(shown_name(name, TITLE_MOST), x=0.01, ha="left", fontsize=11, fontweight="bold")
    notes = caption(views, total - len(table["recipe_hash"]), int(18 * figure.get_figwidth()))
    notes += [REMARKS[metric] for view in views for metric in view.metrics if metric in REMARKS]
    figure.supxlabel("\n".join([COMMA.join(parts), *notes]), x=0.01, ha="left", fontsize=7, color="#555555")


def _legend(axis: Axis, layout: FigureLayout, title: str) -> list[Any]:
    """A heading, and how each value looks."""
    from matplotlib.lines import Line2D

    handles: list[Any] = [Line2D([], [], ls="", label=title)]
    for k in range(len(axis.values)):
        is_hue = axis is layout.hue
        colour, marker = (_colour(axis, k), MARKERS[k % len(MARKERS)]) if is_hue else (COLOURS[0], "o")
        line = ("-" if is_hue else DASHES[k]) if layout.x.is_numeric else ""
        look = {"color": colour, "marker": marker, "mfc": colour if is_hue or not k else "white", "ls": line}
        handles.append(Line2D([], [], ms=4, lw=1.1, label=f"  {_value(axis, k)}", **look))
    return handles


def caption(views: Sequence[View], left_out: int, width: int) -> list[str]:
    """What a point is and what is not shown, in lines of `width` characters."""
    words = [text for view in views if (text := _described(view, is_alone=len(views) == 1))]
    words += [f"{left_out:,} recipe{'s' * (left_out != 1)} without whole results left out."] if left_out else []
    return [line for sentence in words for line in textwrap.wrap(sentence, width)]


def _described(view: View, *, is_alone: bool) -> str:
    """A sentence on what the points of a view are; its metrics are named unless it is alone."""
    over = COMMA.join(f"{_words(axis.name)} ({len(axis.values)})" for axis in view.layout.averaged)
    clauses = [f"the same for every {COMMA.join(map(_words, view.omitted))}"] if view.omitted else []
    clauses += [f"means over {over}", "spread: one standard deviation"] if over else []
    text = "; ".join(clauses)
    titles = COMMA.join(titled(metric)[0].partition(COMMA)[0] for metric in view.metrics)
    return f"{text[0].upper() + text[1:] if is_alone else f'{titles}: {text}'}." if text else ""


def shown_name(name: str, most: int = NAME_MOST) -> str:
    """A user's name as matplotlib may have it: on one line, no longer than `most`, `$` not the begin of a formula.

    A long one keeps its begin and its end. Formulas are not turned off for all: ticks of logarithmic axes are some.
    """
    line = " ".join(name.split())
    if len(line) > most:
        line = f"{line[: most // 2]}…{line[len(line) - (most - 1) // 2 :]}"
    return line.replace("$", r"\$")


def _value(axis: Axis, k: int) -> str:
    return shown_name(axis.word(k))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _with_unit(name: str) -> str:
    unit = AXIS_UNITS.get(name, "1")
    return _words(name) if unit in ("", "1") else f"{_words(name)} [{unit}]"


def shown_metrics(table: Mapping[str, Sequence[Any]]) -> dict[str, np.ndarray]:
    """Metrics that have values, at most ROWS, in shown units; what never differs comes only if nothing else does."""
    jumps = [numbers(table[key]) for key in table if key.startswith("jumps_")]
    # What was asked for beyond contours and draw frequency comes first, but for the length.
    own = [name for name in table if is_user_column(name) and name.endswith("_mean")]
    place = list(TITLES).index("draw_frequency_actual")
    names = [*list(TITLES)[:place], *own, *list(TITLES)[place:]]
    source: dict[str, np.ndarray] = {key: numbers(table[key]) for key in names if key in table}
    if jumps:
        source["jumps"] = np.sum(jumps, axis=0)
    there = {key: source[key] for key in names if key in source and np.isfinite(source[key]).any()}
    telling = {key: values for key, values in there.items() if np.nanmax(values) > np.nanmin(values)} or there
    return {key: SHOWN_UNITS[titled(key)[1]][1] * values for key, values in list(telling.items())[:ROWS]}


def titled(metric: str) -> tuple[str, str]:
    """Title and unit; a user's own metric has the name of its function, and no unit."""
    return TITLES.get(metric) or (metric.removeprefix(USER_COLUMN).removesuffix("_mean").replace("_", " "), "1")


def numbers(values: Sequence[Any]) -> np.ndarray:
    """float64, NaN for what is missing."""
    return np.array([math.nan if is_missing(value) else value for value in values], np.float64)
