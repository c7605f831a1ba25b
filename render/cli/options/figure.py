"""The command line of `palpate figure`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import OptionalArray
from .output import Json, Overwrite, Quiet, run_job

PictureWidth = Annotated[
    str | None,
    typer.Option(
        metavar="METRES|NAME",
        help="Of the picture [m], or single, double, ieee-single, ieee-double.",
    ),
]
FontSize = Annotated[
    float | None, typer.Option(metavar="POINTS", help="Of all texts in the picture [pt], by default 8.")
]


def figure(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Contour files of one object and motion.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="PICTURE", help="PNG, SVG or PDF to write.")],
    times: Annotated[
        str | None,
        typer.Option(metavar="T,T,..", help="Moments to show [s], or pose numbers if there are no times; else chosen."),
    ] = None,
    view: Annotated[
        str, typer.Option(metavar="NAME|EL,AZ", help="iso, front, back, side, top, palm, or angles in degrees: 30,-45.")
    ] = "iso",
    array: OptionalArray = None,
    no_array: Annotated[bool, typer.Option("--no-array", help="Leave out the array.")] = False,
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="TEXT", help="Name of a file in the picture: one for each file, in their order."),
    ] = None,
    width: PictureWidth = None,
    font_size: FontSize = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Draw contours on hand and object at some moments, their length and draw frequency."""
    options = {name: value for name, value in locals().items() if name not in ("files", "quiet", "json")}
    run_job(".figure_command", "run_figure", files, options, json=json, quiet=quiet)
