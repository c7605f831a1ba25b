"""Options that say how an object's file is read."""

from typing import Annotated

import typer

Three = tuple[float, float, float]
Kind = Annotated[str | None, typer.Option(help="Of a volume: occupancy, distance, intensity, label.")]
Level = Annotated[float | None, typer.Option(help="Of an intensity volume: its value on the surface.")]
Label = Annotated[list[int] | None, typer.Option(help="Of a segmented volume: labels that are solid; may be repeated.")]
Inside = Annotated[str | None, typer.Option(help="Of a volume: above or below, where values are solid.")]
Spacing = Annotated[Three | None, typer.Option(metavar="X Y Z", help="Of a volume, instead of the file's [m].")]
Unit = Annotated[str | None, typer.Option(help="Of a volume file's lengths: m, cm, mm, um.")]
SolidRule = Annotated[
    str | None, typer.Option(help="Of a mesh: inside by winding number: winding (above 0), even-odd.")
]
Weld = Annotated[float | None, typer.Option(metavar="METRES", help="Of a mesh: merge vertices this close.")]
FillHoles = Annotated[float | None, typer.Option(metavar="METRES", help="Of a mesh: close holes of at most this rim.")]
