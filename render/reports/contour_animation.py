"""An animated picture for slides: contours on hand and object over time, in real time, as a GIF."""

import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ..contour_input import takes_batches
from ..errors import StrategyError
from ..validation import require_number, require_path
from .contour_figure import shown_rows
from .contour_lines import draw_contours
from .figure_legend import legend_handles
from .opened_renderings import Renderings, files_of, opened
from .picture_style import COLOURS, DASHES, INK, LINES, require_picture, style, write_picture
from .scene_drawing import SceneSource, blank, draw_hand, draw_object, draw_scale, extent_of, set_limits
from .scene_view import SceneView, flat
from .shown_moments import MotionMoments

FRAMES_MOST = 600
PIXELS_MOST = 200e6  # of all frames; they take as many bytes of memory
FRAMES_USUAL = 300  # without a frame rate; longer motions have fewer frames a second
RATE_USUAL, RATE_LEAST, RATE_MOST = 12.5, 0.5, 50.0  # [Hz]; a GIF's frames last whole hundredths of a second
WIDTH_USUAL, WIDTH_LEAST, WIDTH_MOST = 720, 240, 1280  # [pixel]
FILES_MOST = 3
INCHES = 7.2  # of width; fonts scale with the picture
SCENE_MOST, SCENE_LEAST = 3.0, 1.6  # [inch] height of a scene
TITLE, LEGEND, LEGEND_ROW, PLOT, FOOT = 0.34, 0.2, 0.19, 0.5, 0.4  # [inch]
SAMPLED = 40  # frames whose extents and colours stand for all
COLOURS_MOST, NEARLY_WHITE = 240, 246
EXACT = (*COLOURS.values(), *LINES, INK)  # colours that a GIF has as they are


@dataclass(frozen=True)
class AnimationFrames:
    """When the frames of an animated picture are."""

    poses: np.ndarray
    """Pose of each frame."""
    delay: int
    """Of each frame [hundredth of a second]."""

    @property
    def rate(self) -> float:
        """AnimationFrames a second [Hz]."""
        return 100.0 / self.delay


@takes_batches
def draw_animation(
    paths: Mapping[str, str | Path] | Sequence[str | Path],
    picture: str | Path,
    *,
    start: float | None = None,
    stop: float | None = None,
    frame_rate: float | None = None,
    view: str | Sequence[float] = "iso",
    width: int = WIDTH_USUAL,
    overwrite: bool = False,
    progress: Callable[[int, int], object] | None = None,
) -> AnimationFrames:
    """Draw up to three renderings of one object and motion side by side over time into a GIF, which plays in real time.

    start, stop: range of the motion that is shown [s], or numbers of poses where files have no times. frame_rate [Hz]:
    by default 12.5, fewer where the range is longer than 24 s. width [pixel]. progress: called with the number of
    frames done and of all.

    Raises StrategyError for more frames or pixels than FRAMES_MOST or PIXELS_MOST, with what would fit, and as
    `draw_figure` does.

    >>> from palpate.render import draw_animation, exploration, render
    >>> motion = exploration("cube", duration=1.0, seed=1)
    >>> path = render("cube", "palm", motion, "cc").save("cube.h5", overwrite=True)
    >>> frames = draw_animation([path], "cube.gif", stop=0.2, width=240, overwrite=True)
    >>> len(frames.poses), frames.rate
    (3, 12.5)
    """
    import matplotlib as mpl

    picture = require_path(picture, "the picture")
    require_picture(picture, overwrite=overwrite, only=(".gif",), sources=files_of(paths))
    require_number("width", width, WIDTH_LEAST, WIDTH_MOST, unit="pixels", whole=True)
    eye = SceneView.of(view)
    with ExitStack() as stack, mpl.rc_context(style()):
        renderings = opened(paths, stack)
        if len(renderings.sources) > FILES_MOST:
            raise StrategyError(f"an animated picture shows up to {FILES_MOST} files, not {len(renderings.sources)}")
        frames = frames_of(renderings.moments, start, stop, frame_rate, renderings.sources[0].file.path.name)
        for source, length in zip(renderings.sources, renderings.lengths, strict=True):
            if len(missing := frames.poses[np.isnan(length[frames.poses])]):
                when = renderings.moments.text(int(missing[0]))
                raise StrategyError(f"{source.file.path}: {when} is not done yet; palpate render --resume goes on")
        stage = _Stage(renderings, frames, eye, width)
        content = _gif(stage, frames, progress)
    write_picture(content, picture)
    return frames


def frames_of(
    moments: MotionMoments, start: float | None, stop: float | None, rate: float | None, name: str
) -> AnimationFrames:
    """The frames of a range of a motion; raises StrategyError for a range outside it, or too many frames."""
    if rate is not None:
        require_number("frame rate", rate, RATE_LEAST, RATE_MOST, unit="Hz")
    timed = moments.time is not None
    low, high = moments.at(0), moments.at(len(moments.pose) - 1)
    first, last = (bound if given is None else float(given) for given, bound in ((start, low), (stop, high)))
    unit, what = (" s", "time") if timed else ("", "pose")
    for given in (first, last):
        if not (math.isfinite(given) and low <= given <= high):
            raise StrategyError(
                f"{what} {given:g}{unit} is outside {name}, which has {what}s {low:g} to {high:g}{unit}"
            )
    if not first < last:
        raise StrategyError(f"the range must end after it begins: {first:g} to {last:g}{unit} shows nothing that moves")
    span = last - first if timed else (last - first + 1) / (rate or RATE_USUAL)
    delay = max(1, round(100 / (rate or min(RATE_USUAL, FRAMES_USUAL / span))))
    count = max(2, math.floor(span * 100 / delay + 1e-6) + timed)
    if count > FRAMES_MOST:
        fitting = f"{(FRAMES_MOST - 1) * delay / 100:g} s" if timed else f"{FRAMES_MOST} poses"
        slower = math.floor(1000 / math.ceil(100 * span / (FRAMES_MOST - 1))) / 10
        also = f", or the whole at {slower:g} Hz" if timed and slower >= RATE_LEAST else ""
        raise StrategyError(
            f"{first:g} to {last:g}{unit} are {count} frames at {100 / delay:.3g} Hz, and an animated picture has up "
            f"to {FRAMES_MOST}: {fitting} fit{also}"
        )
    if not timed:
        return AnimationFrames(np.arange(int(first), int(last) + 1), delay)
    at = np.minimum(first + np.arange(count) * delay / 100, last)
    return AnimationFrames(np.clip(np.searchsorted(moments.time, at + 1e-9, side="right") - 1, 0, None), delay)  # type: ignore[arg-type]


class _Stage:
    """A figure whose scenes are drawn anew for each frame over what stays the same."""

    def __init__(self, renderings: Renderings, frames: AnimationFrames, view: SceneView, width: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.renderings, self.view = renderings, view
        self.still = not view.follows_palm and not renderings.sources[0].moves
        self._choose_limits(frames.poses)
        wide, tall = self._scene_size()
        handles = self._handles()
        columns = len(handles) if len(handles) < 5 else 3
        legend = LEGEND + LEGEND_ROW * -(-len(handles) // columns)
        height = round(width / INCHES * (TITLE + tall + legend + PLOT + FOOT)) * INCHES / width
        self._refuse_large(len(frames.poses), width, round(width / INCHES * height), height)
        self.figure = Figure(figsize=(INCHES, height), dpi=width / INCHES)
        self.canvas = FigureCanvasAgg(self.figure)
        top, share = 1 - (TITLE + tall) / height, (wide / INCHES, tall / height)
        lefts = [(0.1 + k * (wide + 0.1)) / INCHES for k in range(len(renderings.sources))]
        self.scenes = [self.figure.add_axes((left, top, *share)) for left in lefts]
        self.plot = self.figure.add_axes((0.75 / INCHES, FOOT / height, 1 - 0.95 / INCHES, PLOT / height))
        self._draw_scenes()
        where = {"loc": "upper center", "bbox_to_anchor": (0.5, top - 0.03 / height), "borderaxespad": 0}
        look = {"ncols": columns, "frameon": False, "fontsize": 8, "handlelength": 1.8, "columnspacing": 1.2}
        self.figure.legend(handles=handles, **where, **look)
        self._draw_plot(frames.poses)
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def _choose_limits(self, poses: np.ndarray) -> None:
        """What scenes show to each side of their middle [mm], and the middle where it stays."""
        extents = self._extents(poses)
        low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
        self.middle = 0.5 * (low + high)
        self.half = 0.52 * (high - low)
        if self.view.follows_palm:
            self.half = 0.52 * np.ptp(extents, axis=1).max(axis=0)

    def _scene_size(self) -> tuple[float, float]:
        """Width and height of a scene [inch]; its limits are widened to fit."""
        wide = (INCHES - 0.3) / len(self.renderings.sources)
        tall = float(np.clip(wide * self.half[1] / self.half[0], SCENE_LEAST, SCENE_MOST))
        across, up = self.half
        self.half = np.array([max(across, up * wide / tall), max(up, across * tall / wide)])
        return wide, tall

    def _extents(self, poses: np.ndarray) -> np.ndarray:
        """Extents of some frames, those with contours if there are any [mm], shape [frame, 2, 2]."""
        longest = np.nan_to_num(np.array(self.renderings.lengths)).max(axis=0)
        drawn = poses[longest[poses] > 0]
        some = drawn if len(drawn) else poses
        some = some[np.linspace(0, len(some) - 1, min(SAMPLED, len(some))).astype(int)]
        return np.array([extent_of(s, int(i), self.view) for s in self.renderings.sources for i in some])

    def _refuse_large(self, count: int, width: int, height: int, inches: float) -> None:
        if count * width * height > PIXELS_MOST:
            fitting = int(math.sqrt(PIXELS_MOST / count / (inches / INCHES)))
            raise StrategyError(
                f"{count} frames of {width} x {height} pixels are {count * width * height / 1e6:.0f} million pixels, "
                f"and an animated picture has up to {PIXELS_MOST / 1e6:g}: {int(PIXELS_MOST / width / height)} frames "
                f"fit, or a width of {fitting} pixels"
            )

    def _draw_scenes(self) -> None:
        """What stays the same in the scenes."""
        for k, (axes, source) in enumerate(zip(self.scenes, self.renderings.sources, strict=True)):
            blank(axes)
            set_limits(axes, self.middle, self.half)
            if self.still:
                draw_object(axes, source.triangles(0), self.view.basis())
            if not k:
                draw_scale(axes, None if self.view.follows_palm else self.view.basis())
            look = {"fontsize": 9, "fontweight": "bold", "ha": "right", "va": "bottom", "parse_math": False}
            axes.text(0.98, 1.0, self.renderings.labels[k], transform=axes.transAxes, **look)

    def _handles(self) -> list[Any]:
        """What explains the marks of the longest contours."""
        sources = self.renderings.sources
        longest = [int(np.argmax(np.nan_to_num(length))) for length in self.renderings.lengths]
        batches = [source.batch(i) for source, i in zip(sources, longest, strict=True)]
        return [own for own in legend_handles(sources, batches, [], []) if "shown" not in own.get_label()]

    def _draw_plot(self, poses: np.ndarray) -> None:
        """Length over the time that is shown."""
        across = self.renderings.across
        for k, (label, length) in enumerate(zip(self.renderings.labels, self.renderings.lengths, strict=True)):
            rows = shown_rows(length)
            look = {"lw": 0.8, "color": LINES[k % len(LINES)], "ls": DASHES[k % len(DASHES)], "label": label}
            self.plot.plot(across[rows], 1e3 * length[rows], **look)
        self.plot.set_ylabel("length [mm]", fontsize=7, labelpad=2)
        self.plot.set_xlabel("pose" if self.renderings.moments.time is None else "time [s]", fontsize=7, labelpad=1)
        self.plot.tick_params(labelsize=7)
        self.plot.set_xlim(across[poses[0]], across[poses[-1]])
        self.plot.set_ylim(bottom=0)
        if len(self.renderings.labels) > 1:
            where = {"loc": "lower right", "bbox_to_anchor": (1, 0.98), "borderaxespad": 0}
            legend = self.plot.legend(ncols=len(self.renderings.labels), fontsize=7, frameon=False, **where)
            for text in legend.get_texts():
                text.set_parse_math(False)

    def pixels(self, index: int) -> np.ndarray:
        """A pose's frame, uint8, shape [row, column, 3]."""
        self.canvas.restore_region(self.background)
        for axes, source in zip(self.scenes, self.renderings.sources, strict=True):
            self._draw_scene(axes, source, index)
        at = self.renderings.across[index]
        cursor = self.plot.axvline(at, color=INK, lw=1.0)
        name = self.figure.text(0.1 / INCHES, 0.985, self.renderings.moments.text(index), fontsize=9, va="top")
        self.plot.draw_artist(cursor)
        self.figure.draw_artist(name)
        for artist in (cursor, name):
            artist.remove()
        return np.array(self.canvas.buffer_rgba())[..., :3]

    def _draw_scene(self, axes: Any, source: SceneSource, index: int) -> None:
        basis = self.view.basis(source.pose[index])
        artists: list[Any] = []
        if not self.still:
            middle = self.middle if not self.view.follows_palm else extent_of(source, index, self.view).mean(axis=0)
            set_limits(axes, middle, self.half)
            artists += draw_object(axes, source.triangles(index), basis)
        artists += draw_hand(axes, source, index, basis)
        batch = source.batch(index)
        if batch.point_count:
            artists += draw_contours(axes, batch, lambda points: flat(points, basis))
        for artist in artists:
            axes.draw_artist(artist)
        for artist in artists:
            artist.remove()


def _gif(stage: _Stage, frames: AnimationFrames, progress: Callable[[int, int], object] | None) -> memoryview:
    from matplotlib.colors import to_rgb
    from PIL import Image

    some = frames.poses[np.linspace(0, len(frames.poses) - 1, min(8, len(frames.poses))).astype(int)]
    longest = np.nan_to_num(np.array(stage.renderings.lengths)).max(axis=0)
    some = np.append(some, frames.poses[np.argmax(longest[frames.poses])])
    shown = Image.fromarray(np.concatenate([stage.pixels(int(i)) for i in some]))
    palette = shown.quantize(COLOURS_MOST, method=Image.Quantize.MEDIANCUT)
    colours = np.array(palette.getpalette()).reshape(-1, 3)[:COLOURS_MOST]
    colours[(colours >= NEARLY_WHITE).all(axis=1)] = 255  # the mean colours of boxes make the background grey
    exact = [[round(255 * part) for part in to_rgb(colour)] for colour in EXACT]
    colours = np.concatenate([colours, exact])
    palette.putpalette(colours.ravel().tolist())
    palette.load()  # without it, `quantize` still takes the colours from before

    def images() -> Iterator[Any]:
        for k, index in enumerate(frames.poses.tolist()):
            image = Image.fromarray(stage.pixels(index))
            yield image.quantize(palette=palette, dither=Image.Dither.NONE)
            if progress is not None:
                progress(k + 1, len(frames.poses))

    every = images()
    first = next(iter(islice(every, 1)))
    content = io.BytesIO()
    first.save(
        content, format="GIF", save_all=True, append_images=every, duration=10 * frames.delay, loop=0, optimize=False
    )
    return content.getbuffer()
