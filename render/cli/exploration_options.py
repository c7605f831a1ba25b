"""Options of a synthetic exploration that the command line takes."""

from typing import Annotated

import typer

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
    tuple[float, float, float, float, float, float] | None,
    typer.Option(
        metavar="X Y Z X Y Z",
        help="Lowest and highest corner of where the palm's centre goes in an exploration [m].",
    ),
]
