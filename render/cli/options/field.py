"""The command line of `palpate field`."""

from pathlib import Path
from typing import Annotated

import typer

from .array import Array, Calibration
from .figure import FontSize, PictureWidth
from .output import Json, Overwrite, Quiet, run_job
from .sampling import Sampling, Speed, UpdateRate


def field(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Contour files; several are drawn at one scale.")],
    at: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Instant of the motion that is shown [s].")
    ] = None,
    pose: Annotated[
        int | None, typer.Option(metavar="N", help="Number of the pose that is shown; by default of longest contours.")
    ] = None,
    where: Annotated[
        str, typer.Option(metavar="PLACE", help="palm (the hand's patches), plane (parallel to the array), or volume.")
    ] = "palm",
    average: Annotated[
        str,
        typer.Option(
            metavar="TIME",
            help="cycle: the pose drawn once around; pose: what is played while it is shown; instant: one frame.",
        ),
    ] = "cycle",
    size: Annotated[
        float | None, typer.Option(metavar="METRES", help="Side of a plane or volume [m], by default 0.2, 0.12.")
    ] = None,
    spacing: Annotated[
        float | None, typer.Option(metavar="METRES", help="Between points [m], by default 0.001, in a volume 0.004.")
    ] = None,
    centre: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="X Y Z", help="Of a plane or volume [m], by default the middle of the palm."),
    ] = None,
    array: Array = "emulator",
    calibration: Calibration = None,
    sampling: Sampling = None,
    speed: Speed = None,
    update_rate: UpdateRate = None,
    resonance: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Half the bandwidth of resonant transducers [Hz], as 1000; else they follow."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE", help="Picture (PNG, SVG, PDF), or numbers (.npz).")
    ] = None,
    width: PictureWidth = None,
    font_size: FontSize = None,
    overwrite: Overwrite = False,
    device: Annotated[str, typer.Option(metavar="DEVICE", help="Where it is computed: cpu, cuda:0.")] = "cpu",
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Predict how hard ultrasound presses on the palm, in a plane or a volume: the print of a rendering."""
    options = {name: value for name, value in locals().items() if name not in ("files", "quiet", "json")}
    run_job(".field_command", "run_field", files, options, json=json, quiet=quiet)
