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
from ..sampling.strategy import DEFAULT
from ..validation import require_number, require_path
from .contour_figure import draw_plots, lay_out
from .figure_legend import legend_entries
from .opened_renderings import Renderings, files_of, opened
from .picture_page import EDGE, INCH, Page
from .picture_style import COLOURS, INK, LINES, require_picture, style, write_picture
from .scene_drawing import SceneSource, blank, draw_object, draw_scale, draw_scene, extent_of, set_limits
from .scene_view import SceneView
from .shown_moments import MotionMoments

FRAMES_MOST = 600
PIXELS_MOST = 200e6  # of all frames; they take as many bytes of memory
FRAMES_USUAL = 300  # without a frame rate; longer motions have fewer frames a second
RATE_USUAL, RATE_LEAST, RATE_MOST = 12.5, 0.5, 50.0  # [Hz]; a GIF's frames last whole hundredths of a second
WIDTH_USUAL, WIDTH_LEAST, WIDTH_MOST = 720, 240, 1280  # [pixel]
FILES_MOST = 3
INCHES, FONT = 7.2, 9.0  # [inch] of width, [pt]; texts are larger where there are more pixels
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
    with ExitStack() as stack, mpl.rc_context(style(FONT)):
        renderings = opened(paths, stack, FILES_MOST)
        frames = frames_of(renderings.moments, start, stop, frame_rate, renderings.sources[0].file.path.name)
        renderings.require_done(frames.poses)
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

        self.renderings, self.view = renderings, view
        sources, poses = renderings.sources, frames.poses
        self.still = not view.follows_palm and not sources[0].moves
        longest = [np.argmax(np.nan_to_num(length)) for length in renderings.lengths]
        entries = legend_entries(sources, [source.batch(int(i)) for source, i in zip(sources, longest, strict=True)])
        extents = self._extents(poses)
        low, high = extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)
        self.middle = 0.5 * (low + high)  # [mm], where scenes stay
        half = 0.52 * (np.ptp(extents, axis=1).max(axis=0) if view.follows_palm else high - low)
        page = Page(INCHES * INCH, FONT)
        parts = lay_out(page, renderings, poses[:1], half, entries, overview=False, clock=True)
        self.figure, self.scenes, self.half = page.figure, parts.scenes, parts.half
        self.figure.set_dpi((width + 1e-6) / INCHES)
        self.clock = EDGE / INCHES, 1 - parts.moment / self.figure.get_figheight()
        self._refuse_large(len(poses), width)
        self.canvas = FigureCanvasAgg(self.figure)
        for axes, source in zip(self.scenes, sources, strict=True):
            blank(axes)
            set_limits(axes, self.middle, self.half)
            if self.still:
                draw_object(axes, source.triangles(0), view.basis())
        draw_scale(self.scenes[0], None if view.follows_palm else view.basis())
        draw_plots(parts.plots, renderings, [], DEFAULT)
        for plot in parts.plots:
            plot.set_xlim(renderings.across[poses[0]], renderings.across[poses[-1]])
        self.plots = parts.plots
        self.canvas.draw()
        self.background = self.canvas.copy_from_bbox(self.figure.bbox)

    def _extents(self, poses: np.ndarray) -> np.ndarray:
        """Extents of some frames, those with contours if there are any [mm], shape [frame, 2, 2]."""
        longest = np.nan_to_num(np.array(self.renderings.lengths)).max(axis=0)
        drawn = poses[longest[poses] > 0]
        some = drawn if len(drawn) else poses
        some = some[np.linspace(0, len(some) - 1, min(SAMPLED, len(some))).astype(int)]
        return np.array([extent_of(s, int(i), self.view) for s in self.renderings.sources for i in some])

    def _refuse_large(self, count: int, width: int) -> None:
        height = int(self.figure.get_figheight() * self.figure.dpi)
        if count * width * height > PIXELS_MOST:
            fitting = int(math.sqrt(PIXELS_MOST / count * width / height))
            raise StrategyError(
                f"{count} frames of {width} x {height} pixels are {count * width * height / 1e6:.0f} million pixels, "
                f"and an animated picture has up to {PIXELS_MOST / 1e6:g}: {int(PIXELS_MOST / width / height)} frames "
                f"fit, or a width of {fitting} pixels"
            )

    def pixels(self, index: int) -> np.ndarray:
        """A pose's frame, uint8, shape [row, column, 3]."""
        self.canvas.restore_region(self.background)
        for axes, source in zip(self.scenes, self.renderings.sources, strict=True):
            self._draw_scene(axes, source, index)
        for plot in self.plots:
            cursor = plot.axvline(self.renderings.across[index], color=INK, lw=1.0)
            plot.draw_artist(cursor)
            cursor.remove()
        name = self.figure.text(*self.clock, self.renderings.moments.text(index), fontsize=FONT)
        self.figure.draw_artist(name)
        name.remove()
        return np.array(self.canvas.buffer_rgba())[..., :3]

    def _draw_scene(self, axes: Any, source: SceneSource, index: int) -> None:
        if self.view.follows_palm:
            set_limits(axes, extent_of(source, index, self.view).mean(axis=0), self.half)
        artists = draw_scene(axes, source, index, self.view, solid=not self.still)
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
