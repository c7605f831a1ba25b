"""The command line of `palpate reproduce`."""

from pathlib import Path
from typing import Annotated

import typer

from .output import Json, Overwrite, Quiet, run_job


def reproduce(
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FOLDER", help="Where the report goes; made if it is missing.")
    ] = Path("palpate-reproduction"),
    explorers: Annotated[int, typer.Option(metavar="N", help="How many explore each object.")] = 18,
    repetitions: Annotated[
        int,
        typer.Option(
            metavar="N", help="Explorations of 7 s in each of the two blocks that an explorer has with an object."
        ),
    ] = 10,
    palm: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="WIDTH LENGTH", help="Size of the palm [m], by default 0.085 0.085."),
    ] = None,
    recording: Annotated[
        float, typer.Option(metavar="SECONDS", help="Of each of ten recordings of noise [s]; 0: no noise.")
    ] = 30.0,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make the founding paper's evaluation again: its figures and numbers beside palpate's, as HTML and JSON."""
    run_job(
        "..reproduction.command",
        "run_reproduce",
        out,
        explorers,
        repetitions,
        palm,
        recording,
        overwrite,
        json=json,
        quiet=quiet,
    )
