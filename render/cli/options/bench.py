"""The command line of `palpate bench`."""

from typing import Annotated

import typer

from .output import Json, Quiet, run_job


def bench(
    objects: Annotated[
        str, typer.Option(metavar="NAME,...", help="Built in, or blob-N of about N triangles (blob-5000); or none.")
    ] = "cube,tube,dog,sphere,boulder,blob-100k,blob-1m",
    strategy: Annotated[str, typer.Option(metavar="NAME,...", help="oc, cc, or both.")] = "oc,cc",
    device: Annotated[
        str, typer.Option(metavar="DEVICE", help="Of palpate: cpu, cuda:0, ...; peers run on the CPU.")
    ] = "cpu",
    poses: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, max=10**8, help="Of palpate; by default half a second of them, on a GPU 4,000,000."
        ),
    ] = None,
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Repetitions, of which the median is taken.")] = 7,
    peers: Annotated[str, typer.Option(metavar="NAME,...", help="Libraries to compare with, or all, or none.")] = "all",
    motion: Annotated[str, typer.Option(metavar="KIND", help="Poses: random, or exploration.")] = "random",
    one_core: Annotated[
        bool, typer.Option("--one-core/--all-cores", help="Compare CPU time on one core, or wall time on all.")
    ] = True,
    curve: Annotated[bool, typer.Option("--curve", help="Cost against triangles and against poses, too.")] = False,
    first_use: Annotated[bool, typer.Option("--first-use", help="Time a first and a later `render`, too.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Time contours: palpate and installed libraries (pip install -e '.[bench]') in turns, beside a memory copy."""
    options = {
        "device": device,
        "objects": objects,
        "strategies": strategy,
        "poses": poses,
        "repeats": repeats,
        "peers": peers,
        "motion": motion,
        "one_core": one_core,
        "curve": curve,
        "first_use": first_use,
    }
    run_job("..bench.report", "run_bench", options, json=json, quiet=quiet)
