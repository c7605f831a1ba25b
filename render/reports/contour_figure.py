"""A picture of what was rendered: contours on hand and object at distinct moments, their length and draw frequency."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.contour_file.reader import ContourFile
from ...datasets.rigid import rotate
from ...device.array import ArrayModel
from ..contour_batch import ContourBatch
from ..errors import StrategyError
from ..playback.placed_arrays import load_rig
from ..sampling.contour_sampling import SamplingStrategy
from ..user_warnings import warn_user
from ..validation import require_path, value_text
from .array_overview import draw_overview, is_near, letter
from .figure_legend import legend_handles
from .picture_style import DASHES, FAINT, INK, LINES, SUFFIXES, picture_bytes, require_picture, style, write_picture
from .rendering_labels import hand_text, labels_of, short_text
from .scene_drawing import SceneSource, draw_scale, draw_scene, extent_of, set_limits
from .scene_view import SceneView
from .shown_moments import MotionMoments, distinct_poses, poses_at

__all__ = ["SUFFIXES", "contour_figure", "draw_figure", "opened"]

POSES_SHOWN = 3
FILES_MOST = 8
POINTS_MOST = 6000  # of a line over time: more than pixels, and few enough for an SVG
FREQUENCY_SHOWN = 1000.0  # [Hz]; contours of a few millimetres would stretch the axis a hundredfold
WIDTH = 9.6  # [inch]
EDGE, OVERVIEW, GAP = 0.12, 2.1, 0.1  # [inch] margin, width of the overview, between scenes
HEADING, OVERVIEW_MOST = 0.12, 3.2  # [inch] between its title and it, its height
SCENE_MOST, SCENE_LEAST = 2.7, 1.5  # [inch] height of a scene
TITLE, LEGEND_ROW, PLOT, PLOT_TITLE, PLOT_FOOT = 0.32, 0.2, 1.15, 0.3, 0.42  # [inch]
LEGEND_COLUMNS = 4
HEAD_MOST = 34  # characters over the overview
FOOT = 0.09  # of a scene's height, below it, for the scale bar
DPI = 150


@dataclass(frozen=True)
class Renderings:
    """Open files of one object and motion, and what a picture of them needs."""

    labels: list[str]
    sources: list[SceneSource]
    lengths: list[np.ndarray]
    """Of each file, of each pose's contours [m]; NaN where a pose is not done yet."""
    moments: MotionMoments

    @property
    def across(self) -> np.ndarray:
        """Times [s], or numbers of poses."""
        return np.arange(len(self.moments.pose)) if self.moments.time is None else self.moments.time


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
    require_picture(picture, overwrite=overwrite)
    figure = contour_figure(paths, sampling=sampling, times=times, view=view, array=array)
    write_picture(picture_bytes(figure, picture.suffix.lower().removeprefix("."), dpi=DPI), picture)


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


def opened(paths: Mapping[str, str | Path] | Sequence[str | Path], stack: ExitStack) -> Renderings:
    """Open files, which `stack` closes; raises StrategyError for none, too many, and files that do not fit together."""
    if isinstance(paths, str | Path) or not paths:
        raise StrategyError(f"files must be given by label, as in {{'closed': 'tube.h5'}}, not {value_text(paths)}")
    files = [
        stack.enter_context(ContourFile(path)) for path in (paths.values() if isinstance(paths, Mapping) else paths)
    ]
    if len(files) > FILES_MOST:
        raise StrategyError(f"a picture shows up to {FILES_MOST} files, not {len(files)}: draw several pictures")
    _refuse_unlike(files)
    labels = [short_text(str(label)) for label in paths] if isinstance(paths, Mapping) else labels_of(files)
    for file in files:
        if not file.done:
            raise StrategyError(f"{file.path}: no pose is done yet; palpate render --resume goes on")
    motion = files[0].motion()
    moments = MotionMoments(motion["pose"], motion.get("time"))
    return Renderings(labels, [SceneSource.of(file) for file in files], [_lengths(file) for file in files], moments)


def _refuse_unlike(files: list[ContourFile]) -> None:
    """Refuse files whose lengths cannot stand in one diagram."""
    first = files[0]
    for file in files:
        for field in ("object", "representation", "motion", "object motion"):  # some files have only two of them
            if file.recipe.get(field) != first.recipe.get(field):
                raise StrategyError(
                    f"{file.path} is of another {field} than {first.path}: they do not belong in one picture"
                )


def _lengths(file: ContourFile) -> np.ndarray:
    length = np.full(file.pose_count, np.nan)
    for first, stop in file.done:
        length[first:stop] = file.metrics(first, stop)["length"]
    return length


def shown_poses(renderings: Renderings, times: Sequence[float] | None, view: SceneView) -> np.ndarray:
    """Poses at the times that are asked for, or distinct ones; in order.

    Raises StrategyError where none of the times asked for has a contour, or a pose is not done yet; warns of one time
    without contour.
    """
    moments, lengths = renderings.moments, np.array(renderings.lengths)
    if times is None:
        return distinct_poses(_worth(lengths, moments.pose, view), moments, _contours_of(renderings), POSES_SHOWN)
    name = str(renderings.sources[0].file.path)
    poses = poses_at(times, moments, name)
    for source, length in zip(renderings.sources, lengths, strict=True):
        if len(missing := poses[np.isnan(length[poses])]):
            raise StrategyError(
                f"{source.file.path}: {moments.text(int(missing[0]))} is not done yet; palpate render --resume goes on"
            )
    longest = np.nan_to_num(lengths).max(axis=0)
    bare = poses[longest[poses] == 0]
    if len(bare):
        listed = ", ".join(map(moments.text, bare.tolist()))
        sentence = f"{name}: {listed}: no contour there; {_nearest(longest, moments, bare)}"
        if len(bare) == len(poses):
            raise StrategyError(sentence)
        warn_user(sentence)
    return poses


def _nearest(longest: np.ndarray, moments: MotionMoments, bare: np.ndarray) -> str:
    drawn = np.flatnonzero(longest > 0)
    if not len(drawn):
        return "the hand never meets the object"
    near = drawn[np.argmin(np.abs(drawn - bare[0]))]
    return f"the nearest one is at {moments.text(int(near))}"


def _worth(lengths: np.ndarray, pose: np.ndarray, view: SceneView) -> np.ndarray:
    """How worth it is to show each pose: contours as long as possible in every file, seen as squarely as possible."""
    share = np.nan_to_num(lengths) / np.maximum(np.nan_to_num(lengths).max(axis=1, keepdims=True), 1e-12)
    in_all = share.min(axis=0)
    worth = in_all if in_all.any() else share.sum(axis=0)
    return worth * view.facing(rotate(pose[:, 3:].astype(np.float64), np.array([0.0, 1.0, 0.0])))


def _contours_of(renderings: Renderings) -> Any:
    """A function that gives the points of a pose's contours in the first file that has some."""

    def points(index: int) -> np.ndarray:
        for source, length in zip(renderings.sources, renderings.lengths, strict=True):
            if length[index] > 0:  # a NaN compares false
                return source.batch(index).points
        return np.zeros((0, 3))

    return points


def _draw(
    renderings: Renderings, poses: np.ndarray, view: SceneView, models: list[ArrayModel], sampling: SamplingStrategy
) -> Any:
    from matplotlib.figure import Figure

    rows, columns = len(renderings.sources), len(poses)
    shown = [model for model in models if is_near(model, renderings.sources[0])]
    left = EDGE + OVERVIEW + GAP + (0.15 if rows > 1 else 0.0)
    width = (WIDTH - left - EDGE - GAP * (columns - 1)) / columns
    extents = [[extent_of(source, int(i), view) for i in poses] for source in renderings.sources]
    middle, half = _limits(np.array(extents))
    tall = float(np.clip(width * half[1] / half[0], SCENE_LEAST, SCENE_MOST))
    half = _fitted(half, width / tall)
    scenes = rows * tall + (rows - 1) * GAP
    batches_row = 2 * LEGEND_ROW + 0.1
    height = TITLE + scenes + batches_row + PLOT_TITLE + PLOT + PLOT_FOOT
    figure = Figure(figsize=(WIDTH, height))

    def place(x: float, top: float, wide: float, high: float) -> tuple[float, float, float, float]:
        return x / WIDTH, 1 - (top + high) / height, wide / WIDTH, high / height

    high = min(scenes - HEADING, OVERVIEW_MOST)
    overview = figure.add_axes(place(EDGE, TITLE + HEADING, OVERVIEW, high))
    draw_overview(overview, renderings.sources[0], poses, view, shown, OVERVIEW / high)
    draw_scale(overview, SceneView(view.elevation, view.azimuth).basis() if view.follows_palm else None)
    batches: list[ContourBatch] = []
    for r, source in enumerate(renderings.sources):
        for c, index in enumerate(poses.tolist()):
            axes = figure.add_axes(place(left + c * (width + GAP), TITLE + r * (tall + GAP), width, tall))
            set_limits(axes, middle[r, c], half)
            batches.append(draw_scene(axes, source, index, view))
            if r == 0:
                title = axes.set_title(f"{letter(c)}   {renderings.moments.text(index)}", fontsize=8, loc="left", pad=4)
                title.set_in_layout(False)
            if r == 0 and c == 0:  # all scenes have this scale
                draw_scale(axes, None if view.follows_palm else view.basis())
            if c == 0 and rows > 1:
                axes.text(-0.02, 0.5, renderings.labels[r], transform=axes.transAxes, rotation=90, fontsize=8,
                              fontweight="bold", ha="right", va="center", color=INK, parse_math=False)  # fmt: skip
    solid, hand = renderings.sources[0].solid, renderings.sources[0].file.hand
    words = [hand_text(hand), *(renderings.labels if rows == 1 else [])]
    heads = (
        (short_text(str(solid["name"]), HEAD_MOST), 0.2, "bold"),
        (short_text(", ".join(words), HEAD_MOST), 0.34, "normal"),
    )
    for text, down, weight in heads:
        figure.text(EDGE / WIDTH, 1 - down / height, text, fontsize=8, fontweight=weight, parse_math=False)
    top = TITLE + scenes + 0.05
    handles = legend_handles(renderings.sources, batches, models, shown)
    figure.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 1 - top / height), ncols=LEGEND_COLUMNS,
        frameon=False, fontsize=7.5, handlelength=2.2, columnspacing=1.6, borderaxespad=0, labelspacing=0.35,
    )  # fmt: skip
    wide = (WIDTH - 2 * EDGE - 1.1) / 2
    under = top + batches_row - 0.05 + PLOT_TITLE
    plots = [figure.add_axes(place(EDGE + 0.4 + k * (wide + 0.6), under, wide, PLOT)) for k in range(2)]
    _draw_plots(plots, renderings, poses, sampling)
    return figure


def _limits(extents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the scenes [mm], shape [row, column, 2], and what all of them show to each side of it [mm].

    extents: lowest and highest places, shape [row, column, 2, 2].
    """
    foot = FOOT * np.ptp(extents[..., 1], axis=2)[..., None, None] * [[0.0, 1.0], [0.0, 0.0]]  # for the scale bar
    held = extents - foot
    return held.mean(axis=2), 1.03 * np.ptp(held, axis=2).reshape(-1, 2).max(axis=0) / 2


def _fitted(half: np.ndarray, aspect: float) -> np.ndarray:
    """Half extents that are as wide as `aspect` times their height, and hold those given."""
    return np.array([max(half[0], half[1] * aspect), max(half[1], half[0] / aspect)])


def _draw_plots(plots: list[Any], renderings: Renderings, poses: np.ndarray, sampling: SamplingStrategy) -> None:
    """Length and draw frequency over time, with the moments that are shown."""
    length_axes, frequency_axes = plots
    across, timed = renderings.across, renderings.moments.time is not None
    for k, (label, length) in enumerate(zip(renderings.labels, renderings.lengths, strict=True)):
        look = {"lw": 0.9, "color": LINES[k % len(LINES)], "ls": DASHES[(k // len(LINES) + k) % len(DASHES)]}
        if len(length) < 3:
            look |= {"marker": "o", "ms": 3.5}
        rows = shown_rows(length)
        length_axes.plot(across[rows], 1e3 * length[rows], label=label, **look)
        frequency_axes.plot(across[rows], sampling.draw_frequency(length[rows]), **look)
    frequency_axes.set_yscale("log")
    low, high = frequency_axes.get_ylim()
    frequency_axes.set_ylim(min(low, 10.0), min(max(high, 100.0), FREQUENCY_SHOWN))
    length_axes.set_ylim(bottom=0.0)
    length_axes.set_title("length of the contours [mm]", fontsize=8, loc="left")
    frequency_axes.set_title(f"draw frequency at {sampling.speed:g} m/s [Hz]", fontsize=8, loc="left")
    for axes in plots:
        axes.set_xlabel("time [s]" if timed else "pose", labelpad=1)
        axes.set_xlim(*_span(across))
        for k, index in enumerate(poses.tolist()):
            axes.axvline(across[index], color=FAINT, lw=0.6, ls=(0, (2, 2)), zorder=0)
            if axes is length_axes:
                axes.annotate(letter(k), (across[index], 1.0), (1.5, -1), xycoords=("data", "axes fraction"),
                              textcoords="offset points", fontsize=7, va="top")  # fmt: skip
    if len(renderings.labels) > 1:
        legend = frequency_axes.legend(
            *length_axes.get_legend_handles_labels(), loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False,
            ncols=min(4, len(renderings.labels)), fontsize=7.5, handlelength=2.6, columnspacing=1.2, borderaxespad=0.1,
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


def _span(across: np.ndarray) -> tuple[float, float]:
    """What an axis of times or poses shows."""
    beyond = 0.01 * float(across[-1] - across[0]) or 0.5
    return float(across[0]) - beyond, float(across[-1]) + beyond
