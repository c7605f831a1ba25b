"""The command line of `palpate view`."""

from pathlib import Path
from typing import Annotated

import typer

from . import object as objects
from .array import Array, Calibration
from .output import Json, Overwrite, Quiet, run_job
from .trust import AllowCode

Port = Annotated[
    int | None,
    typer.Option(metavar="N", help="Port of 127.0.0.1 for the page; by default the first free one from 8080 on."),
]
NoBrowser = Annotated[bool, typer.Option("--no-browser", help="Print the page's address only, and open nothing.")]


def view(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="A contour file, two to compare, the store of a sweep; or OBJECT MOTION, a preview."
        ),
    ],
    port: Port = None,
    no_browser: NoBrowser = False,
    array: Array = "emulator",
    calibration: Calibration = None,
    allow_code: AllowCode = False,
    export: Annotated[
        Path | None, typer.Option(metavar="PAGE.html", help="Write one self-contained page instead, and end.")
    ] = None,
    poses: Annotated[
        str | None, typer.Option(metavar="FIRST:STOP", help="Only these poses, STOP not included; as 100:200 or 100:.")
    ] = None,
    every: Annotated[int | None, typer.Option(metavar="N", help="Only every N-th of these poses.")] = None,
    limit: Annotated[
        float | None, typer.Option(metavar="MB", help="Largest page that is written, by default 20.")
    ] = None,
    pressure: Annotated[
        bool, typer.Option("--pressure", help="Predict the pressure on the skin for the page; half a second a pose.")
    ] = False,
    scale: objects.Scale = 1.0,
    up: objects.Up = "z",
    fit: objects.Fit = None,
    rotate: objects.Rotate = (0.0, 0.0, 0.0),
    at: objects.At = None,
    alignment: objects.Alignment = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show renderings in the browser: object, hand, array, contours and the focal point in slow motion.

    The page is served to this machine only, until Ctrl-C. OBJECT MOTION, as `render` takes them, is a preview: whether
    the hand meets the object, with closed contours, before anything is rendered into a file.
    """
    placement = {"scale": scale, "up": up, "fit": fit, "rotate": rotate, "at": at}
    options = {
        "port": port, "no_browser": no_browser, "array": array, "calibration": calibration, "allow_code": allow_code,
        "export": export, "poses": poses, "every": every, "limit": limit, "pressure": pressure, "overwrite": overwrite,
        "placement": placement, "alignment": alignment,
    }  # fmt: skip
    run_job(".view_command", "run_view", files, options, json=json, quiet=quiet)
