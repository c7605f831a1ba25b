"""The command line of `palpate selftest`: stimuli for a hand, or a first hour with a real board."""

from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from ..terminal import console
from .array_options import Array, Calibration, Emulate, Serial, Uncalibrated, Watchdog


def selftest(
    array: Array = "emulator",
    serial: Serial = None,
    calibration: Calibration = None,
    emulate: Emulate = False,
    acceptance: Annotated[
        Path | None,
        typer.Option(metavar="REPORT.json", help="A first hour with a board, led (docs/guide/first-contact.md)."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the report.")] = False,
    height: Annotated[float | None, typer.Option(help="Of the hand above the array [m], by default 0.2.")] = None,
    seconds: Annotated[float | None, typer.Option(help="Of each of the three stimuli [s], by default 3.")] = None,
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    baud: Annotated[int | None, typer.Option(help="Of a sonicsurface with unusual firmware [Bd].")] = None,
    clock: Annotated[str, typer.Option(help="Of the emulated array: monotonic or virtual.")] = "monotonic",
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")] = False,
) -> None:
    """Play a point, a circle and a slow turn for a hand above the array, or lead through a first hour with it."""
    options = {name: value for name, value in locals().items() if name != "json"}
    module, name = ("stimuli", "run_selftest") if acceptance is None else ("acceptance", "run_acceptance")

    def command() -> object:
        return getattr(import_module(f"..selftest.{module}", __package__), name)(options, as_json=json)

    raise typer.Exit(console.run(command, as_json=json))
