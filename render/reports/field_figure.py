"""Pictures of radiation pressure: prints on skin or a plane with contours on top, or volumes from three sides.

Several files are drawn at one scale, of colour and of space, and each with the width of its focal point.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..acoustics.sampled_places import SampledPlane
from ..acoustics.skin_print import SkinPrint
from .picture_page import EDGE, GAP, INCH, LINE, Page, fit_text, font_of, text_width, width_of
from .picture_style import INK, require_picture, save_figure, style
from .scene_drawing import set_limits

COLOURS = "inferno"
CONTOUR = "#7fd6ff"  # stands out on dark and on bright
MILLIMETRES = 1e3
SINGLE = 5.6 * INCH  # [m] of a picture of one panel, if no width is asked for
PANEL_LEAST, PANEL_MOST = 1.7, 4.0  # [inch] width of a panel with its numbers, and most height without


@dataclass(frozen=True)
class FieldPanel:
    """A plane on which pressure is shown."""

    patches: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
    """Corners of cells along both axes [mm], shape [row + 1, column + 1], and pressure [Pa], shape [row, column]."""
    lines: list[np.ndarray]
    """Contours [mm], shape [point, 2]."""
    names: tuple[str, str]
    """What is across, and what is along."""
    title: str = ""

    @property
    def extent(self) -> np.ndarray:
        """Lowest and highest places [mm], shape [2, 2]."""
        places = [np.stack([x, y], axis=-1).reshape(-1, 2) for x, y, _ in self.patches]
        every = np.concatenate([*places, *self.lines])
        return np.stack([every.min(axis=0), every.max(axis=0)])


@dataclass(frozen=True)
class FieldPicture:
    """What is shown of a file."""

    title: str
    focal_width: float
    """[m]"""
    panels: list[FieldPanel]


def print_picture(skin: SkinPrint, polylines: Sequence[np.ndarray], *, title: str, focal_width: float) -> FieldPicture:
    """Mean radiation pressure on planes, seen along the first one's normal, with contours [m] on top."""
    first = skin.planes[0]
    patches = [(*_corners(plane, first), part) for plane, part in zip(skin.planes, skin.radiation, strict=True)]
    lines = [MILLIMETRES * first.locate(line) for line in polylines]
    return FieldPicture(title, focal_width, [FieldPanel(patches, lines, ("across [mm]", "along [mm]"))])


def volume_picture(
    coordinates: tuple[np.ndarray, ...], radiation: np.ndarray, *, title: str, focal_width: float
) -> FieldPicture:
    """The largest mean radiation pressure along each axis; radiation: [Pa], shape [z, y, x]."""
    panels = []
    for axis, across, along in ((0, 0, 1), (1, 0, 2), (2, 1, 2)):
        x, y = np.meshgrid(*(_borders(MILLIMETRES * coordinates[k]) for k in (across, along)))
        names = (f"{'xyz'[across]} [mm]", f"{'xyz'[along]} [mm]")
        panels.append(FieldPanel([(x, y, radiation.max(axis=axis))], [], names, f"largest along {'zyx'[axis]}"))
    return FieldPicture(title, focal_width, panels)


def draw_fields(
    shown: Sequence[FieldPicture],
    picture: Path,
    *,
    width: float | str | None = None,
    font_size: float | None = None,
    overwrite: bool = False,
) -> None:
    """Draw pressure of one file or several into a PNG, SVG or PDF; width, font_size: as for `draw_figure`.

    Raises StrategyError for another suffix, a picture that is there, and sizes out of range; ContourFileError if it
    cannot be written.
    """
    require_picture(picture, overwrite=overwrite)
    save_figure(fields_figure(shown, width=width, font_size=font_size), picture, in_print=width is not None)


def fields_figure(shown: Sequence[FieldPicture], *, width: float | str | None, font_size: float | None) -> Any:
    """The picture that `draw_fields` writes, as a matplotlib figure."""
    import matplotlib as mpl

    panels = [panel for own in shown for panel in own.panels]
    run = max(len(shown[0].panels), len(shown) if len(panels) == len(shown) else 1)
    page = Page(SINGLE if width is None and len(panels) == 1 else width_of(width), font_of(font_size))
    with mpl.rc_context(style(page.font)):
        extents = np.array([panel.extent for panel in panels])
        half = 1.04 * np.ptp(extents, axis=1).max(axis=0) / 2  # contours along the border show
        most = max(float(values.max(initial=0.0)) for panel in panels for _, _, values in panel.patches) or 1.0
        columns = -(-run // -(-run // max(1, int(page.inner / PANEL_LEAST))))
        ticks = (6 * 0.64 + LINE + 0.3) * page.font / 72  # numbers and the name of the axis
        wide = page.inner / columns - ticks - GAP
        tall = float(np.clip(wide * half[1] / half[0], 0.5 * wide, max(PANEL_MOST, 0.5 * wide)))
        axes, top = [], EDGE
        for first in range(0, len(panels), run):
            if run == len(shown[0].panels) > 1 or len(shown) == 1:
                top += page.text(shown[first // run].title, EDGE, top, page.inner, lines=3)
            for start in range(first, first + run, columns):
                row = range(start, min(start + columns, first + run))
                lefts = [EDGE + ticks + (k - start) * page.inner / columns for k in row]
                titles = [panels[k].title or (shown[k].title if len(shown) > 1 else "") for k in row]
                top += page.row(titles, lefts, top, wide, lines=4) if any(titles) else 0.5 * page.line
                axes += [page.axes(left, top, wide, tall) for left in lefts]
                top += tall + 2.3 * page.line + 0.12
        bar = page.axes(EDGE + ticks, top, page.inner - 2 * ticks, 0.1)
        page.finish(top + 0.1 + 2.3 * page.line + 0.12 + EDGE)
        image = None
        for k, (own, panel) in enumerate(zip(axes, panels, strict=True)):
            image = _draw_panel(own, panel, most, np.maximum(half, half[::-1] * [wide / tall, tall / wide]))
            if k % len(shown[0].panels) == 0:  # of a file's volume, the first side
                _draw_focal_width(own, shown[k // len(shown[0].panels)].focal_width, page.font, wide)
        label = fit_text("mean radiation pressure [Pa]", page.inner, page.font)
        page.figure.colorbar(image, cax=bar, orientation="horizontal").set_label(label, labelpad=1)
    return page.figure


def _draw_panel(axes: Any, panel: FieldPanel, most: float, half: np.ndarray) -> Any:
    """Draw pressure, contours and names of axes; returns the last image, for the bar of colours."""
    axes.set_facecolor("#e9ecef")
    look, image = {"cmap": COLOURS, "vmin": 0.0, "vmax": most, "rasterized": True, "zorder": 1}, None
    for x, y, values in panel.patches:
        image = axes.pcolormesh(x, y, values, **look)
    for line in panel.lines:
        axes.plot(line[:, 0], line[:, 1], color=CONTOUR, lw=1.1, ls=(0, (4, 2)), zorder=2)
    axes.set_xlabel(panel.names[0], labelpad=1)
    axes.set_ylabel(panel.names[1], labelpad=1)
    set_limits(axes, panel.extent.mean(axis=0), half)
    return image


def _draw_focal_width(axes: Any, width: float, font: float, room: float) -> None:
    """Add a bar as long as a focal point is wide [m], with its label; room: width of the axes [inch]."""
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    x, y = left + 0.04 * (right - left), low + 0.04 * (high - low)
    for colour, thick in (("white", 4.0), (INK, 2.0)):
        ends = [x, x + MILLIMETRES * width]
        axes.plot(ends, [y, y], color=colour, lw=thick, solid_capstyle="butt", zorder=5, gid="focal width")
    label = f"focal width {MILLIMETRES * width:.1f} mm"
    if text_width(label, font) > 0.9 * room:
        label = f"{MILLIMETRES * width:.1f} mm"
    box = {"facecolor": "white", "alpha": 0.9, "edgecolor": "none", "pad": 1.0}
    axes.annotate(label, (x, y), (1, 5), textcoords="offset points", color=INK, zorder=5, bbox=box)


def _borders(middles: np.ndarray) -> np.ndarray:
    """Borders of cells between their middles, and at both ends."""
    step = np.diff(middles).mean() if len(middles) > 1 else 1.0
    return np.append(middles - step / 2, middles[-1] + step / 2)


def _corners(plane: SampledPlane, first: SampledPlane) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a plane's cells on the first one's axes [mm], shape [row + 1, column + 1]."""
    across, along = (
        np.linspace(-side / 2, side / 2, len(middles) + 1)
        for side, middles in zip(plane.extent, (plane.across, plane.along), strict=True)
    )
    b, a = np.meshgrid(along, across, indexing="ij")
    place = plane.origin + a[..., None] * plane.u + b[..., None] * plane.v
    flat = MILLIMETRES * first.locate(place.reshape(-1, 3)).reshape(*a.shape, 2)
    return flat[..., 0], flat[..., 1]
