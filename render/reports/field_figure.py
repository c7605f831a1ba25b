"""Pictures of radiation pressure: the print on skin or a plane with contours on top, or a volume from three sides."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...datasets.errors import ContourFileError
from ..acoustics.sampled_places import SampledPlane
from ..acoustics.skin_print import SkinPrint
from .picture_style import require_picture, save_picture

COLOURS = "inferno"
LINE = "#7fd6ff"  # stands out on dark and on bright
MILLIMETRES = 1e3


def draw_print(
    skin: SkinPrint, polylines: Sequence[np.ndarray], picture: Path, *, title: str, overwrite: bool = False
) -> None:
    """Draw mean radiation pressure on planes, seen along the first one's normal, with contours [m] on top.

    Raises StrategyError for another suffix, or a picture that is there; ContourFileError if it cannot be written.
    """
    from matplotlib.figure import Figure

    require_picture(picture, overwrite=overwrite)
    figure = Figure(figsize=(5.6, 4.8), layout="constrained")
    axes = figure.add_subplot()
    axes.set_facecolor("#e9ecef")
    first = skin.planes[0]
    image = None
    for plane, radiation in zip(skin.planes, skin.radiation, strict=True):
        x, y = _corners(plane, first)
        image = axes.pcolormesh(
            x, y, radiation, cmap=COLOURS, vmin=0, vmax=skin.radiation_peak or 1.0, rasterized=True, zorder=1
        )
    for line in polylines:
        place = MILLIMETRES * first.locate(line)
        axes.plot(place[:, 0], place[:, 1], color=LINE, lw=1.1, ls=(0, (4, 2)), zorder=2)
    axes.margins(0.03)  # contours along the border show
    axes.set_aspect("equal")
    axes.set_xlabel("across [mm]")
    axes.set_ylabel("along [mm]")
    axes.set_title(title, fontsize=9, loc="left", parse_math=False)
    figure.colorbar(image, ax=axes, label="mean radiation pressure [Pa]", shrink=0.85)
    _save(figure, picture)


def draw_volume(
    coordinates: tuple[np.ndarray, ...], radiation: np.ndarray, picture: Path, *, title: str, overwrite: bool = False
) -> None:
    """Draw the largest mean radiation pressure along each axis; radiation: [Pa], shape [z, y, x]; errors as above."""
    from matplotlib.figure import Figure

    require_picture(picture, overwrite=overwrite)
    figure = Figure(figsize=(10.5, 3.8), layout="constrained")
    image = None
    for k, (axis, across, along) in enumerate(((0, 0, 1), (1, 0, 2), (2, 1, 2))):
        axes = figure.add_subplot(1, 3, k + 1)
        x, y = MILLIMETRES * coordinates[across], MILLIMETRES * coordinates[along]
        image = axes.pcolormesh(
            x, y, radiation.max(axis=axis), cmap=COLOURS, vmin=0, vmax=radiation.max() or 1.0, rasterized=True
        )
        axes.set_aspect("equal")
        axes.set_xlabel(f"{'xyz'[across]} [mm]")
        axes.set_ylabel(f"{'xyz'[along]} [mm]")
        axes.set_title(f"largest along {'zyx'[axis]}", fontsize=8, loc="left")
    figure.colorbar(image, ax=figure.axes, label="mean radiation pressure [Pa]", shrink=0.85)
    figure.suptitle(title, fontsize=9, parse_math=False)
    _save(figure, picture)


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


def _save(figure: Any, picture: Path) -> None:
    try:
        save_picture(figure, picture, dpi=130)
    except OSError as error:
        raise ContourFileError(f"{picture}: the picture cannot be written ({error.strerror or error})") from error
