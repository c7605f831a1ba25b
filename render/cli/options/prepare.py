"""The command line of `palpate prepare`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Baud, Calibration
from .output import Json, Overwrite, Quiet, run_job
from .sampling import Amplitude, Duration, LevelMax, Sampling, Slew, Solver, SoundSpeed, Speed, UpdateRate


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
