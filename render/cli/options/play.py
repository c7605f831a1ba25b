"""The command lines of `palpate play` and `palpate prepare`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Baud, Calibration, Clock, Emulate, Serial, Uncalibrated, Watchdog
from .output import Json, Overwrite, Quiet, run_job
from .sampling import Amplitude, Duration, LevelMax, Sampling, Slew, Solver, SoundSpeed, Speed, UpdateRate

OnTimeMax = Annotated[
    float, typer.Option(metavar="SECONDS", help="Longest emission without a pause of 1 s [s]; 0 lifts the limit.")
]
DutyMax = Annotated[
    float, typer.Option(metavar="SHARE", help="Highest mean duty over 10 min, 1 being full drive; 0 lifts the limit.")
]
Transport = Annotated[str, typer.Option(metavar="KIND", help="USB writes: queued, sync, or auto.")]


def play(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Contour file, focal points (.PTLIST, or a sweep's), or prepared frames."),
    ],
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
    amplitude: Amplitude = "pressure",
    solver: Solver = "gs-pat+wgs",
    slew: Slew = None,
    level_max: LevelMax = 1.0,
    on_time_max: OnTimeMax = 120.0,
    duty_max: DutyMax = 0.5,
    sound_speed: SoundSpeed = 343.0,
    transport: Transport = "auto",
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


def prepare(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Contour file, or focal points: .PTLIST, or a sweep's.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FRAMES.h5", help="File of wire bytes to write.")],
    array: Array = "emulator",
    calibration: Calibration = None,
    baud: Baud = None,
    sampling: Sampling = None,
    speed: Speed = None,
    update_rate: UpdateRate = None,
    duration: Duration = None,
    amplitude: Amplitude = "pressure",
    solver: Solver = "gs-pat+wgs",
    slew: Slew = None,
    level_max: LevelMax = 1.0,
    sound_speed: SoundSpeed = 343.0,
    device: Annotated[
        str, typer.Option(metavar="DEVICE", help="cpu, or where frames of a pat16 are packed: cuda:0.")
    ] = "cpu",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write the wire bytes that `palpate play` would send, so that playing them costs the host only copying."""
    options = {name: value for name, value in locals().items() if name not in ("file", "out", "quiet", "json")}
    run_job(".play_commands", "run_prepare", file, out, options, json=json, quiet=quiet)
