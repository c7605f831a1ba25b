"""Options of all commands that make focal points of contours."""

from typing import Annotated

import typer

from .completion import complete_sampling

Sampling = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|FILE",
        help="How contours become focal points: a preset (palpate sampling lists them) or a JSON file; by default stm.",
        autocompletion=complete_sampling,
    ),
]
Speed = Annotated[float | None, typer.Option(metavar="M/S", help="Of the focal point [m/s], by default 7.")]
UpdateRate = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Focal points a second [Hz]: 40 kHz / n, by default 10000, or the array's."),
]
Duration = Annotated[
    float | None,
    typer.Option(
        metavar="SECONDS", help="Stop after this time [s] if the motion has not ended; a static pose needs it."
    ),
]
