"""The command line of `palpate live`."""

from pathlib import Path
from typing import Annotated

import typer

from . import object as objects
from .array import Array, Baud, Calibration, Emulate, Serial, Uncalibrated, Watchdog
from .completion import complete_object, complete_sampling, complete_strategy
from .output import Json, Overwrite, Quiet, run_job
from .play import DutyMax, OnTimeMax, Transport
from .sampling import Amplitude, LevelMax, Slew, Solver, SoundSpeed, UpdateRate
from .trust import AllowCode
from .view import NoBrowser, Port

SOURCE_HELP = (
    "Where poses come from: exploration, a recording or motion file, udp[:HOST:PORT], ultraleap[:ws://...], or "
    "MODULE:NAME of a source of your own."
)


def live(
    solids: Annotated[
        list[str],
        typer.Argument(
            metavar="OBJECT...", help="Objects, of which key o chooses the next.", autocompletion=complete_object
        ),
    ],
    strategy: Annotated[
        list[str],
        typer.Option(
            metavar="NAME|FILE", help="Intersection strategy; several for key s.", autocompletion=complete_strategy
        ),
    ] = ["cc"],  # noqa: B006  # typer copies it
    sampling: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME|FILE",
            help="How contours become focal points, by default stm; several for key m.",
            autocompletion=complete_sampling,
        ),
    ] = None,
    source: Annotated[str, typer.Option(metavar="SOURCE", help=SOURCE_HELP)] = "exploration",
    hand: objects.HandKind = "palm",
    palm: objects.PalmSize = None,
    side: Annotated[
        str | None, typer.Option(metavar="left|right", help="Which hand of the source; by default whichever is seen.")
    ] = None,
    alignment: objects.Alignment = None,
    prediction: Annotated[
        float, typer.Option(metavar="SECONDS", help="Predict poses this far ahead [s], 0.02 for most trackers.")
    ] = 0.0,
    smoothing: Annotated[
        float, typer.Option(metavar="HZ", help="Low-pass of poses [Hz]; it delays them by about 0.2 / HZ.")
    ] = 0.0,
    array: Array = "emulator",
    serial: Serial = None,
    calibration: Calibration = None,
    baud: Baud = None,
    emulate: Emulate = False,
    update_rate: UpdateRate = None,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="End after this time [s]; else key q or Ctrl-C ends it.")
    ] = None,
    lead: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="How far ahead focal points go out [s], by default 0.006: as long may the machine stall.",
        ),
    ] = None,
    intensity: Annotated[float, typer.Option(metavar="SHARE", help="Of all focal points, 0..1; keys + and -.")] = 1.0,
    record: Annotated[
        Path | None, typer.Option(metavar="OUT.h5", help="Contour file of all that was drawn, with its latency.")
    ] = None,
    finish: Annotated[
        bool, typer.Option("--finish", help="Make the file --record of a run that was killed, and run nothing.")
    ] = False,
    amplitude: Amplitude = "pressure",
    solver: Solver = "gs-pat+wgs",
    slew: Slew = None,
    level_max: LevelMax = 1.0,
    on_time_max: OnTimeMax = 120.0,
    duty_max: DutyMax = 0.5,
    sound_speed: SoundSpeed = 343.0,
    scale: objects.Scale = 1.0,
    up: objects.Up = "z",
    fit: objects.Fit = None,
    rotate: objects.Rotate = (0.0, 0.0, 0.0),
    at: objects.At = None,
    transport: Transport = "auto",
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    realtime: Annotated[
        bool, typer.Option("--realtime/--no-realtime", help="Ask for real-time scheduling and locked memory.")
    ] = True,
    view: Annotated[
        bool, typer.Option("--view", help="Show the hand that moves now, and what is drawn on it, in the browser.")
    ] = False,
    port: Port = None,
    no_browser: NoBrowser = False,
    allow_code: AllowCode = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Render an object on a hand that moves now; the array is off on every way out.

    Keys, in a terminal: o, s, m the next object, strategy, sampling; + and - more and less intensity; space none, or
    all again; q ends.
    """
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    run_job(".live_command", "run_live", options, json=json, quiet=quiet)
