"""The command line of sweeps: `palpate sweep PLAN.toml`, and `palpate sweep status STORE` and its like."""

from pathlib import Path
from typing import Annotated

import typer

from .command_group import RUN, PlanGroup, RunCommand
from .output import Json, Overwrite, Quiet, run_job
from .trust import AllowCode

DEVICE_HELP = "Instead of the plan's: cpu, cuda:0, several with commas between, cuda (all GPUs), auto."
SCHEDULER_HELP = "A Dask cluster: the address of its scheduler, tcp://HOST:PORT, or its scheduler file (.json)."
SHARD_HELP = "Make only part I of N, in a store of its own; palpate sweep merge puts the parts together."
TIMEOUT_HELP = "End a unit of work that takes longer; one is planned to take 2 to 3 s. 0: never."
MEMORY_HELP = "Memory that a process may allocate; by default an equal share of the machine's; 0: no limit."
SAME_HELP = "Take over results of the store's latest other code version: you know that the change moved none."
TABLE_HELP = "The table once more: .csv or .parquet. May be repeated."
UPDATE_HELP = "Write --baseline's file (.csv or .parquet) after the run, and exit 0 though values moved."
SUMMARY_HELP = "Append counts, failures and what moved to FILE.md as Markdown, for the step summary of CI."
TOLERANCE_HELP = "[COLUMN=]NUMBER[abs]: relative, or absolute; by default 1e-6. May be repeated."

STORES = "Of a store that is there: palpate sweep status, failures, prune, merge; each has --help."
UPKEEP = "..sweeps.upkeep"
PLAN_KEYS = (
    "scale", "up", "fit", "rotate", "at", "kind", "level", "label", "inside", "spacing", "unit", "bounds", "solid",
    "weld", "fill_holes", "simplify", "palm", "duration", "rate", "seed", "model", "explorer", "facing", "workspace",
    "side", "alignment", "interpolate", "step", "flush", "speed", "update_rate", "solver", "amplitude", "slew",
    "sound_speed", "level_max",
)  # fmt: skip
"""Keys of a plan that are arguments in Python (those of the plan itself take long to import; a test compares them)."""


class SweepGroup(PlanGroup):
    """Commands about stores; any other first word is a plan, or an option, of `run`."""

    plan_keys = PLAN_KEYS


sweep = typer.Typer(cls=SweepGroup, add_completion=False, rich_markup_mode=None)

Store = Annotated[Path, typer.Argument(metavar="STORE", help="Folder of results that `palpate sweep` made.")]


@sweep.command(RUN, cls=RunCommand, hidden=True, epilog=STORES)
def run(
    plans: Annotated[
        list[Path], typer.Argument(metavar="PLAN.toml", help="Plans; of several, the union of their recipes.")
    ],
    store: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Of the results, by default beside the plan: PLAN.sweep.")
    ] = None,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Instead of the plan's value (TOML).")
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only tell recipes, poses, bytes and time to expect.")
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", help="Also more than 10^12 poses, or more bytes than the disk has.")
    ] = False,
    same_results: Annotated[bool, typer.Option("--same-results", help=SAME_HELP)] = False,
    device: Annotated[str | None, typer.Option(metavar="DEVICE", help=DEVICE_HELP)] = None,
    workers: Annotated[
        str, typer.Option(metavar="N", help="On each device; auto: one for each core of the CPU, four on a GPU.")
    ] = "auto",
    shard: Annotated[str | None, typer.Option(metavar="I/N", help=SHARD_HELP)] = None,
    unit_timeout: Annotated[float, typer.Option(metavar="SECONDS", help=TIMEOUT_HELP)] = 1800.0,
    worker_memory: Annotated[int | None, typer.Option(metavar="MB", help=MEMORY_HELP)] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help=SCHEDULER_HELP)] = None,
    baseline: Annotated[
        Path | None, typer.Option(metavar="OLD", help="Store or table to compare with: exit 1 if anything moved.")
    ] = None,
    update_baseline: Annotated[bool, typer.Option("--update-baseline", help=UPDATE_HELP)] = False,
    tolerances: Annotated[list[str] | None, typer.Option("--tolerance", metavar="T", help=TOLERANCE_HELP)] = None,
    tables: Annotated[list[Path] | None, typer.Option("--table", metavar="OUT", help=TABLE_HELP)] = None,
    overwrite: Overwrite = False,
    figure: Annotated[bool, typer.Option("--figure/--no-figure", help="Draw the store's summary.png.")] = True,
    summary: Annotated[Path | None, typer.Option(metavar="FILE.md", help=SUMMARY_HELP)] = None,
    allow_code: AllowCode = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make every combination that a plan names, what is there already left out, and a table of what came of it."""
    options = {name: value for name, value in locals().items() if name not in ("quiet", "json")}
    run_job("..sweeps.command", "run_sweep_command", options, json=json, quiet=quiet)


SWEEP_HELP = run.__doc__


@sweep.command()
def status(store: Store, quiet: Quiet = False, json: Json = False) -> None:
    """Show what a store holds: results by code version and group, bytes, the last run, who works in it now."""
    run_job(UPKEEP, "show_status", store, json=json, quiet=quiet)


@sweep.command()
def failures(store: Store, quiet: Quiet = False, json: Json = False) -> None:
    """Show which recipes could not be made, and why."""
    run_job(UPKEEP, "show_failures", store, json=json, quiet=quiet)


@sweep.command()
def prune(
    store: Store,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only tell what would be removed.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Remove results of other code versions, and files that only these name."""
    run_job(UPKEEP, "prune_store", store, is_dry=dry_run, json=json, quiet=quiet)


@sweep.command()
def merge(
    store: Annotated[Path, typer.Argument(metavar="STORE", help="Takes the results; made if it is not there.")],
    others: Annotated[list[Path], typer.Argument(metavar="OTHER", help="Stores to read; they stay as they are.")],
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Take over what other stores hold, such as those of the machines that each made a shard."""
    run_job(UPKEEP, "merge_stores", store, others, json=json, quiet=quiet)
