"""The command line: every command has --help, results as JSON, and exit codes 0 done, 1 failed, 2 misuse."""

import os
import sys
from pathlib import Path
from typing import Annotated

try:
    import typer

    from ..terminal import console
    from .options import object as objects
    from .options.array import Clock
    from .options.bench import bench
    from .options.command_group import MainGroup
    from .options.completion import (
        complete_motion,
        complete_object,
        complete_sampling,
        complete_strategy,
    )
    from .options.export import export
    from .options.field import field
    from .options.figure import figure
    from .options.live import live
    from .options.noise import noise
    from .options.output import Json, Overwrite, Quiet, run_job
    from .options.play import play, prepare
    from .options.reproduce import reproduce
    from .options.selftest import selftest
    from .options.study import STUDY_HELP, study
    from .options.sweep import SWEEP_HELP, sweep
    from .options.trust import AllowCode, trust
    from .options.view import view
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

OBJECT_HELP = (
    "Mesh (STL, OBJ, PLY, GLB), volume (.npy .npz .nrrd .nii .nvdb), expression (.json), function (module:name), "
    "or built in: cube, sphere, tube, dog, dog-detailed, rock, boulder."
)
MOTION_HELP = (
    "CSV or HDF5 of poses, a recording of a hand (Leap, OpenXR, WebXR, MediaPipe), or the word exploration for a "
    "synthetic one."
)
INTERPOLATE_HELP = (
    "Insert poses until every contour point has one of the next pose within this; 0.0007 (speed / rate) leaves no hops."
)
FLUSH_HELP = (
    "What is so near to a patch's plane or side lies on it; the default (float32's rounding) fits nearly always."
)
DEVICE_HELP = "cpu, cuda:0, several with commas between, cuda (all GPUs), or auto: the first GPU if there is one."
WORKERS_HELP = "Workers on each device; auto: one for each core of the CPU, two on a GPU. The file is the same."
MEMORY_HELP = (
    "Budget of all workers [MB]; by default 200 a CPU worker, 1000 a GPU's, at least 512. Saving holds 256 more."
)
KEPT_HELP = "Contour file, prepared frames, or focal points or drives of a sweep."


@app.command(short_help="Run the main job in one go, into palpate-demo/.")
def demo(
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FOLDER", help="Where the files go; made if it is missing.")
    ] = Path("palpate-demo"),
    clock: Clock = "monotonic",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Run the main job: explore the tube for 30 s, render OC and CC, play CC on the emulated array, draw a picture."""
    run_job(".demo_command", "run_demo", out, clock, overwrite, json=json, quiet=quiet)


@app.command(short_help="Render contours of an object on a moving hand.")
def render(
    source: Annotated[str, typer.Argument(metavar="OBJECT", help=OBJECT_HELP, autocompletion=complete_object)],
    motion: Annotated[str, typer.Argument(metavar="MOTION", help=MOTION_HELP, autocompletion=complete_motion)],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT.h5", help="Contour file to write.")],
    strategy: Annotated[
        str,
        typer.Option(
            metavar="NAME|FILE",
            help="By name (palpate strategies lists them), or a JSON file.",
            autocompletion=complete_strategy,
        ),
    ] = "cc",
    step: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Of the grid on the skin, if one is needed; by default a quarter focus."),
    ] = None,
    flush: Annotated[float | None, typer.Option(metavar="METRES", help=FLUSH_HELP)] = None,
    hand: objects.HandKind = "palm",
    palm: objects.PalmSize = None,
    scale: objects.Scale = 1.0,
    up: objects.Up = "z",
    fit: objects.Fit = None,
    rotate: objects.Rotate = (0.0, 0.0, 0.0),
    at: objects.At = None,
    kind: objects.Kind = None,
    level: objects.Level = None,
    label: objects.Label = None,
    inside: objects.Inside = None,
    spacing: objects.Spacing = None,
    unit: objects.Unit = None,
    bounds: objects.Bounds = None,
    solid: objects.SolidRule = None,
    weld: objects.Weld = None,
    fill_holes: objects.FillHoles = None,
    simplify: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Simplify a mesh within this distance; 0: a quarter of the focal width."),
    ] = None,
    object_motion: Annotated[
        str | None, typer.Option(metavar="FILE", help="CSV or HDF5 of poses: where the object's middle is, when.")
    ] = None,
    side: Annotated[
        str | None, typer.Option(metavar="SIDE", help="Which hand of a recording: left, right, or its id.")
    ] = None,
    alignment: objects.Alignment = None,
    duration: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Of a synthetic exploration [s], by default 30.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(metavar="HZ", help="Poses a second of an exploration [Hz], by default 90.")
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Seed of an exploration, by default 1.")] = None,
    model: objects.Model = None,
    explorer: objects.Explorer = None,
    facing: objects.Facing = None,
    workspace: objects.Workspace = None,
    interpolate: Annotated[float | None, typer.Option(metavar="METRES", help=INTERPOLATE_HELP)] = None,
    device: Annotated[str, typer.Option(metavar="DEVICE", help=DEVICE_HELP)] = "auto",
    workers: Annotated[str, typer.Option(metavar="N", help=WORKERS_HELP)] = "auto",
    memory: Annotated[int | None, typer.Option(metavar="MB", min=5, help=MEMORY_HELP)] = None,
    gzip: Annotated[int, typer.Option(metavar="0..9", min=0, max=9, help="Compress the file: 0 not, 9 most.")] = 0,
    allow_code: AllowCode = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted rendering.")] = False,
    overwrite: Overwrite = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if no pose has a contour.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Render the contours of an object on a moving hand into a contour file."""
    options = {
        "source": source,
        "motion": motion,
        "out": out,
        "strategy": strategy,
        "step": step,
        "flush": flush,
        "hand": hand,
        "palm": palm,
        "volume": {"kind": kind, "level": level, "label": label, "inside": inside, "spacing": spacing, "unit": unit},
        "mesh": {"solid": solid, "weld": weld, "fill_holes": fill_holes},
        "bounds": bounds,
        "simplify": simplify,
        "object_motion": object_motion,
        "side": side,
        "alignment": alignment,
        "placement": {"scale": scale, "up": up, "fit": fit, "rotate": rotate, "at": at},
        "exploration": {"duration": duration, "rate": rate, "seed": seed}
        | {"model": model, "explorer": explorer, "facing": facing, "workspace": workspace},
        "interpolate": interpolate,
        "device": device,
        "workers": workers,
        "memory": None if memory is None else memory * 10**6,
        "gzip": gzip,
        "allow_code": allow_code,
        "resume": resume,
        "overwrite": overwrite,
        "strict": strict,
    }
    run_job(".file_commands", "run_render", options, json=json, quiet=quiet)


@app.command(short_help="Turn a mesh, also an open one, into voxels.")
def voxelise(
    mesh: Annotated[
        str,
        typer.Argument(metavar="MESH", help="Mesh file, or built in; open ones too.", autocompletion=complete_object),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT.npz", help="Or .npy, .nrrd, .nii, .nvdb.")],
    spacing: Annotated[float, typer.Option(metavar="METRES", help="Between voxels.")],
    kind: Annotated[str, typer.Option(metavar="KIND", help="distance (signed), or occupancy.")] = "distance",
    sign: Annotated[
        str,
        typer.Option(metavar="RULE", help="Inside by crossings, parity, winding; auto: winding if open."),
    ] = "auto",
    scale: objects.Scale = 1.0,
    up: objects.Up = "z",
    fit: objects.Fit = None,
    rotate: objects.Rotate = (0.0, 0.0, 0.0),
    at: objects.At = None,
    device: Annotated[
        str, typer.Option(metavar="DEVICE", help="cpu, cuda:0, or auto: the first GPU if there is one.")
    ] = "auto",
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Turn a mesh into voxels: the way out for open meshes."""
    placement = {"scale": scale, "up": up, "fit": fit, "rotate": rotate, "at": at}
    run_job(
        ".voxelise_command",
        "run_voxelise",
        mesh,
        out,
        spacing,
        kind,
        sign,
        placement,
        device,
        overwrite,
        json=json,
        quiet=quiet,
    )


app.add_typer(sweep, name="sweep", help=SWEEP_HELP, short_help="Make every combination that a plan names, as a table.")
app.add_typer(study, name="study", help=STUDY_HELP, short_help="Run a study with people, from a plan.")
app.command(short_help="Permit code that files name, as it is now.")(trust)


@app.command(short_help="List or draw intersection strategies, or print one as JSON.")
def strategies(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME|FILE]", help="Strategies, or JSON files; several with -o.", autocompletion=complete_strategy
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PICTURE", help="Draw them, or all: PNG, SVG, PDF.")
    ] = None,
    allow_code: AllowCode = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List strategies and their stages, print one as the JSON that --strategy takes, or draw some side by side."""
    options = {"allow_code": allow_code, "overwrite": overwrite}
    run_job(".strategies_command", "run_strategies", names or [], out, options, json=json, quiet=quiet)


@app.command(short_help="Show what a file holds, or what is wrong with a mesh.")
def info(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE|MESH", help=KEPT_HELP + " Or a mesh, or a built-in object.")
    ],
    scale: Annotated[float | None, typer.Option(metavar="FACTOR", help=objects.SCALE_HELP)] = None,
    solid: objects.SolidRule = None,
    weld: objects.Weld = None,
    fill_holes: objects.FillHoles = None,
    pressure: Annotated[
        bool, typer.Option("--pressure", help="Of contours, pressure and force at 20 random poses on an emulator, too.")
    ] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Show what is in contours, prepared frames, or what a sweep keeps, or what is wrong with a mesh."""
    options = {"scale": scale, "solid": solid, "weld": weld, "fill_holes": fill_holes}
    run_job(".file_commands", "run_info", files, options, pressure, json=json, quiet=quiet)


@app.command(short_help="Check that a file or store is whole (exit 1 if not).")
def check(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE|STORE", help=KEPT_HELP + " Or a sweep's store, or a table.")
    ],
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Check that a contour file, a sweep's store or what it keeps is whole: exit 0 if it is, 1 if not."""
    run_job(".file_commands", "run_check", files, json=json, quiet=quiet)


app.command(short_help="Draw contours on hand and object.")(figure)


app.command(short_help="Show renderings in the browser.")(view)


app.command(short_help="Sample a contour file and stream it to an array.")(play)


app.command(short_help="Render an object on a hand that moves now.")(live)


app.command(short_help="Write wire bytes, which play only copies.")(prepare)


app.command(short_help="Write files that other programs open.")(export)


@app.command(short_help="List sampling presets, or print one as JSON.")
def sampling(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME|FILE]", help="A preset, or a JSON file.", autocompletion=complete_sampling),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List sampling presets, or print one as the JSON that --sampling takes: a start for one of your own."""
    run_job(".play_commands", "run_sampling", name, json=json, quiet=quiet)


@app.command(short_help="List arrays, and why one cannot be opened.")
def devices(
    calibration: Annotated[
        list[Path] | None, typer.Option(metavar="BOARD.pat", help="Board files: they tell a pat16 by its serial.")
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """List the arrays that can be played to, and why one cannot be opened."""
    run_job(".play_commands", "run_devices", calibration or [], json=json, quiet=quiet)


app.command(short_help="Play stimuli that a hand should feel.")(selftest)


app.command(short_help="Predict how loud renderings are, and listen.")(noise)


app.command(short_help="Predict the pressure on the palm, or in a plane.")(field)


app.command(short_help="Time contours beside other libraries.")(bench)


app.command(short_help="Make the founding paper's evaluation again.")(reproduce)


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
