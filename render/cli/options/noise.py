"""The command line of `palpate noise`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Calibration
from .output import Json, Overwrite, Quiet, run_job
from .sampling import Duration, Sampling, Speed, UpdateRate


def noise(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="Contour files; levels are those less the first one's.")
    ],
    array: Array = "emulator",
    calibration: Calibration = None,
    sampling: Sampling = None,
    speed: Speed = None,
    update_rate: UpdateRate = None,
    duration: Duration = None,
    slew: Annotated[
        float | None,
        typer.Option(metavar="TURNS", help="Most that a phase changes in 25 us [turns]; 0.015625 quietens jumps."),
    ] = None,
    source: Annotated[
        str, typer.Option(metavar="KIND", help="Where noise comes from: beam (virtual sources), or transducers.")
    ] = "beam",
    sources: Annotated[int, typer.Option(metavar="N", help="Virtual sources of the beam.")] = 2000,
    pole: Annotated[float, typer.Option(metavar="HZ", help="Half the bandwidth of a transducer [Hz].")] = 1000.0,
    microphone: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Its place [m]; by default 7 cm up and 15 cm aside of the array."),
    ] = None,
    wav: Annotated[bool, typer.Option("--wav", help="Write FILE.wav beside each file, all with one gain.")] = False,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PICTURE", help="Draw spectra and levels: PNG, SVG or PDF.")
    ] = None,
    overwrite: Overwrite = False,
    device: Annotated[str, typer.Option(metavar="DEVICE", help="Where it is computed: cpu, cuda:0.")] = "cpu",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Predict how loud renderings are while they play: spectrum, bands, A-weighted level; and listen to them."""
    options = {name: value for name, value in locals().items() if name not in ("files", "quiet", "json")}
    run_job(".noise_command", "run_noise", files, options, json=json, quiet=quiet)
