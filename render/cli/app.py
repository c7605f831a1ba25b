"""The command line: every command has --help, results as JSON, and exit codes 0 done, 1 failed, 2 misuse."""

import os
import sys

try:
    import typer

    from ..terminal import console
    from . import array_options as arrays
    from . import contour_options as contours
    from . import plan_options as plans
    from .command_group import RUN, MainGroup, PlanGroup, RunCommand, SweepGroup
    from .option_fields import add_command
except KeyboardInterrupt:  # nothing has begun
    sys.exit("error: interrupted")

app = typer.Typer(
    name="palpate",
    cls=MainGroup,
    epilog="palpate --version prints the version; palpate --install-completion has your shell complete names.",
    help="Objects and hand poses in, contours out, focal points on skin (ultrasound mid-air haptics).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
    rich_markup_mode=None,  # it would take [m] for markup and leave it out
)
sweep = typer.Typer(cls=SweepGroup, add_completion=False, rich_markup_mode=None)
study = typer.Typer(cls=PlanGroup, add_completion=False, rich_markup_mode=None)
STORES = "Of a store that is there: palpate sweep status, failures, prune, merge; each has --help."
EXAMPLES = (
    "Plans to begin with: palpate study example paper, palpate study example pilot. "
    "After the participants, or before them for the power: palpate study analyse STUDY.toml."
)

add_command(app, contours.DemoCommand, "demo", "Run the main job in one go, into palpate-demo/.")
add_command(app, contours.RenderCommand, "render", "Render contours of an object on a moving hand.")
add_command(app, contours.VoxeliseCommand, "voxelise", "Turn a mesh, also an open one, into voxels.")
app.add_typer(
    sweep,
    name="sweep",
    help=plans.SweepCommand.__doc__,
    short_help="Make every combination that a plan names, as a table.",
)
app.add_typer(
    study,
    name="study",
    help="Run a study with people: one participant of a plan, from consent to the last answer.",
    short_help="Run a study with people, from a plan.",
)
add_command(app, contours.TrustCommand, "trust", "Permit code that files name, as it is now.")
add_command(
    app, contours.StrategiesCommand, "strategies", "List or draw intersection strategies, or print one as JSON."
)
add_command(app, contours.InfoCommand, "info", "Show what a file holds, or what is wrong with a mesh.")
add_command(app, contours.CheckCommand, "check", "Check that a file or store is whole (exit 1 if not).")
add_command(app, contours.FigureCommand, "figure", "Draw contours on hand and object.")
add_command(app, contours.ViewCommand, "view", "Show renderings in the browser.")
add_command(app, arrays.PlayCommand, "play", "Sample a contour file and stream it to an array.")
add_command(app, arrays.LiveCommand, "live", "Render an object on a hand that moves now.")
add_command(app, arrays.PrepareCommand, "prepare", "Write wire bytes, which play only copies.")
add_command(app, contours.ExportCommand, "export", "Write files that other programs open.")
add_command(app, arrays.SamplingCommand, "sampling", "List sampling presets, or print one as JSON.")
add_command(app, arrays.DevicesCommand, "devices", "List arrays, and why one cannot be opened.")
add_command(app, arrays.SelftestCommand, "selftest", "Play stimuli that a hand should feel.")
add_command(app, contours.NoiseCommand, "noise", "Predict how loud renderings are, and listen.")
add_command(app, contours.FieldCommand, "field", "Predict the pressure on the palm, or in a plane.")
add_command(app, arrays.BenchCommand, "bench", "Time contours of random palms.")
add_command(app, arrays.ReproduceCommand, "reproduce", "Make the founding paper's evaluation again.")
add_command(sweep, plans.SweepCommand, RUN, cls=RunCommand, hidden=True, epilog=STORES)
add_command(sweep, plans.SweepStatusCommand, "status")
add_command(sweep, plans.SweepFailuresCommand, "failures")
add_command(sweep, plans.SweepPruneCommand, "prune")
add_command(sweep, plans.SweepMergeCommand, "merge")
add_command(study, plans.StudyCommand, RUN, cls=RunCommand, hidden=True, epilog=EXAMPLES)
add_command(study, plans.StudyAnalyseCommand, "analyse")
add_command(study, plans.StudyExampleCommand, "example")


def exit_code() -> int:
    """Run the command that the process was started with; its exit code."""
    if sys.stdout is not None and not sys.stdout.isatty():
        os.environ.setdefault("COLUMNS", "120")  # tables and help in pipes and logs
    try:
        return console.parsed(app)
    except KeyboardInterrupt:  # before a command runs, or after: it tells of its own
        return console.fail("interrupted", console.FAILED, False)


def main() -> None:
    """Entry point of the console script; it does not return."""
    console.end_process(exit_code())
