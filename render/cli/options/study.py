"""The command line of studies: `palpate study STUDY.toml`."""

from pathlib import Path
from typing import Annotated

import typer

from . import object as objects
from .array import Array, Baud, Calibration, Emulate, Serial, Uncalibrated, Watchdog
from .command_group import RUN, PlanGroup, RunCommand
from .live import SOURCE_HELP
from .output import Json, Overwrite, Quiet, run_job
from .play import Transport
from .trust import AllowCode
from .view import NoBrowser, Port

EXAMPLES = (
    "Plans to begin with: palpate study example paper, palpate study example pilot. "
    "After the participants, or before them for the power: palpate study analyse STUDY.toml."
)
STUDY_HELP = "Run a study with people: one participant of a plan, from consent to the last answer."

study = typer.Typer(cls=PlanGroup, add_completion=False, rich_markup_mode=None)


@study.command(RUN, cls=RunCommand, hidden=True, epilog=EXAMPLES)
def run(
    plan: Annotated[Path, typer.Argument(metavar="STUDY.toml", help="The study's plan.")],
    participant: Annotated[
        str | None, typer.Option(metavar="CODE", help="By default the plan's first code that nobody has had yet.")
    ] = None,
    data: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Of the answers, by default beside the plan: STUDY.data.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where this participant stopped.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Judge the plan and print its run sheet; nothing is opened.")
    ] = False,
    source: Annotated[str, typer.Option(metavar="SOURCE", help=SOURCE_HELP)] = "exploration",
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
    lead: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="How far ahead focal points go out [s], by default 0.006: as long may the machine stall.",
        ),
    ] = None,
    transport: Transport = "auto",
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    realtime: Annotated[
        bool, typer.Option("--realtime/--no-realtime", help="Ask for real-time scheduling and locked memory.")
    ] = True,
    port: Port = None,
    no_browser: NoBrowser = False,
    events: Annotated[
        int | None,
        typer.Option(metavar="PORT", help="Send events as lines of JSON to programs that connect to this port."),
    ] = None,
    events_host: Annotated[
        str, typer.Option(metavar="HOST", help="Of --events; 0.0.0.0 lets other machines connect.")
    ] = "127.0.0.1",
    lsl: Annotated[bool, typer.Option("--lsl", help="Send events over LSL, too; needs palpate[lsl].")] = False,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run one participant of a study; each answer is on disk before the next is asked, and the array is off at the end.

    The participant's page opens in the browser, and the experimenter's beside it.
    """
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    run_job("..study.command", "run_study", options, json=json, quiet=quiet)


@study.command()
def analyse(
    study: Annotated[
        Path, typer.Argument(metavar="STUDY", help="The study's plan, STUDY.toml, or the folder of its data.")
    ],
    data: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Of the answers, by default beside the plan: STUDY.data.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", help="Of report, tables and pictures, by default `analysis` in that of the data."
        ),
    ] = None,
    overwrite: Overwrite = False,
    power: Annotated[
        bool,
        typer.Option("--power", help="Needs no answers: how many participants find an effect, by simulated studies."),
    ] = False,
    measure: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of --power: p_cc, or a scale; by default the plan's first.")
    ] = None,
    mean: Annotated[
        float | None,
        typer.Option(
            metavar="VALUE",
            help="Of --power: the proportion or points that are expected of participants (not of the opposite ones).",
        ),
    ] = None,
    mean_other: Annotated[
        float | None,
        typer.Option(metavar="VALUE", help="Of --power: at the last level of --factor; left out: against chance."),
    ] = None,
    factor: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of --power: whose first and last level differ.")
    ] = None,
    spread: Annotated[
        float | None,
        typer.Option(
            metavar="SD", help="Of --power: between participants, of a proportion's logit, or in points; by default 1."
        ),
    ] = None,
    opposite: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Of --power: participants who answer the other way, below 0.5."),
    ] = None,
    noise: Annotated[
        float | None, typer.Option(metavar="SD", help="Of --power: of one answer on a scale [point], by default 1.")
    ] = None,
    tables: Annotated[
        int, typer.Option(metavar="COUNT", help="Of --power: simulated studies of each number of participants.")
    ] = 1000,
    seed: Annotated[int, typer.Option(metavar="NUMBER", help="Of --power.")] = 1,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write a study's report (HTML, Markdown), its tables (CSV) and pictures; needs palpate[study]."""
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    run_job("..study.analysis.command", "analyse_study", options, json=json, quiet=quiet)


@study.command()
def example(
    name: Annotated[str, typer.Argument(metavar="paper|pilot", help="The founding paper's study, or its pilot.")],
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Write the plan of a whole study into this folder, as NAME.toml, to be run or changed."""
    run_job("..study.plan.study_plan", "write_example", name, json=json, quiet=quiet)
