"""The command line of `palpate selftest`: stimuli for a hand, or a first hour with a real board."""

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
    acceptance: Annotated[
        Path | None,
        typer.Option(metavar="REPORT.json", help="A first hour with a board, led (docs/guide/first-contact.md)."),
    ] = None,
    overwrite: Overwrite = False,
    height: Annotated[
        float | None, typer.Option(metavar="METRES", help="Of the hand above the array [m], by default 0.2.")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Of each of the three stimuli [s], by default 3.")
    ] = None,
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    baud: Baud = None,
    clock: Clock = "monotonic",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Play a point, a circle and a slow turn for a hand above the array, or lead through a first hour with it."""
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    module, name = ("stimuli", "run_selftest") if acceptance is None else ("acceptance", "run_acceptance")
    run_job(f"..selftest.{module}", name, options, json=json, quiet=quiet)
