"""The command line of `palpate selftest`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Baud, Calibration, Clock, Emulate, Serial, Uncalibrated, Watchdog
from .output import Json, Overwrite, Quiet, run_job


def selftest(
    array: Array = "emulator",
    serial: Serial = None,
    calibration: Calibration = None,
    emulate: Emulate = False,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Ask what was felt, and write answers and figures as JSON, to be sent back."),
    ] = None,
    overwrite: Overwrite = False,
    height: Annotated[float, typer.Option(metavar="METRES", help="Of the hand above the array [m].")] = 0.2,
    duration: Annotated[float, typer.Option(metavar="SECONDS", help="Of each of the three stimuli [s].")] = 3.0,
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    baud: Baud = None,
    clock: Clock = "monotonic",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Play a point, a circle and a slow turn for a hand above the array."""
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    run_job("..selftest.stimuli", "run_selftest", options, json=json, quiet=quiet)
