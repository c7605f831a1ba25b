"""Options of all commands that make focal points of contours, and drives of focal points."""

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
Amplitude = Annotated[
    str, typer.Option(metavar="KIND", help="Whether intensity is pressure or force; for strength see --level-max.")
]
Solver = Annotated[
    str, typer.Option(metavar="SOLVER", help="For several focal points at once: naive, gs-pat, wgs, gs-pat+wgs.")
]
Slew = Annotated[
    float | None,
    typer.Option(metavar="TURNS", help="Most that a phase changes in 25 us [turns]; 0.015625 quietens jumps."),
]
LevelMax = Annotated[
    float, typer.Option(metavar="SHARE", help="Strength of intensity 1, as a share (0..1) of what the array can.")
]
SoundSpeed = Annotated[float, typer.Option(metavar="M/S", help="Speed of sound [m/s]: 331.3 + 0.606 x degrees C.")]
