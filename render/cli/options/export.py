"""The command line of `palpate export`."""

from pathlib import Path
from typing import Annotated

import typer

from .completion import complete_format
from .output import Json, Overwrite, Quiet, run_job
from .sampling import Duration, Sampling, Speed, UpdateRate


def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Contour file; for focal points also those of a sweep.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="OUT", help="File to write: .vtkhdf, .csv, .npz, .ptlist, .bin.")
    ],
    to: Annotated[
        str | None,
        typer.Option(
            metavar="FORMAT",
            help="vtkhdf, csv, npz (contours), ptlist, focal-points (.bin, .csv, .npz); by default as OUT ends.",
            autocompletion=complete_format,
        ),
    ] = None,
    poses: Annotated[
        str | None, typer.Option(metavar="FIRST:STOP", help="Only these poses, STOP not included; as 100:200 or 100:.")
    ] = None,
    seconds: Annotated[
        str | None, typer.Option(metavar="START:STOP", help="Only the poses of this time [s]; as 1.5:3 or :3.")
    ] = None,
    every: Annotated[int, typer.Option(metavar="N", min=1, help="Only every N-th of these poses.")] = 1,
    scene: Annotated[bool, typer.Option("--scene", help="Object and hand as further blocks (vtkhdf).")] = False,
    gzip: Annotated[int, typer.Option(metavar="0..9", min=0, max=9, help="Compress the file: 0 not, 9 most.")] = 0,
    sampling: Sampling = None,
    speed: Speed = None,
    update_rate: UpdateRate = None,
    duration: Duration = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write contours, or focal points sampled from them, as a file that other programs open, whole or by range."""
    options = {name: value for name, value in locals().items() if name not in ("file", "out", "quiet", "json")}
    run_job(".export_command", "run_export", file, out, options, json=json, quiet=quiet)
