"""The commands of plans, `palpate sweep PLAN.toml` and `palpate study STUDY.toml`, as their options."""

# ruff: noqa: RUF009  # option(), switch() and argument() give fields of dataclasses

from dataclasses import dataclass
from pathlib import Path

from ...datasets.errors import name_nothing
from ..errors import PlanError, StudyError
from .inputs import require_extra, require_file, require_store
from .option_fields import Command, NamedOptions, argument, option, switch
from .shared_options import (
    AllowCodeOptions,
    OpenedArrayOptions,
    OverwriteOptions,
    PageOptions,
    SourceOptions,
    TransportOptions,
)

IN_FOLDER = "pip install -e '.[{}]' in palpate's folder"


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SweepCommand(NamedOptions, OverwriteOptions, AllowCodeOptions):
    """Make every combination that a plan names, except those that are there already, and a table of the results."""

    job = "..sweeps.command:run_sweep_command"
    plans: list[Path] = argument("PLAN.toml", "Plans; of several, the union of their recipes.")
    store: Path | None = option("FOLDER", "Of the results, by default beside the plan: PLAN.sweep.")
    overrides: list[str] | None = option(
        "KEY=VALUE", "Take this value (TOML) instead of the plan's. May be repeated.", None, "--set"
    )
    dry_run: bool = switch("Make nothing; print recipes, poses, bytes and time to expect.", "--dry-run")
    yes: bool = switch("Go ahead although there are more than 10^12 poses, or more bytes than the disk has.", "--yes")
    same_results: bool = switch(
        "Take over results of the store's latest other code version: you know that the change moved none.",
        "--same-results",
    )
    device: str | None = option(
        "DEVICE", "Instead of the plan's: cpu, cuda:0, several with commas between, cuda (all GPUs), auto."
    )
    workers: str = option("N", "Workers on each device; auto: one for each core of the CPU, four on a GPU.", "auto")
    shard: str | None = option(
        "I/N", "Make only part I of N, in a store of its own; palpate sweep merge puts the parts together."
    )
    unit_timeout: float = option(
        "SECONDS", "End a unit of work that takes longer; one is planned to take 2 to 3 s. 0: never.", 1800.0
    )
    worker_memory: int | None = option(
        "MB", "Memory that a process may allocate; by default an equal share of the machine's; 0: no limit."
    )
    scheduler: str | None = option(
        "ADDRESS", "A Dask cluster: the address of its scheduler, tcp://HOST:PORT, or its scheduler file (.json)."
    )
    baseline: Path | None = option("OLD", "Store or table to compare with: exit 1 if anything moved.")
    update_baseline: bool = switch(
        "Write --baseline's file (.csv or .parquet) after the run, and exit 0 though values moved.",
        "--update-baseline",
    )
    tolerances: list[str] | None = option(
        "T", "[COLUMN=]NUMBER[abs]: relative, or absolute; by default 1e-6. May be repeated.", None, "--tolerance"
    )
    tables: list[Path] | None = option(
        "OUT", "The table once more: .csv or .parquet. May be repeated.", None, "--table"
    )
    figure: bool = switch("Draw the store's summary.png.", "--figure/--no-figure", default=True)
    summary: Path | None = option(
        "FILE.md", "Append counts, failures and what moved to FILE.md as Markdown, for the step summary of CI."
    )

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        for plan in self.plans:
            require_file(plan, "a plan is a TOML file")
        if self.scheduler is not None:
            require_extra("distributed", PlanError("--scheduler needs Dask: " + IN_FOLDER.format("cluster")))
        for table in self.tables or ():
            if table.suffix.lower() == ".parquet":
                require_extra(
                    "pyarrow", PlanError(f"--table {table}: Parquet needs PyArrow: " + IN_FOLDER.format("parquet"))
                )


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StoreCommand(Command):
    """What all commands about a store take."""

    given = ("store",)

    store: Path = argument("STORE", "Folder of results that `palpate sweep` made.")

    def judge(self) -> None:
        """Refuse a folder that is no store."""
        require_store(self.store)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SweepStatusCommand(StoreCommand):
    """Show what a store holds: results by code version and group, bytes, the last run, who works in it now."""

    job = "..sweeps.upkeep:show_status"


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SweepFailuresCommand(StoreCommand):
    """Show which recipes could not be made, and why."""

    job = "..sweeps.upkeep:show_failures"


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SweepPruneCommand(StoreCommand):
    """Remove results of other code versions, and files that only these name."""

    job = "..sweeps.upkeep:prune_store"
    given = ("store", "dry_run")
    dry_run: bool = switch("Remove nothing; print what would be removed.", "--dry-run")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class SweepMergeCommand(Command):
    """Take over what other stores hold, such as those of the machines that each made a shard."""

    job = "..sweeps.upkeep:merge_stores"
    given = ("store", "others")
    store: Path = argument("STORE", "Takes the results; made if it is not there.")
    others: list[Path] = argument("OTHER", "Stores to read; they stay as they are.")

    def judge(self) -> None:
        """Refuse folders that are no stores."""
        for store in self.others:
            require_store(store)


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StudyCommand(NamedOptions, SourceOptions, OpenedArrayOptions, TransportOptions, PageOptions, AllowCodeOptions):
    """Run one participant of a study; each answer is on disk before the next is asked, and the array is off at the end.

    The participant's page opens in the browser, and the experimenter's beside it.
    """

    job = "..study.command:run_study"
    plan: Path = argument("STUDY.toml", "The study's plan.")
    participant: str | None = option("CODE", "By default the plan's first code that nobody has had yet.")
    data: Path | None = option("FOLDER", "Of the answers, by default beside the plan: STUDY.data.")
    resume: bool = switch("Go on where this participant stopped.", "--resume")
    dry_run: bool = switch("Judge the plan and print its run sheet; nothing is opened.", "--dry-run")
    events: int | None = option("PORT", "Send events as lines of JSON to programs that connect to this port.")
    events_host: str = option("HOST", "Of --events; 0.0.0.0 lets other machines connect.", "127.0.0.1")
    lsl: bool = switch("Send events over LSL, too; needs palpate[lsl].", "--lsl")

    def judge(self) -> None:
        """Raise what makes the request impossible."""
        require_file(self.plan, "a plan is a TOML file")


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StudyAnalyseCommand(NamedOptions, OverwriteOptions):
    """Write a study's report (HTML, Markdown), its tables (CSV) and pictures; needs palpate[study]."""

    job = "..study.analysis.command:analyse_study"
    study: Path = argument("STUDY", "The study's plan, STUDY.toml, or the folder of its data.")
    data: Path | None = option("FOLDER", "Of the answers, by default beside the plan: STUDY.data.")
    output: Path | None = option("FOLDER", "Of report, tables and pictures, by default `analysis` in that of the data.")
    power: bool = switch("Needs no answers: how many participants find an effect, by simulated studies.", "--power")
    measure: str | None = option("NAME", "Of --power: p_cc, or a scale; by default the plan's first.")
    mean: float | None = option(
        "VALUE", "Of --power: the proportion or points that are expected of participants (not of the opposite ones)."
    )
    mean_other: float | None = option("VALUE", "Of --power: at the last level of --factor; left out: against chance.")
    factor: str | None = option("NAME", "Of --power: whose first and last level differ.")
    spread: float | None = option(
        "SD", "Of --power: between participants, of a proportion's logit, or in points; by default 1."
    )
    opposite: float | None = option("SHARE", "Of --power: participants who answer the other way, below 0.5.")
    noise: float | None = option("SD", "Of --power: of one answer on a scale [point], by default 1.")
    tables: int = option("COUNT", "Of --power: simulated studies of each number of participants.", 1000)
    seed: int = option("NUMBER", "Of --power: seed of the simulated studies.", 1)

    def judge(self) -> None:
        """Refuse a study that is not there, and to begin without what analyses it."""
        require_extra("statsmodels", StudyError('statsmodels is missing: pip install "palpate[study]"'))
        if not self.study.exists() and self.data is None and not self.study.with_suffix(".data").exists():
            data = self.study.with_suffix(".data") if self.study.suffix == ".toml" else self.study
            raise name_nothing(StudyError(f"{data} is not there: nor is {self.study}"))


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class StudyExampleCommand(Command):
    """Write the plan of a whole study into this folder, as NAME.toml, to be run or changed."""

    job = "..study.plan.study_plan:write_example"
    given = ("name",)
    name: str = argument("paper|pilot", "The founding paper's study, or its pilot.")
