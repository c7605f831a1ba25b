"""Options that say how an object's file is read, where the object goes, and how a synthetic hand explores it."""

from pathlib import Path
from typing import Annotated

import typer

from .completion import complete_hand

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
Kind = Annotated[str | None, typer.Option(metavar="KIND", help="Of a volume: occupancy, distance, intensity, label.")]
Level = Annotated[float | None, typer.Option(metavar="VALUE", help="Of an intensity volume: its value on the surface.")]
Label = Annotated[
    list[int] | None,
    typer.Option(metavar="LABEL", help="Of a segmented volume: labels that are solid; may be repeated."),
]
Inside = Annotated[
    str | None, typer.Option(metavar="SIDE", help="Of a volume: above or below, where values are solid.")
]
Spacing = Annotated[Three | None, typer.Option(metavar="X Y Z", help="Of a volume, instead of the file's [m].")]
Unit = Annotated[str | None, typer.Option(metavar="UNIT", help="Of a volume file's lengths: m, cm, mm, um.")]
SolidRule = Annotated[
    str | None, typer.Option(metavar="RULE", help="Of a mesh: inside by winding number: winding (above 0), even-odd.")
]
Weld = Annotated[float | None, typer.Option(metavar="METRES", help="Of a mesh: merge vertices this close.")]
FillHoles = Annotated[float | None, typer.Option(metavar="METRES", help="Of a mesh: close holes of at most this rim.")]
SCALE_HELP = "Factor on the object's coordinates (0.001 for millimetres)."
Scale = Annotated[float, typer.Option(metavar="FACTOR", help=SCALE_HELP)]
Up = Annotated[str, typer.Option(metavar="AXIS", help="Axis of the file that points up: x, y, z, -x, -y, -z.")]
Fit = Annotated[float | None, typer.Option(metavar="SIZE", help="Longest side [m], whatever the scale.")]
Rotate = Annotated[Three, typer.Option(metavar="X Y Z", help="Turn about the array's axes x, y, z in turn [degree].")]
At = Annotated[Three | None, typer.Option(metavar="X Y Z", help="Where the middle of the object goes [m].")]
Bounds = Annotated[
    Six | None, typer.Option(metavar="X Y Z X Y Z", help="Of a function: lowest and highest coordinates [m].")
]
HAND_HELP = "palm: one rectangle; planes: palm and phalanges; skin: palpate's own hand; or a file of a hand's mesh."
HandKind = Annotated[str, typer.Option(metavar="KIND|FILE", help=HAND_HELP, autocompletion=complete_hand)]
PalmSize = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="WIDTH LENGTH", help="Size of the palm [m], by default 0.085 0.085."),
]
Alignment = Annotated[
    Path | None,
    typer.Option(metavar="FILE|y-up|unity", help="Of a recording: from the tracker's frame to the array's."),
]
Model = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Of an exploration: over-array (default), a palm that faces the array; around, from every side.",
    ),
]
Explorer = Annotated[
    int | None, typer.Option(metavar="N", help="Which person explores, by number; by default 1. --seed is the trial.")
]
Facing = Annotated[
    float | None,
    typer.Option(
        metavar="RAD",
        help="Largest angle of the palm's skin to the array's centre in an exploration [rad], by default 1.047.",
    ),
]
Workspace = Annotated[
    Six | None,
    typer.Option(
        metavar="X Y Z X Y Z",
        help="Lowest and highest corner of where the palm's centre goes in an exploration [m].",
    ),
]
