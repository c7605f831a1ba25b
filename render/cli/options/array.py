"""Options of all commands that play to an array."""

from pathlib import Path
from typing import Annotated

import typer

from .completion import complete_array

_ARRAY = typer.Option(
    metavar="NAME|RIG",
    help="emulator, pat16 (openmpd), sonicsurface, autd3, stratos (ultraleap), or a JSON file of several and their "
    "poses.",
    autocompletion=complete_array,
)
Array = Annotated[str, _ARRAY]
OptionalArray = Annotated[str | None, _ARRAY]
"""The same where a command must know whether it was given."""
Serial = Annotated[
    str | None,
    typer.Option(
        metavar="SERIAL",
        help="Which one: its serial number, a sonicsurface's port, an autd3's network interface, a stratos' HOST:PORT.",
    ),
]
Calibration = Annotated[
    Path | None, typer.Option(metavar="BOARD.pat", help="Board file of a pat16: wiring, phase offsets, serial number.")
]
Emulate = Annotated[bool, typer.Option("--emulate", help="A model of the array instead of the array.")]
Watchdog = Annotated[
    bool, typer.Option("--watchdog", help="A second process switches the array off if this one is killed.")
]
Uncalibrated = Annotated[
    bool, typer.Option("--uncalibrated", help="Play on a real pat16 without its board file: wired as published ones.")
]
Baud = Annotated[int | None, typer.Option(metavar="BAUD", help="Of a sonicsurface with unusual firmware [Bd].")]
Clock = Annotated[
    str,
    typer.Option(metavar="CLOCK", help="Of an emulated array: monotonic (real time) or virtual (as fast as it goes)."),
]
