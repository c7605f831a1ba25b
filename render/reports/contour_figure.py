"""A picture of what was rendered: contours on hand and object at distinct moments, their length and draw frequency."""

import textwrap
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...device.array import ArrayModel
from ..contour_input import takes_batches
from ..playback.placed_arrays import load_rig
from ..sampling.draw_frequency import file_frequencies
from ..sampling.strategy import SamplingStrategy
from ..validation import require_path
from .array_overview import draw_overview, is_near, letter
from .contour_lines import WIDTH as WIDTH_OF_LINES
from .figure_legend import legend_handles
from .opened_renderings import Renderings, files_of, opened, shown_poses
from .picture_style import DASHES, FAINT, INK, LINES, picture_bytes, require_picture, style, write_picture
from .rendering_labels import hand_text, short_text
from .scene_drawing import draw_scale, draw_scene, extent_of, set_limits
from .scene_view import SceneView

POINTS_MOST = 6000  # of a line over time: more than pixels, and few enough for an SVG
FREQUENCY_SHOWN = 1000.0  # [Hz]; contours of a few millimetres would stretch the axis a hundredfold
ROW_LABEL = 24  # characters of a line of a row's label
BESIDE_TITLE = 36  # characters of all files' names that fit beside a diagram's title
WIDTH = 9.6  # [inch]
EDGE, OVERVIEW, GAP = 0.12, 2.1, 0.1  # [inch] margin, width of the overview, between scenes
HEADING, OVERVIEW_MOST = 0.12, 3.2  # [inch] between its title and it, its height
SCENE_MOST, SCENE_LEAST = 2.7, 1.5  # [inch] height of a scene
TITLE, LEGEND_ROW, PLOT, PLOT_TITLE, PLOT_FOOT = 0.32, 0.2, 1.15, 0.3, 0.42  # [inch]
LEGEND_COLUMNS = 4
WIDE = 2.0  # [inch] of a scene whose contours are as thick as usual; narrower ones have thinner ones
HEAD_MOST = 34  # characters over the overview
FOOT = 0.09  # of a scene's height, below it, for the scale bar
DPI = 150


@takes_batches
def draw_figure(
    paths: Mapping[str, str | Path] | Sequence[str | Path],
    picture: str | Path,
    *,
    sampling: SamplingStrategy | None = None,
    times: Sequence[float] | None = None,
    view: str | Sequence[float] = "iso",
    array: str | None = "emulator",
    overwrite: bool = False,
) -> None:
    """Draw one picture of renderings of the same object and motion into a PNG, SVG or PDF.

    paths: by label; a list of them gets labels that distinguish them (strategy, its options, hand, file). Each file has
    a row of scenes, all at one scale. times: moments to show [s], or numbers of poses where the files have no times;
    None: up to three distinct ones. view: iso, front, back, side, top, palm, or elevation and azimuth [degree]. array:
    what stands below, as for `load_rig`; None: nothing.

    Raises StrategyError for another kind of picture, for one that is there unless `overwrite`, for files of different
    objects or motions, times outside the motion or without any contour, and an unknown view; DeviceError for an unknown
    array; ContourFileError where a file cannot be read, a pose is not done yet, or the picture not be written.

    >>> from pathlib import Path
    >>> from palpate.render import draw_figure, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "cc").save("cube.h5", overwrite=True)
    >>> draw_figure({"closed": path}, "cube.png", view="palm", overwrite=True)
    >>> [picture.name for picture in Path().glob("*.png")]
    ['cube.png']
    """
    picture = require_path(picture, "the picture")
    require_picture(picture, overwrite=overwrite, sources=files_of(paths))
    figure = contour_figure(paths, sampling=sampling, times=times, view=view, array=array)
    write_picture(picture_bytes(figure, picture.suffix.lower().removeprefix("."), dpi=DPI), picture)


@takes_batches
def contour_figure(
    paths: Mapping[str, str | Path] | Sequence[str | Path],
    *,
    sampling: SamplingStrategy | None = None,
    times: Sequence[float] | None = None,
    view: str | Sequence[float] = "iso",
    array: str | None = "emulator",
) -> Any:
    """The picture that `draw_figure` writes, as a matplotlib figure."""
    import matplotlib as mpl  # 0.7 s that only pictures cost

    eye, models = SceneView.of(view), models_of(array)
    with ExitStack() as stack, mpl.rc_context(style()):
        renderings = opened(paths, stack)
        poses = shown_poses(renderings, times, eye)
        return _draw(renderings, poses, eye, models, sampling or SamplingStrategy())


def models_of(array: str | None) -> list[ArrayModel]:
    """The arrays by name or from a file; none for None."""
    return [] if array is None else [placed.model for placed in load_rig(array)]


@dataclass(frozen=True)
class SceneLayout:
    """Where the parts of a picture are [inch], and what its scenes show [mm]."""

    rows: int
    columns: int
    extents: np.ndarray
    """Lowest and highest places of what each scene shows [mm], shape [row, column, 2, 2]."""
    legend_entries: int

    @property
    def left(self) -> float:
        """Left side of the first scene."""
        return EDGE + OVERVIEW + GAP + (0.15 if self.rows > 1 else 0.0)

    @property
    def scene(self) -> tuple[float, float]:
        """Width and height of a scene."""
        width = (WIDTH - self.left - EDGE - GAP * (self.columns - 1)) / self.columns
        half = _limits(self.extents)[1]
        return width, float(np.clip(width * half[1] / half[0], SCENE_LEAST, SCENE_MOST))

    @property
    def foot(self) -> float:
        """Where the scenes end, from the top."""
        return TITLE + self.rows * self.scene[1] + (self.rows - 1) * GAP

    @property
    def plots(self) -> float:
        """Where the diagrams begin, from the top."""
        return self.foot + -(-self.legend_entries // LEGEND_COLUMNS) * LEGEND_ROW + 0.1 + PLOT_TITLE

    @property
    def height(self) -> float:
        """Of the picture."""
        return self.plots + PLOT + PLOT_FOOT

    def place(self, left: float, top: float, width: float, height: float) -> tuple[float, float, float, float]:
        """A rectangle as matplotlib takes it."""
        return left / WIDTH, 1 - (top + height) / self.height, width / WIDTH, height / self.height

    def scene_place(self, row: int, column: int) -> tuple[float, float, float, float]:
        """A scene's rectangle."""
        width, height = self.scene
        return self.place(self.left + column * (width + GAP), TITLE + row * (height + GAP), width, height)


def _draw(
    renderings: Renderings, poses: np.ndarray, view: SceneView, models: list[ArrayModel], sampling: SamplingStrategy
) -> Any:
    from matplotlib.figure import Figure

    sources = renderings.sources
    shown = [model for model in models if is_near(model, sources[0])]
    handles = legend_handles(sources, [source.batch(int(i)) for source in sources for i in poses], models, shown)
    extents = np.array([[extent_of(source, int(i), view) for i in poses] for source in sources])
    layout = SceneLayout(len(sources), len(poses), extents, len(handles))
    figure = Figure(figsize=(WIDTH, layout.height))
    _draw_setting(figure, layout, renderings, poses, view, shown)
    _draw_scenes(figure, layout, renderings, poses, view)
    figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 1 - (layout.foot + 0.05) / layout.height),
        ncols=LEGEND_COLUMNS, frameon=False, fontsize=7.5, handlelength=2.2, columnspacing=1.6, borderaxespad=0,
        labelspacing=0.35,
    )  # fmt: skip
    wide = (WIDTH - 2 * EDGE - 1.1) / 2
    places = [layout.place(EDGE + 0.4 + k * (wide + 0.6), layout.plots, wide, PLOT) for k in range(2)]
    _draw_plots([figure.add_axes(place) for place in places], renderings, poses, sampling)
    return figure


def _draw_setting(
    figure: Any, layout: SceneLayout, renderings: Renderings, poses: np.ndarray, view: SceneView, models: list
) -> None:
    """The overview, with what the picture is of over it."""
    source = renderings.sources[0]
    high = min(layout.foot - TITLE - HEADING, OVERVIEW_MOST)
    axes = figure.add_axes(layout.place(EDGE, TITLE + HEADING, OVERVIEW, high))
    draw_overview(axes, source, poses, view, models, OVERVIEW / high)
    draw_scale(axes, SceneView(view.elevation, view.azimuth).basis() if view.follows_palm else None)
    words = ", ".join([hand_text(source.file.hand), *(renderings.labels if layout.rows == 1 else [])])
    for text, down, weight in ((str(source.solid["name"]), 0.2, "bold"), (words, 0.34, "normal")):
        shown = short_text(text, HEAD_MOST)
        figure.text(EDGE / WIDTH, 1 - down / layout.height, shown, fontsize=8, fontweight=weight, parse_math=False)


def _draw_scenes(figure: Any, layout: SceneLayout, renderings: Renderings, poses: np.ndarray, view: SceneView) -> None:
    """A row of scenes for each file."""
    (middle, half), (width, height) = _limits(layout.extents), layout.scene
    line_width = WIDTH_OF_LINES * min(1.0, max(width / WIDE, 0.55))
    for r, source in enumerate(renderings.sources):
        for c, index in enumerate(poses.tolist()):
            axes = figure.add_axes(layout.scene_place(r, c))
            # Half extents that hold those of the contours and are as wide as the scene is, compared with its height.
            fitted = [max(half[0], half[1] * (width / height)), max(half[1], half[0] / (width / height))]
            set_limits(axes, middle[r, c], np.array(fitted))
            draw_scene(axes, source, index, view, line_width=line_width)
            if r == 0:
                axes.set_title(f"{letter(c)}   {renderings.moments.text(index)}", fontsize=8, loc="left", pad=4)
            if r == 0 and c == 0:  # all scenes have this scale
                draw_scale(axes, None if view.follows_palm else view.basis())
            if c == 0 and layout.rows > 1:
                look = {"rotation": 90, "fontsize": 8, "fontweight": "bold", "color": INK, "parse_math": False}
                text = textwrap.fill(renderings.labels[r], ROW_LABEL)  # no longer than the scene is high
                axes.text(-0.02, 0.5, text, transform=axes.transAxes, ha="right", va="center", ma="center", **look)


def _limits(extents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the scenes [mm], shape [row, column, 2], and what all of them show to each side of it [mm].

    extents: lowest and highest places, shape [row, column, 2, 2].
    """
    foot = FOOT * np.ptp(extents[..., 1], axis=2)[..., None, None] * [[0.0, 1.0], [0.0, 0.0]]  # for the scale bar
    held = extents - foot
    return held.mean(axis=2), 1.03 * np.ptp(held, axis=2).reshape(-1, 2).max(axis=0) / 2


def _draw_plots(plots: list[Any], renderings: Renderings, poses: np.ndarray, sampling: SamplingStrategy) -> None:
    """Length and draw frequency over time, with the moments that are shown."""
    length_axes, frequency_axes = plots
    across = renderings.across
    drawn = zip(renderings.labels, renderings.lengths, renderings.sources, strict=True)
    for k, (label, length, source) in enumerate(drawn):
        look = {"lw": 0.9, "color": LINES[k % len(LINES)], "ls": DASHES[(k // len(LINES) + k) % len(DASHES)]}
        if len(length) < 3:
            look |= {"marker": "o", "ms": 3.5}
        rows = shown_rows(length)
        length_axes.plot(across[rows], 1e3 * length[rows], label=label, **look)
        frequency_axes.plot(across[rows], file_frequencies(source.file, rows, sampling), **look)
    frequency_axes.set_yscale("log")
    low, high = frequency_axes.get_ylim()
    frequency_axes.set_ylim(min(low, 10.0), min(max(high, 100.0), FREQUENCY_SHOWN))
    length_axes.set_ylim(bottom=0.0)
    length_axes.set_title("length of the contours [mm]", fontsize=8, loc="left")
    frequency_axes.set_title(f"draw frequency at {sampling.speed:g} m/s [Hz]", fontsize=8, loc="left")
    for axes in plots:
        axes.set_xlabel("pose" if renderings.moments.time is None else "time [s]", labelpad=1)
        beyond = 0.01 * float(across[-1] - across[0]) or 0.5
        axes.set_xlim(float(across[0]) - beyond, float(across[-1]) + beyond)
        for index in poses:
            axes.axvline(across[index], color=FAINT, lw=0.6, ls=(0, (2, 2)), zorder=0)
    where = {"xycoords": ("data", "axes fraction"), "textcoords": "offset points"}
    for k, index in enumerate(poses):
        length_axes.annotate(letter(k), (across[index], 1.0), (1.5, -1), fontsize=7, va="top", **where)
    if len(renderings.labels) > 1:
        _draw_line_legend(frequency_axes, *length_axes.get_legend_handles_labels())


def _draw_line_legend(axes: Any, handles: list[Any], labels: list[str]) -> None:
    """What the lines over time are of: beside a diagram's title, or above it where names are long."""
    is_long = sum(map(len, labels)) > BESIDE_TITLE
    legend = axes.legend(
        handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.12 if is_long else 1.0), frameon=False,
        ncols=min(2 if is_long else 4, len(labels)), fontsize=7.5, handlelength=2.6, columnspacing=1.2,
        borderaxespad=0.1,
    )  # fmt: skip
    for text in legend.get_texts():
        text.set_parse_math(False)  # names of files are no formulas; the ticks of the logarithmic axis are


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
