"""A picture of what was rendered: contours on hand and object at distinct moments, their length and draw frequency."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...datasets.storage.schema import KIND_NAMES
from ...device.array import ArrayModel
from ..contour_batch import ContourBatch
from ..contour_input import takes_batches
from ..hands.hand import Palm
from ..hands.mesh_hand import MeshHand
from ..playback.placed_arrays import load_rig
from ..sampling.draw_frequency import file_frequencies
from ..sampling.strategy import DEFAULT, SamplingStrategy
from ..validation import require_path
from .opened_renderings import FILES_MOST, Renderings, files_of, opened, shown_poses
from .picture_page import EDGE, GAP, Entry, Page, fit_text, font_of, text_width, width_of
from .picture_style import COLOURS, DASHES, FAINT, HAND_DASHES, INK, LINES, paler, require_picture, save_figure, style
from .rendering_labels import hand_text
from .scene_drawing import (
    DISC,
    HAND_EDGE,
    HAND_FILL,
    WIDTH,
    SceneSource,
    SceneView,
    draw_overview,
    draw_scale,
    draw_scene,
    extent_of,
    is_near,
    letter,
    set_limits,
    varies,
)
from .scene_drawing import WIDTH as WIDTH_OF_LINES

TEXTS = {"object": "object's contour", "hand": "hand's boundary inside it", "made": "made by a stage"}
SCALE = (0.0, 0.25, 0.5, 0.75, 1.0)  # intensities that the legend shows


def legend_entries(
    sources: Sequence[SceneSource],
    batches: Sequence[ContourBatch],
    models: Sequence[ArrayModel] = (),
    shown: Sequence[ArrayModel] = (),
    *,
    overview: bool = False,
) -> list[Entry]:
    """The marks that scenes of these batches have, and their meanings.

    models: arrays that were asked for; shown: those that are near enough to be drawn. overview: whether there is one.
    """
    from matplotlib.colors import to_rgb
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    kinds = {int(k) for batch in batches for k in batch.kind.tolist()}
    named = {name: TEXTS[name] for k, name in enumerate(KIND_NAMES) if k in kinds}
    look = {name: {"color": COLOURS[name], "lw": WIDTH, "solid_capstyle": "butt"} for name in named}
    dashes = {"hand": (0, HAND_DASHES)}
    entries: list[Entry] = [
        (Line2D([], [], ls=dashes.get(name, "-"), dash_capstyle="round", **look[name]), text)
        for name, text in named.items()
    ]
    if any(varies(batch) for batch in batches):
        colour = COLOURS["made" if 2 in kinds else "object"]
        bar = [Line2D([], [], color=paler(colour, s), lw=2 * WIDTH, solid_capstyle="butt") for s in SCALE]
        entries.append((tuple(bar), "intensity 0 to 1: paler is weaker"))
    if any(batch.dwell is not None and (batch.dwell > 0).any() for batch in batches):
        entries.append((Line2D([], [], color=INK, marker="o", ls="", ms=4.5, mec="white"), "pause"))
    hands = [source.hand for source in sources]
    if any(not isinstance(hand, MeshHand) for hand in hands):
        entries.append(
            (Patch(fc=(*to_rgb(COLOURS["palm"]), 0.35), ec=COLOURS["palm"], lw=0.8), "skin that was rendered")
        )
    if any(isinstance(hand, Palm | MeshHand) for hand in hands):
        rendered = all(isinstance(hand, MeshHand) for hand in hands)
        text = "hand that was rendered" if rendered else "a hand, to show the pose"
        entries.append((Patch(fc=(*to_rgb(HAND_FILL), 0.5), ec=HAND_EDGE, lw=0.7), text))
    entries.append((Patch(fc="#c3cad4", ec="none"), "object"))
    for model in models:
        there = any(model is other for other in shown)
        text = f"{model.name}, {len(model.position)} transducers" if there else f"{model.name}: too far away to show"
        entries.append((Line2D([], [], marker="o", ls="", ms=4, mfc=DISC, mec="none"), text))
    if overview:
        moves = len(sources[0].pose) > 1
        text = "way of the palm, moments" if moves else "palm at the moment"
        way = {"color": FAINT, "lw": 0.5, "ls": "-" if moves else ""}
        entries.append((Line2D([], [], marker="o", ms=6, mfc="white", mec=INK, mew=0.7, **way), text))
    return entries


def line_look(k: int) -> dict[str, Any]:
    """Colour and dashes of file k's line over time."""
    return {"color": LINES[k % len(LINES)], "ls": DASHES[(k // len(LINES) + k) % len(DASHES)]}


def line_entries(labels: Sequence[str]) -> list[Entry]:
    """Whose the lines over time are; nothing for one file, whose name stands above."""
    from matplotlib.lines import Line2D

    return (
        [(Line2D([], [], lw=0.9, **line_look(k)), label) for k, label in enumerate(labels)] if len(labels) > 1 else []
    )


POINTS_MOST = 6000  # of a line over time: more than pixels, and few enough for an SVG
FREQUENCY_SHOWN = 1000.0  # [Hz]; contours of a few millimetres would stretch the axis a hundredfold
NARROW = 5.5  # [inch]; a narrower picture has setting and legend above its scenes, and diagrams below each other
OVERVIEW, OVERVIEW_NARROW, OVERVIEW_MOST = 0.22, 0.4, 3.2  # shares of the width, and most height [inch]
SCENE_MOST, SCENE_LEAST, SCENE_WIDTH = 2.7, 0.9, 0.95  # [inch] heights of a scene, and its least width
SCENE_USUAL = 2.0  # [inch] of a scene whose contours are as thick as usual; narrower ones have thinner ones
PLOT = 1.1  # [inch] height of a diagram
LABEL_LINES, NOTE_LINES = 2, 4
FOOT = 0.09  # of a scene's height, below it, for the scale bar


@takes_batches
def draw_figure(
    paths: Mapping[str, str | Path] | Sequence[str | Path],
    picture: str | Path,
    *,
    sampling: SamplingStrategy | None = None,
    times: Sequence[float] | None = None,
    view: str | Sequence[float] = "iso",
    array: str | None = "emulator",
    width: float | str | None = None,
    font_size: float | None = None,
    overwrite: bool = False,
) -> None:
    """Draw one picture of renderings of the same object and motion into a PNG, SVG or PDF.

    paths: by label; a list of them gets labels that distinguish them (strategy, its options, hand, file). Each file has
    a row of scenes, or one scene if one moment is shown; all have one scale. times: moments to show [s], or numbers of
    poses where the files have no times; None: up to three distinct ones. view: iso, front, back, side, top, palm, or
    elevation and azimuth [degree]. array: what stands below, as for `load_rig`; None: nothing. width: [m], 0.06 to 0.6,
    or single, double (Nature's columns), ieee-single, ieee-double. font_size: of all texts [pt].

    Raises StrategyError for another kind of picture, for one that is there unless `overwrite`, for files of different
    objects or motions, times outside the motion or without any contour, an unknown view, and sizes out of range;
    DeviceError for an unknown array; ContourFileError where a file cannot be read, a pose is not done yet, or the
    picture not be written.

    >>> from pathlib import Path
    >>> from palpate.render import draw_figure, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> draw_figure({"closed": path}, "cube.png", view="palm", width="single", overwrite=True)
    >>> [picture.name for picture in Path().glob("*.png")]
    ['cube.png']
    """
    picture = require_path(picture, "the picture")
    require_picture(picture, overwrite=overwrite, sources=files_of(paths))
    figure = contour_figure(
        paths, sampling=sampling, times=times, view=view, array=array, width=width, font_size=font_size
    )
    save_figure(figure, picture, in_print=width is not None)


@takes_batches
def contour_figure(
    paths: Mapping[str, str | Path] | Sequence[str | Path],
    *,
    sampling: SamplingStrategy | None = None,
    times: Sequence[float] | None = None,
    view: str | Sequence[float] = "iso",
    array: str | None = "emulator",
    width: float | str | None = None,
    font_size: float | None = None,
    notes: Sequence[str] = (),
    files_most: int = FILES_MOST,
) -> Any:
    """The picture that `draw_figure` writes, as a matplotlib figure.

    notes: what stands under the label of each file, whose scenes then show what is rendered and not the whole hand.
    """
    import matplotlib as mpl  # 0.7 s that only pictures cost

    eye, page = SceneView.of(view), Page(width_of(width), font_of(font_size))
    models = [] if array is None else [placed.model for placed in load_rig(array)]
    with ExitStack() as stack, mpl.rc_context(style(page.font)):
        renderings = opened(paths, stack, files_most)
        poses, sources = shown_poses(renderings, times, eye), renderings.sources
        near = [model for model in models if is_near(model, sources[0])]
        moves = len(sources[0].pose) > 1
        batches = [source.batch(int(i)) for source in sources for i in poses]
        entries = legend_entries(sources, batches, models, near, overview=moves or bool(models))
        extents = np.array([[extent_of(source, int(i), eye, hand=not notes) for i in poses] for source in sources])
        extents[..., 0, 1] -= FOOT * np.ptp(extents[..., 1], axis=2)  # for the scale bar
        half = 1.03 * np.ptp(extents, axis=2).reshape(-1, 2).max(axis=0) / 2
        parts = lay_out(page, renderings, poses, half, entries, overview=moves or bool(models), notes=notes)
        if parts.overview is not None:
            draw_overview(parts.overview, sources[0], poses, eye, near)
            draw_scale(parts.overview, SceneView(eye.elevation, eye.azimuth).basis() if eye.follows_palm else None)
        line = WIDTH_OF_LINES * float(np.clip(parts.scene_width / SCENE_USUAL, 0.55, 1.0))
        middles = extents.mean(axis=2).reshape(-1, 2)
        for k, axes in enumerate(parts.scenes):
            set_limits(axes, middles[k], parts.half)
            draw_scene(axes, sources[k // len(poses)], int(poses[k % len(poses)]), eye, line_width=line)
        draw_scale(parts.scenes[0], None if eye.follows_palm else eye.basis())  # all scenes have this scale
        draw_plots(parts.plots, renderings, poses, sampling or DEFAULT)
        return page.figure


class FigureParts(NamedTuple):
    """Axes of a picture."""

    overview: Any
    """None where there is none."""
    scenes: list[Any]
    """Those of the first file, then of the next."""
    plots: list[Any]
    scene_width: float
    """[inch]"""
    half: np.ndarray
    """What scenes show to each side of their middles [mm]: at least what was asked for, as wide as they are."""


def lay_out(
    page: Page,
    renderings: Renderings,
    poses: Sequence[int] | np.ndarray,
    half: np.ndarray,
    entries: Sequence[Entry],
    *,
    overview: bool,
    notes: Sequence[str] = (),
) -> FigureParts:
    """Place the parts of a picture on a page, with titles and legends.

    half: what scenes show to each side [mm].
    """
    source, files = renderings.sources[0], len(renderings.sources)
    narrow, single = page.width < NARROW, len(poses) == 1 and files > 1
    moments = [f"{letter(k)}   {renderings.moments.text(int(index))}" for k, index in enumerate(poses)]
    words = ", ".join([hand_text(source.file.hand), *([] if single or files > 1 else renderings.labels)])
    top = EDGE + page.text(str(source.solid["name"]), EDGE, EDGE, page.inner, lines=2, fontweight="bold", color=INK)
    top += page.text(words, EDGE, top, page.inner, lines=2, color=INK)
    if single and len(source.pose) > 1:
        top += page.text(moments[0], EDGE, top, page.inner, color=INK)
    top += 0.3 * page.line
    left, setting, wide = EDGE, None, OVERVIEW_NARROW * page.inner
    beside = overview and narrow and page.legend_width(entries) <= page.inner - wide - GAP  # is the legend
    if overview and narrow:
        high = max(1.15 * wide, page.legend(entries if beside else [], EDGE + wide + GAP, top, page.inner - wide - GAP))
        setting = page.axes(EDGE, top, wide, high)
        top += high + 0.5 * page.line
    elif overview:
        left += OVERVIEW * page.inner + GAP
    labels = 0.0 if single or files == 1 else LABEL_LINES * page.line  # width
    titles = renderings.labels if single else moments
    first, scenes, run = top, [], files if single else len(poses)
    room = page.width - EDGE - left - labels
    least = max([SCENE_WIDTH] + [text_width(title, page.font) for title in titles if not single])
    columns = -(-run // -(-run // max(1, int((room + GAP) / (least + GAP)))))  # rows as equal as can be
    wide = (room - GAP * (columns - 1)) / columns
    tall = float(np.clip(wide * half[1] / half[0], SCENE_LEAST, SCENE_MOST))
    for f in range(1 if single else files):
        for row in (range(a, min(a + columns, run)) for a in range(0, run, columns)):
            lefts = [left + labels + (k - row[0]) * (wide + GAP) for k in row]
            look = {"color": INK, "fontweight": "bold" if single else "normal"}
            if f == 0 or columns < run:  # files below the first have its moments, if these fill one row
                top += page.row([titles[k] for k in row], lefts, top, wide, lines=LABEL_LINES, **look)
            if notes:
                top += page.row([notes[k] for k in row], lefts, top, wide, lines=NOTE_LINES, color=FAINT)
            scenes += [page.axes(x, top, wide, tall) for x in lefts]
            if labels and row[0] == 0:
                text = fit_text(renderings.labels[f], tall, page.font, lines=LABEL_LINES, bold=True)
                where = {"x": -GAP / 3 / wide, "y": 0.5, "ha": "right", "va": "center", "ma": "center", "rotation": 90}
                look = {"transform": scenes[-len(row)].transAxes, "fontweight": "bold", "parse_math": False}
                scenes[-len(row)].text(s=text, linespacing=1.1, color=INK, **where, **look)
            top += tall + GAP
    if overview and not narrow:
        high = max(min(top - GAP - first, OVERVIEW_MOST), 0.5 * left)
        setting = page.axes(EDGE, first, OVERVIEW * page.inner, high)
        top = max(top, first + high + GAP)
    if not beside:
        top += page.legend(entries, EDGE, top, page.inner)
    top, diagrams = _place_plots(page, renderings, top, narrow) if len(source.pose) > 1 else (top, [])
    page.finish(top + EDGE)
    shown = np.maximum(half, half[::-1] * [wide / tall, tall / wide])
    return FigureParts(setting, scenes, diagrams, wide, shown)


def _place_plots(page: Page, renderings: Renderings, top: float, narrow: bool) -> tuple[float, list[Any]]:
    """Place two diagrams and their legend from `top` on; returns where they end, and their axes."""
    top += 0.4 * page.line + page.legend(line_entries(renderings.labels), EDGE, top + 0.4 * page.line, page.inner)
    ticks = 5 * 0.64 * page.font / 72 + 0.08  # five digits beside a diagram
    foot = 2 * page.line + 0.12  # numbers and the name of an axis
    across = 1 if narrow else 2
    wide = page.inner / across - ticks - (0.15 if across > 1 else 0.05)
    plots = []
    for k in range(2):
        left = EDGE + ticks + (k % across) * page.inner / across
        low = top + 1.2 * page.line + (k // across) * (1.2 * page.line + PLOT + foot)
        plots.append(page.axes(left, low, wide, PLOT))
    return top + 2 // across * (1.2 * page.line + PLOT + foot), plots


def draw_plots(
    plots: Sequence[Any], renderings: Renderings, poses: Sequence[int] | np.ndarray, sampling: SamplingStrategy
) -> None:
    """Length and draw frequency over time, with the moments that are shown."""
    if not plots:
        return
    lengths, frequencies = plots
    across = renderings.across
    for k, (length, source) in enumerate(zip(renderings.lengths, renderings.sources, strict=True)):
        look = {"lw": 0.9, **line_look(k), "label": renderings.labels[k]}
        if len(length) < 3:
            look |= {"marker": "o", "ms": 3.5}
        rows = shown_rows(length)
        lengths.plot(across[rows], 1e3 * length[rows], **look)
        frequencies.plot(across[rows], file_frequencies(source.file, rows, sampling), **look)
    titles = ("length of the contours [mm]", f"draw frequency at {sampling.speed:g} m/s [Hz]")
    for axes, title in zip(plots, titles, strict=True):
        font = axes.xaxis.label.get_size()
        wide = axes.get_window_extent().width / axes.figure.dpi
        axes.set_title(fit_text(title, wide, font), loc="left", pad=3)
        axes.set_xlabel("pose" if renderings.moments.time is None else "time [s]", labelpad=1)
        beyond = 0.01 * float(across[-1] - across[0]) or 0.5
        axes.set_xlim(float(across[0]) - beyond, float(across[-1]) + beyond)
        for index in poses:
            axes.axvline(across[index], color=FAINT, lw=0.6, ls=(0, (2, 2)), zorder=0)
    lengths.set_ylim(bottom=0.0)
    where = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    for k, index in enumerate(poses):
        lengths.annotate(letter(k), (across[index], 1.0), (1.5, -1), va="top", **where)
    frequencies.set_yscale("log")
    low, high = frequencies.get_ylim()
    frequencies.set_ylim(min(low, 10.0), min(max(high, 100.0), FREQUENCY_SHOWN))


def shown_rows(length: np.ndarray, most: int = POINTS_MOST) -> np.ndarray:
    """The poses that a line over time has: all, or of many the shortest and the longest of equal ranges; in order."""
    if len(length) <= most:
        return np.arange(len(length))
    known = np.isfinite(length)
    starts = np.linspace(0, len(length), most // 2 + 1).astype(int)
    ranges = [slice(a, b) for a, b in pairwise(starts.tolist())]
    low = [part.start + np.argmin(np.where(known[part], length[part], np.inf)) for part in ranges]
    high = [part.start + np.argmax(np.where(known[part], length[part], -np.inf)) for part in ranges]
    return np.unique([*low, *high])
