"""Options of all commands that make drives of focal points."""

from typing import Annotated

import typer

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
