"""What pictures of contours share: colours, text that stays text, and files that are written whole or not at all."""

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...datasets.errors import ContourFileError
from ...datasets.storage.durable import write_file
from ..errors import StrategyError
from ..output_file import require_output

COLOURS = {"object": "#b1121f", "hand": "#3d9be0", "made": "#6a4c93", "mesh": "#8d99ae", "palm": "#f4a261"}
"""Of contours by kind: their greys differ, too (lightness 38, 62, 38), and `made` seldom meets `object`."""
LINES = ("#2b2d42", "#2a9d8f", "#9b5de5", "#bc6c25")  # of lengths and frequencies: not those of the contours
DASHES = ("-", (0, (4, 1.2)), (0, (1.2, 1)), (0, (5, 1, 1, 1)))  # the same lines in greyscale
HAND_DASHES = (1.2, 2.0)  # on and off, of a line's width, with round ends: the hand's contours differ in greyscale, too
PALEST = 0.85  # of the way to white: a contour of no intensity, as in the viewer
INK, FAINT = "#222222", "#6b7280"
SUFFIXES = (".png", ".svg", ".pdf")
DPI = 150  # [dots per inch] of a PNG on a screen
RASTER = 300  # [dots per inch] in print, and of what a vector picture holds as pixels: meshes of many triangles


def paler(colour: str, intensity: float) -> tuple[float, float, float]:
    """A contour's colour at an intensity: as it is at 1, and PALEST of the way to white at 0."""
    from matplotlib.colors import to_rgb

    red, green, blue = (part + (1.0 - part) * PALEST * (1.0 - float(intensity)) for part in to_rgb(colour))
    return red, green, blue


def style(font: float = 8.0) -> dict[str, Any]:
    """Settings of matplotlib for a picture whose texts have one size [pt]; text stays text in SVG and PDF."""
    return {
        "font.family": "DejaVu Sans",  # matplotlib's own, so that every machine draws the same
        "font.size": font,
        "axes.titlesize": font,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "svg.fonttype": "none",
        "svg.hashsalt": "palpate",  # ids of an SVG are the same each time
        "pdf.fonttype": 42,
    }


def require_picture(
    picture: Path,
    *,
    overwrite: bool,
    also: tuple[str, ...] = (),
    sources: Iterable[Path] = (),
) -> None:
    """Raise StrategyError for a name that is none of a picture, and for what `require_output` refuses.

    also: other suffixes that may be written. sources: files that the picture is made from.
    """
    if picture.suffix.lower() not in (*SUFFIXES, *also):
        raise StrategyError(f"{picture}: must end in one of {', '.join((*SUFFIXES, *also))}")
    require_output(picture, overwrite=overwrite, sources=sources)


def save_picture(figure: Any, picture: Path, *, dpi: int) -> None:
    """Write a matplotlib figure whole or not at all; raises OSError."""
    write_file(picture, picture_bytes(figure, picture.suffix.lower().removeprefix("."), dpi=dpi))


def save_figure(figure: Any, picture: Path, *, in_print: bool) -> None:
    """Write a figure, with finer pixels in print; raises ContourFileError where it cannot be written."""
    try:
        save_picture(figure, picture, dpi=RASTER if in_print else DPI)
    except OSError as error:
        raise ContourFileError(f"{picture}: the picture cannot be written ({error.strerror or error})") from error


def picture_bytes(figure: Any, kind: str, *, dpi: float) -> memoryview:
    """A matplotlib figure as a PNG, SVG or PDF, the same bytes each time; vector pictures keep text as text.

    The dots per inch of a PNG are changed by less than a thousandth: a whole number of pixels is as wide as the figure.
    """
    import matplotlib as mpl

    dpi = (round(figure.get_figwidth() * dpi) + 1e-6) / figure.get_figwidth()
    undated = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    content = io.BytesIO()
    with mpl.rc_context({name: style()[name] for name in ("svg.fonttype", "svg.hashsalt", "pdf.fonttype")}):
        figure.savefig(content, dpi=dpi if kind == "png" else RASTER, format=kind, metadata=undated)
    return content.getbuffer()
