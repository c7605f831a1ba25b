"""The command line of `palpate play`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Baud, Calibration, Clock, Emulate, Serial, Uncalibrated, Watchdog
from .output import Json, Quiet, run_job
from .sampling import Duration, Sampling, Speed, UpdateRate


def play(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Contour file, or focal points: .PTLIST, or a sweep's.")],
    array: Array = "emulator",
    serial: Serial = None,
    calibration: Calibration = None,
    baud: Baud = None,
    emulate: Emulate = False,
    sampling: Sampling = None,
    speed: Speed = None,
    update_rate: UpdateRate = None,
    duration: Duration = None,
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="How often to play it.")] = 1,
    amplitude: Annotated[
        str, typer.Option(metavar="KIND", help="Whether intensity is pressure or force; for strength see --level-max.")
    ] = "pressure",
    solver: Annotated[
        str, typer.Option(metavar="SOLVER", help="For several focal points at once: naive, gs-pat, wgs, gs-pat+wgs.")
    ] = "gs-pat+wgs",
    slew: Annotated[
        float | None,
        typer.Option(metavar="TURNS", help="Most that a phase changes in 25 us [turns]; 0.015625 quietens jumps."),
    ] = None,
    level_max: Annotated[
        float, typer.Option(metavar="SHARE", help="Strength of intensity 1, as a share (0..1) of what the array can.")
    ] = 1.0,
    on_time_max: Annotated[
        float, typer.Option(metavar="SECONDS", help="Longest emission without a pause of 1 s [s]; 0 lifts the limit.")
    ] = 120.0,
    duty_max: Annotated[
        float,
        typer.Option(metavar="SHARE", help="Highest mean duty over 10 min, 1 being full drive; 0 lifts the limit."),
    ] = 0.5,
    sound_speed: Annotated[
        float, typer.Option(metavar="M/S", help="Speed of sound [m/s]: 331.3 + 0.606 x degrees C.")
    ] = 343.0,
    transport: Annotated[str, typer.Option(metavar="KIND", help="USB writes: queued, sync, or auto.")] = "auto",
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    device: Annotated[
        str, typer.Option(metavar="DEVICE", help="For solvers of several focal points: cpu, cuda:0.")
    ] = "cpu",
    clock: Clock = "monotonic",
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 1 if late frames, silenced points, or too long steps are warned of."),
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Sample a contour file and stream it to an array; the array is off on every way out."""
    options = {name: value for name, value in locals().items() if name not in ("file", "quiet", "json")}
    run_job(".play_commands", "run_play", file, options, json=json, quiet=quiet)
