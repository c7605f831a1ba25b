"""The command line of `palpate bench`."""

from typing import Annotated

import typer

from .output import Json, Quiet, run_job


def bench(
    objects: Annotated[
        str, typer.Option(metavar="NAME,...", help="Built in, or blob-N of about N triangles (blob-5000).")
    ] = "cube,tube,sphere,blob-100k",
    strategy: Annotated[str, typer.Option(metavar="NAME,...", help="oc, cc, or both.")] = "oc,cc",
    device: Annotated[str, typer.Option(metavar="DEVICE", help="cpu, cuda:0, ...")] = "cpu",
    poses: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=10**8, help="By default half a second of them, on a GPU 4,000,000."),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Time contours of random palms on this machine: one row for each object and strategy."""
    run_job("..bench.speed", "run_bench", objects, strategy, device, poses, json=json, quiet=quiet)
