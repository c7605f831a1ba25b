"""Figures of an analysis, in one style: each is a picture of values with the words that a reader without eyes needs.

Colours differ in lightness and come with marks of different shape. Names are cut to their room, and nothing is random:
the same values give the same bytes. A function returns None where there is nothing to draw.
"""

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...reports.picture_page import fit_text, text_width
from ...reports.picture_style import DPI, FAINT, INK, picture_bytes
from ...reports.report_pages import PICTURE_STYLE, ReportPicture, drawing
from ...terminal.foreign_text import visible
from .answer_measures import Level, Measure, cell_text, level_text

if TYPE_CHECKING:  # they need the fits, which these pictures only read
    from .level_answers import LevelAnswers, MagnitudeScale
    from .study_analysis import FittedLevels

COLOURS = ("#1d6fa5", "#e08a00", "#3b3b3b", "#74b79c", "#a3195b", "#8d99ae")
"""Of levels: lightness 44, 65, 25, 69, 36 and 63, told apart with any kind of colour vision."""
MARKS = ("o", "s", "^", "D", "v", "P")
WIDTH = 9.4  # [inch] of a wide picture
FONT = PICTURE_STYLE["font.size"]
DASHES = (0, (5, 3))  # of chance, and of means over trials
LEVELS_MOST = 40  # in one picture
PANELS_MOST = 24
LETTERS_MOST = 30  # [1/inch] of the narrowest letters
ROW_LEAST = 0.16  # [inch] from one label to the next below
VIOLIN_LEAST = 5  # values that a violin needs
GOLDEN = 0.6180339887  # multiples of it, without their whole part, fill an interval evenly


def draw_measure(
    measure: Measure, factor: str, colour: str | None = None, *, dot: str = "one cell of a participant"
) -> ReportPicture | None:
    """A measure by the levels of a factor, and of a second one by colour, as the founding paper's figure 6.

    A dot is a participant's value, and `dot` says in the caption of what. A violin shows how the dots are distributed,
    a white diamond their mean.
    """
    levels = list(islice(_levels(measure, factor), LEVELS_MOST))
    left_out = len(list(_levels(measure, factor))) - len(levels)
    colours = [] if colour is None else list(_levels(measure, colour))
    if not 1 < len(colours) <= len(COLOURS):
        colour, colours = None, []
    groups = {
        (place, k): _group(measure, {factor: level} | ({colour: own} if colour is not None else {}))
        for place, level in enumerate(levels)
        for k, own in enumerate(colours or [None])
    }
    if not any(map(len, groups.values())):
        return None
    count = max(1, len(colours))
    slot = min((WIDTH - 1.2) / len(levels), 0.6 + 0.6 * count)  # [inch]
    with _figure(max(4.2, 1.2 + slot * len(levels)), 3.7) as figure:
        slot = (figure.get_figwidth() - 1.2) / len(levels)
        axes = figure.subplots()
        axes.set_ylim(*_limits(measure, np.concatenate(list(groups.values()))))
        width = 0.8 / count
        for (place, k), values in groups.items():
            _draw_group(axes, place + (k - (count - 1) / 2) * width, width, values, k, 72 * slot * width)
        if measure.chance is not None:
            axes.axhline(measure.chance, color=INK, lw=0.9, ls=DASHES, zorder=1.5)
        is_narrow = slot < 0.6
        texts = [_label(level_text(own), 1.5 if is_narrow else 0.92 * slot, 1 if is_narrow else 2) for own in levels]
        axes.set_xticks(range(len(levels)), texts, rotation=90 if is_narrow else 0)
        axes.set_xlim(-0.55, len(levels) - 0.45)
        axes.set_xlabel(_label(factor, figure.get_figwidth() - 1.5))
        axes.set_ylabel(_label(_titled(measure), 2.6, 2))
        _add_legend(figure, *_measure_marks(measure, [f"{colour}: {level_text(own)}" for own in colours]))
        content = picture_bytes(figure, "svg", dpi=DPI)
    means = [
        f"{level_text(levels[place])}{f', {level_text(colours[k])}' if colours else ''}: {_mean_words(values)}"
        for (place, k), values in groups.items()
    ]
    by = factor if colour is None else f"{factor} and {colour}"
    alt = f"Means of {_titled(measure)} by {by}. {'; '.join(means)}."
    alt += "" if measure.chance is None else f" Chance is {measure.chance:g}."
    caption = f"{_capital(_titled(measure))} by {by}. A dot is {dot}; white diamonds are means"
    caption += "." if measure.chance is None else f"; the dashed line is chance, {measure.chance:g}."
    caption += _omitted(left_out, "levels")
    name = f"{measure.name}_by_{factor}" if colour is None else f"{measure.name}_by_{factor}_{colour}"
    return ReportPicture(bytes(content), alt, caption, _file(name))


def draw_participants(measure: Measure) -> ReportPicture | None:
    """A row for each participant, in the order of their means: where there are subgroups, the order shows them."""
    found = {code: own[np.isfinite(own)] for code, own in zip(measure.codes, measure.values, strict=True)}
    lacking = sum(not len(own) for own in found.values())
    means = sorted((float(own.mean()), code) for code, own in found.items() if len(own))
    if not means:
        return None
    row = float(np.clip(8.0 / len(means), 0.03, 0.24))  # [inch]
    step = int(np.ceil(ROW_LEAST / row))
    with _figure(6.4, row * len(means) + 1.2) as figure:
        axes = figure.subplots()
        size = 3.6 if row > 0.1 else 2.0
        across, down = zip(
            *[
                (value, place + offset)
                for place, (_, code) in enumerate(means)
                for value, offset in _stacked(found[code])
            ],
            strict=True,
        )
        axes.plot(across, down, ls="", marker="o", ms=size, mec="none", color=COLOURS[0], alpha=0.6, label="a cell")
        axes.plot(
            [mean for mean, _ in means], range(len(means)), ls="", marker="D", ms=1.5 * size, mfc="white", mec=INK,
            mew=1.0, label="mean of a participant",
        )  # fmt: skip
        axes.set_xlim(*_limits(measure, np.array(across)))
        axes.set_ylim(-0.8, len(means) - 0.2)
        if measure.chance is not None:
            axes.axvline(measure.chance, color=INK, lw=0.9, ls=DASHES, label=f"chance, {measure.chance:g}", zorder=1.5)
        axes.set_yticks(range(0, len(means), step), [_label(code, 1.6) for _, code in means[::step]])
        axes.grid(axis="y", alpha=0.25, lw=0.5)
        axes.set_xlabel(_label(_titled(measure), 5.0, 2))
        _add_legend(figure, *axes.get_legend_handles_labels())
        content = picture_bytes(figure, "svg", dpi=DPI)
    (low, first), (high, last) = means[0], means[-1]
    who = f"{len(means)} participant{'s' * (len(means) != 1)}"
    alt = f"Means of {_titled(measure)} of {who}: from {low:.3g} ({first}) to {high:.3g} ({last})."
    if measure.chance is not None:
        sides = [sum(test(mean, measure.chance) for mean, _ in means) for test in (np.greater, np.less)]
        alt += f" {sides[0]} are above chance, {measure.chance:g}, and {sides[1]} below."
    caption = (
        f"{_capital(_titled(measure))} of each participant, in the order of their means. A dot is one cell."
        f"{_omitted(lacking, 'participants without values')}"
    )
    return ReportPicture(bytes(content), alt, caption, _file(f"{measure.name}_participants"))


def draw_scale(measure: Measure) -> ReportPicture | None:
    """How often each point of a scale was given, a bar for each cell, centred on the middle of the scale."""
    if measure.low is None or measure.high is None:
        return None
    points = np.arange(round(measure.low), round(measure.high) + 1)
    columns = [own[np.isfinite(own)] for own in measure.values.T]
    cells = [(cell, own) for cell, own in zip(measure.cells, columns, strict=True) if len(own)]
    left_out = max(0, len(cells) - LEVELS_MOST)
    cells = cells[:LEVELS_MOST]
    if not cells or len(points) < 2:
        return None
    counts = np.array([[(np.rint(own) == point).sum() for point in points] for _, own in cells])
    share = 100.0 * counts / np.maximum(1, counts.sum(axis=1, keepdims=True))  # [%]
    # The middle lies between two points, or in the middle of one.
    start = -share[:, : len(points) // 2].sum(axis=1) - (share[:, len(points) // 2] / 2 if len(points) % 2 else 0.0)
    left = start[:, None] + np.cumsum(share, axis=1) - share
    with _figure(WIDTH * 0.85, 0.32 * len(cells) + 1.3) as figure:
        axes = figure.subplots()
        texts = [_label(cell_text(cell), 2.0) for cell, _ in cells]
        room = figure.get_figwidth() - 0.6 - max(text_width(text, FONT) for text in texts)
        inches = room / max(1.0, float((left + share).max() - left.min()))  # of one per cent
        rows = np.arange(len(cells))[::-1]  # the first cell at the top
        for k, (point, colour) in enumerate(zip(points, _diverging(len(points)), strict=True)):
            axes.barh(
                rows, share[:, k], left=left[:, k], height=0.72, color=colour, ec="white", lw=0.6, label=f"{point}"
            )
            dark = np.dot(colour, (0.299, 0.587, 0.114)) < 0.55
            for row, number, begin, width in zip(rows, counts[:, k], left[:, k], share[:, k], strict=True):
                if number and width * inches > text_width(f"{number}", FONT) + 0.04:
                    axes.text(
                        begin + width / 2, row, f"{number}", ha="center", va="center_baseline",
                        color="white" if dark else INK,
                    )  # fmt: skip
        axes.axvline(0.0, color=INK, lw=0.8, zorder=0.5)
        axes.set_xlim(left.min() - 2.0, (left + share).max() + 2.0)
        axes.set_yticks(rows, texts)
        axes.set_ylim(-0.6, len(cells) - 0.4)
        axes.xaxis.set_major_formatter(lambda value, _: f"{abs(value):g}")
        axes.set_xlabel("answers [%], to both sides of the scale's middle")
        handles, labels = axes.get_legend_handles_labels()
        _add_legend(figure, handles, labels, title=_label(_titled(measure), 6.0))
        content = picture_bytes(figure, "svg", dpi=DPI)
    means = "; ".join(f"{cell_text(cell)}: {_mean_words(own)}" for cell, own in cells)
    alt = f"Points from {points[0]} to {points[-1]} for {measure.title}, means by cell. {means}."
    rounded = " Means of several answers count as the nearest point." if np.any(measure.values % 1 > 0) else ""
    caption = (
        f"{_capital(measure.title)}: how many participants gave each point, {points[0]} at the left, in each cell."
        f"{rounded}{_omitted(left_out, 'cells')}"
    )
    return ReportPicture(bytes(content), alt, caption, _file(f"{measure.name}_scale"))


def draw_psychometric(fits: "Sequence[FittedLevels]", *, omitted: int = 0) -> ReportPicture | None:
    """Proportions by level with the curve that was fitted, its threshold and interval, a panel for each participant.

    omitted: participants that the caller has left out already.
    """
    shown = fits[:PANELS_MOST]
    levels = [own.answers.x for own in shown]
    if not shown or not sum(map(len, levels)):
        return None
    low, high = (float(function(np.concatenate(levels))) for function in (np.min, np.max))
    pad = 0.06 * (high - low) or 0.5
    most = max(int(own.answers.counts.max(initial=1)) for own in shown)
    with _figure(*_panels_size(len(shown))) as figure:
        from matplotlib.patches import Patch

        for (axes, width), own in zip(_panels(figure, len(shown)), shown, strict=True):
            answers, fit = own.answers, own.fit
            threshold = None if fit is None else fit.mu.value
            number = "" if threshold is None else f"{threshold:.3g}"
            code = _label(answers.code, max(0.3, 0.95 * width - text_width(f":  {number}", FONT)))
            axes.set_title(f"{code}: {number}" if number else code, fontsize=FONT)
            axes.set(xlim=(low - pad, high + pad), ylim=(-0.06, 1.06))
            if not len(answers.x):
                axes.text(
                    0.5, 0.5, _label(answers.reason or "no answers", 0.85 * width, 4), transform=axes.transAxes,
                    ha="center", va="center", color=FAINT,
                )  # fmt: skip
                continue
            if guess := _guess_line(own):
                axes.axhline(guess, color=INK, lw=0.7, ls=DASHES)
            if fit is not None and threshold is not None:
                if fit.mu.low is not None or fit.mu.high is not None:
                    ends = (
                        low - pad if fit.mu.low is None else fit.mu.low,
                        high + pad if fit.mu.high is None else fit.mu.high,
                    )
                    axes.axvspan(*np.clip(ends, low - pad, high + pad), color=COLOURS[1], alpha=0.25, lw=0)
                axes.axvline(threshold, color=COLOURS[1], lw=1.2)
                x = np.linspace(low - pad, high + pad, 201)
                axes.plot(x, fit.predict(x), color=COLOURS[0], lw=1.4)
            size = 6 + 40 * answers.counts / most  # area [pt2]
            axes.scatter(answers.x, answers.successes / np.maximum(1, answers.counts), size, color=INK, lw=0, zorder=3)
        figure.supxlabel("value of the stimulus", fontsize=FONT)
        figure.supylabel(
            _label(f"proportion of {shown[0].answers.counted}", figure.get_figheight() - 1.0, 2), fontsize=FONT
        )
        marks = [_mark("o", INK), _line(COLOURS[0]), (Patch(facecolor=COLOURS[1], alpha=0.25, lw=0), _line(COLOURS[1]))]
        texts = ["answers; area: how many", "fitted curve", "threshold, 95 % interval"]
        if any(map(_guess_line, shown)):
            marks.append(_line(INK, DASHES))
            texts.append("answers at random")
        _add_legend(figure, marks, texts, side="upper")
        content = picture_bytes(figure, "svg", dpi=DPI)
    block = shown[0].answers.block.name
    thresholds = [(own.answers.code, None if own.fit is None else own.fit.mu.value) for own in shown]
    texts = [f"{code}: {'no threshold' if value is None else f'{value:.3g}'}" for code, value in thresholds]
    caption = (
        f"Proportions of {shown[0].answers.counted} by the value of the stimulus, with the function that was fitted to "
        "each participant. Beside a participant's name stands the threshold."
    )
    caption += _omitted(omitted + len(fits) - len(shown), "participants")
    alt = f"Thresholds of block {block}, from {low:.3g} to {high:.3g} on its scale. {'; '.join(texts)}."
    return ReportPicture(bytes(content), alt, caption, _file(f"psychometric_{block}"))


def draw_staircases(found: "Sequence[LevelAnswers]") -> ReportPicture | None:
    """Levels of a staircase over its trials, by track, with the reversals marked, a panel for each participant."""
    shown = found[:PANELS_MOST]
    values = [level for own in shown for track in own.track_levels for level in track]
    if not values:
        return None
    low, high = min(values), max(values)
    pad = 0.08 * (high - low) or 0.5
    longest = max(len(track) for own in shown for track in own.track_levels)
    with _figure(*_panels_size(len(shown))) as figure:
        for (axes, width), own in zip(_panels(figure, len(shown)), shown, strict=True):
            axes.set_title(_label(own.code, 0.95 * width), fontsize=FONT)
            axes.set(xlim=(0.0, longest + 1), ylim=(low - pad, high + pad))
            for k, track in enumerate(own.track_levels):
                trials, levels = np.arange(1, len(track) + 1), np.array(track)
                look = {"color": COLOURS[k % len(COLOURS)], "marker": MARKS[k % len(MARKS)]}
                axes.plot(trials, levels, drawstyle="steps-mid", lw=0.9, ms=2.2, **look)
                moves = [(trial, np.sign(step)) for trial, step in enumerate(np.diff(levels)) if step]
                turns = [trial for (_, before), (trial, after) in pairwise(moves) if before != after]
                if len(turns) == own.block.reversals - 1 and len(levels) < own.block.trials_max:
                    turns.append(len(levels) - 1)  # its last answer turned it, and so ended it
                axes.plot(trials[turns], levels[turns], ls="", ms=5.5, mfc="none", mew=1.0, **look)
            if own.reversal_mean is not None:
                axes.axhline(own.reversal_mean, color=INK, lw=0.9, ls=DASHES)
        figure.supxlabel("trial of a track", fontsize=FONT)
        figure.supylabel("value of the stimulus", fontsize=FONT)
        marks = [_mark("o", COLOURS[0], size=2.5), _mark("o", "none", edge=COLOURS[0]), _line(INK, DASHES)]
        _add_legend(figure, marks, ["trial", "reversal", "mean of reversals that count"], side="upper")
        content = picture_bytes(figure, "svg", dpi=DPI)
    texts = [
        f"{own.code}: {'no reversals' if own.reversal_mean is None else f'{own.reversal_mean:.3g}'}" for own in shown
    ]
    block = shown[0].block.name
    alt = f"Means at the reversals of block {block}. {'; '.join(texts)}."
    caption = "Values of the stimulus over the trials of each track; circled: reversals; dashed: their mean."
    caption += _omitted(len(found) - len(shown), "participants")
    return ReportPicture(bytes(content), alt, caption, _file(f"staircase_{block}"))


def draw_magnitudes(scale: "MagnitudeScale") -> ReportPicture | None:
    """Geometric means of estimates over the stimuli's values, by participant and of all, both axes logarithmic."""
    x = scale.x
    if scale.reason or len(x) < 2 or x[0] <= 0 or not np.isfinite(scale.means).any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log10(scale.means)
    logs = np.where(np.isfinite(logs), logs, np.nan)
    has = np.isfinite(logs).any(axis=0)
    pooled = np.array([np.nanmean(own) for own in logs[:, has].T])
    exponents = scale.exponents[np.isfinite(scale.exponents)]
    with _figure(5.6, 4.2) as figure:
        from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

        axes = figure.subplots()
        for own in logs:
            axes.plot(x, 10.0**own, color=FAINT, lw=0.7, marker="o", ms=2.2, alpha=0.6)
        marks = [_line(FAINT, mark="o"), _mark("D", "white", edge=INK)]
        texts = ["a participant", "geometric mean of all"]
        if len(exponents):
            slope = float(exponents.mean())
            line = 10.0 ** (pooled.mean() + slope * (np.log10(x) - np.log10(x[has]).mean()))
            axes.plot(x, line, color=COLOURS[1], lw=1.6)
            marks.append(_line(COLOURS[1]))
            texts.append(f"mean exponent, {slope:.3g}")
        axes.plot(x[has], 10.0**pooled, ls="", marker="D", ms=6, mfc="white", mec=INK)
        axes.set_xscale("log")
        axes.set_yscale("log")
        shown = [float(x[0])]  # values of stimuli that have room for their numbers
        for value in x[1:]:
            if np.log(value / shown[-1]) > 0.12 * np.log(x[-1] / x[0]):
                shown.append(float(value))
        axes.set_xticks(shown, [f"{own:.4g}" for own in shown])
        decades = float(np.ptp(logs[np.isfinite(logs)]))
        steps = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if decades < 1.0 else (1.0, 2.0, 5.0) if decades < 3.0 else (1.0,)
        axes.yaxis.set_major_locator(LogLocator(subs=steps, numticks=12))
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set(xlabel="value of the stimulus", ylabel="estimate")
        axes.grid(alpha=0.2)
        _add_legend(figure, marks, texts)
        content = picture_bytes(figure, "svg", dpi=DPI)
    means = "; ".join(f"at {value:.3g}: {10.0**own:.3g}" for value, own in zip(x[has], pooled, strict=True))
    alt = f"Geometric means of estimates of {len(scale.codes)} participants in block {scale.block.name}. {means}."
    if len(exponents):
        alt += f" Exponents are {_mean_words(exponents)}."
    caption = "Estimates over the value of the stimulus: geometric means of each participant, and of all."
    return ReportPicture(bytes(content), alt, caption, _file(f"magnitudes_{scale.block.name}"))


@contextmanager
def _figure(width: float, height: float) -> Iterator[Any]:
    """A figure of this size [inch]; no warnings of letters that only the reader's fonts have."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph .* missing from")
        with drawing(width, height) as figure:
            yield figure


def _levels(measure: Measure, factor: str) -> Iterator[Level]:
    """Levels of a factor in the plan's order, also where there is one."""
    return iter(dict.fromkeys(own.factors[factor] for own in measure.cells if factor in own.factors))


def _group(measure: Measure, levels: Mapping[str, Level]) -> np.ndarray:
    """What there is in the cells at these levels."""
    cells = [
        k for k, own in enumerate(measure.cells) if all(own.factors.get(name) == at for name, at in levels.items())
    ]
    values = measure.values[:, cells].ravel()
    return values[np.isfinite(values)]


def _draw_group(axes: Any, place: float, width: float, values: np.ndarray, k: int, room: float) -> None:
    """A violin, dots and the mean of one group, or words where there is no value; room: how wide it may be [pt]."""
    if not len(values):
        middle = float(np.mean(axes.get_ylim()))
        axes.text(place, middle, "no data", rotation=90, ha="center", va="center", color=FAINT)
        return
    if len(values) >= VIOLIN_LEAST and np.ptp(values) > 1e-9 * np.abs(values).max():
        body = axes.violinplot(values, positions=[place], widths=0.92 * width, showextrema=False)["bodies"][0]
        body.set(facecolor=COLOURS[k], alpha=0.22, edgecolor="none")
    across = place + 0.6 * width * (np.modf(np.arange(1, len(values) + 1) * GOLDEN)[0] - 0.5)
    size = 3.4 if len(values) <= 60 else 2.2 if len(values) <= 300 else 1.4
    look = {"color": COLOURS[k], "marker": MARKS[k], "mec": "none"}
    axes.plot(across, np.sort(values), ls="", ms=size, alpha=0.7, **look)
    axes.plot(
        [place], [values.mean()], ls="", marker="D", ms=min(7.5, 0.55 * room), mfc="white", mec=INK, mew=1.3, zorder=4
    )


def _stacked(values: np.ndarray) -> Iterator[tuple[float, float]]:
    """Values, and how far below or above its row each dot stands: equal ones beside each other."""
    for value, count in zip(*np.unique(values, return_counts=True), strict=True):
        gap = min(0.16, 0.6 / count)
        for k in range(count):
            yield float(value), (k - (count - 1) / 2) * gap


def _limits(measure: Measure, values: np.ndarray) -> tuple[float, float]:
    """Ends of an axis: of the scale, of the values, and of chance."""
    known = [own for own in (measure.low, measure.high, measure.chance) if own is not None]
    low, high = (
        min(*known, values.min()) if known else values.min(),
        max(*known, values.max()) if known else values.max(),
    )
    pad = 0.05 * float(high - low) or 0.5
    return float(low) - pad, float(high) + pad


def _measure_marks(measure: Measure, colours: Sequence[str]) -> tuple[list[Any], list[str]]:
    marks = [_mark(MARKS[k], COLOURS[k]) for k in range(len(colours))]
    texts = [*(_label(text, 2.2) for text in colours), "mean"]
    marks.append(_mark("D", "white", edge=INK))
    if measure.chance is not None:
        marks.append(_line(INK, DASHES))
        texts.append(f"chance, {measure.chance:g}")
    return marks, texts


def _panels_size(count: int) -> tuple[float, float]:
    columns = _panel_columns(count)
    return max(4.2, min(WIDTH, 2.6 * columns + 0.6)), 1.75 * -(-count // columns) + 0.95


def _panel_columns(count: int) -> int:
    return count if count <= 4 else 4 if count <= 12 else 6


def _panels(figure: Any, count: int) -> Iterator[tuple[Any, float]]:
    """Axes of panels that share their scales, each with its width [inch]; the rest of the grid stays empty."""
    from matplotlib.ticker import MaxNLocator

    columns = _panel_columns(count)
    grid = figure.subplots(-(-count // columns), columns, sharex=True, sharey=True, squeeze=False).ravel()
    width = (figure.get_figwidth() - 0.8) / columns - 0.1
    grid[0].xaxis.set_major_locator(MaxNLocator(3 if width < 1.6 else 5, steps=[1, 2, 5, 10]))
    for number, axes in enumerate(grid):
        if number >= count:
            axes.set_axis_off()
            continue
        axes.tick_params(labelbottom=number + columns >= count)  # also above an empty place
        yield axes, width


def _guess_line(own: "FittedLevels") -> float:
    """The share of answers that count where nothing is felt; 0: none."""
    return 0.5 if own.answers.lapses_both_ways else own.answers.guess


def _diverging(count: int) -> list[tuple[float, float, float]]:
    """Colours from the scale's low end to its high one, purple to orange, with grey in the middle."""
    from matplotlib import colormaps

    colours = [colormaps["PuOr_r"](own)[:3] for own in np.linspace(0.08, 0.92, count)]
    if count % 2:
        colours[count // 2] = (0.87, 0.87, 0.87)
    return colours


def _mark(mark: str, colour: str, *, edge: str = "none", size: float = 5.5) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], ls="", marker=mark, ms=size, mfc=colour, mec=colour if edge == "none" else edge)


def _line(colour: str, dashes: Any = "-", *, mark: str = "") -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, lw=1.2, ls=dashes, marker=mark, ms=2.5)


def _add_legend(
    figure: Any,
    marks: Sequence[Any],
    texts: Sequence[str],
    *,
    side: Literal["lower", "upper"] = "lower",
    title: str = "",
) -> None:
    """A legend below or above the figure, in as many columns as there is room for."""
    room = figure.get_figwidth() / max(text_width(text, FONT) + 0.65 for text in texts)
    place = {"loc": f"outside {side} center", "ncols": max(1, min(len(texts), int(room))), "frameon": False}
    figure.legend(marks, texts, title=title or None, title_fontsize=FONT, **place)


def _label(text: str, width: float, lines: int = 1) -> str:
    """A text cut to its room [inch]."""
    from matplotlib.font_manager import findfont, get_font

    font = get_font(findfont("DejaVu Sans"))
    text = visible(" ".join(text.split()))
    # Letters that the font lacks come from the reader's, and are at most as wide as the font's size: Japanese, say.
    is_known = all(map(font.get_char_index, map(ord, text)))
    most = max(2, int(width * (LETTERS_MOST * lines if is_known else 72 / FONT)))
    if len(text) > most:  # measuring what is cut anyway takes time
        text = f"{text[: most // 2]}…{text[-(most - most // 2 - 1) :]}"
    return (fit_text(text, width, FONT, lines=lines) if is_known else text).replace("$", r"\$")


def _titled(measure: Measure) -> str:
    return f"{measure.title} [{measure.unit}]" if measure.unit else measure.title


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _mean_words(values: np.ndarray) -> str:
    if not len(values):
        return "no data"
    return f"mean {values.mean():.3g} of {len(values)} value{'s' * (len(values) != 1)}"


def _omitted(count: int, what: str) -> str:
    return f" {count} more {what} are left out." if count else ""


def _file(name: str) -> str:
    """The name of a picture's file: letters, digits, - and _; what is too long ends in a digest."""
    plain = re.sub(r"[^\w-]+", "_", name)
    plain = plain if len(plain) <= 60 else f"{plain[:48]}_{sha256(name.encode()).hexdigest()[:10]}"
    return f"{plain}.svg"
