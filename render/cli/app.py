"""The command line: every command has --help, results as JSON, and exit codes 0 done, 1 failed, 2 misuse."""

import os
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

try:
    import typer

    from ..terminal import console
    from .array_options import Array, Calibration, Emulate, Serial, Uncalibrated, Watchdog
    from .command_group import MainGroup
    from .completion import complete_hand, complete_motion, complete_object, complete_sampling, complete_strategy
    from .object_options import FillHoles, Inside, Kind, Label, Level, SolidRule, Spacing, Three, Unit, Weld
    from .selftest_options import selftest
    from .sweep_options import SWEEP_HELP, sweep
    from .trust_options import AllowCode, trust
except KeyboardInterrupt:  # nothing has begun
    sys.exit("error: interrupted")

app = typer.Typer(
    name="palpate",
    cls=MainGroup,
    epilog="palpate --version prints the version; palpate --install-completion has your shell complete names.",
    help="Objects and hand poses in, contours out, focal points on skin (ultrasound mid-air haptics).",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would take [m] for markup and leave it out
)

Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Six = tuple[float, float, float, float, float, float]
OBJECT_HELP = (
    "Mesh (STL, OBJ, PLY, GLB), volume (.npy .npz .nrrd .nii .nvdb), expression (.json), function (module:name), "
    "or built in: cube, sphere, tube, dog, dog-detailed, rock."
)
MOTION_HELP = (
    "CSV or HDF5 of poses, a recording of a hand (Leap, OpenXR, WebXR, MediaPipe), or the word exploration for a "
    "synthetic one."
)
HAND_HELP = "palm: one rectangle; planes: palm and phalanges; skin: palpate's own hand; or a file of a hand's mesh."
INTERPOLATE_HELP = "Insert poses until contours move by no more than this from pose to pose; v / f_s leaves no hops."
FLUSH_HELP = "How near to a patch's plane or side counts as on it; by default three float32 spacings at the pose."
DEVICE_HELP = "cpu, cuda:0, several with commas between, cuda (all GPUs), or auto: the first GPU if there is one."
WORKERS_HELP = "Workers on each device; auto: one for each core of the CPU, two on a GPU. The file is the same."
MEMORY_HELP = "Budget of all workers and the writing [MB]; by default 200 a CPU worker, 1000 a GPU's, at least 512."
KEPT_HELP = "Contour file, or focal points or drives of a sweep."
DURATION_HELP = "Stop after this time [s] if the motion has not ended; a static pose needs it."


def _run(module: str, name: str, *arguments: object, as_json: bool) -> None:
    """Exit with the code of a command, whose module is imported only now: --help need not wait for it."""

    raise typer.Exit(
        console.run(
            lambda: getattr(import_module(module, __package__), name)(*arguments, as_json=as_json), as_json=as_json
        )
    )


@app.command(short_help="Run the main job in one go, into palpate-demo/.")
def demo(
    folder: Annotated[Path, typer.Option(help="Where the results go; made if missing, used again.")] = Path(
        "palpate-demo"
    ),
    clock: Annotated[str, typer.Option(help="Play in real time (monotonic), or as fast as it goes (virtual).")] = (
        "monotonic"
    ),
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    json: Json = False,
) -> None:
    """Run the main job: explore the tube for 30 s, render OC and CC, play CC on the emulated array, draw a picture."""
    _run(".demo_command", "run_demo", folder, clock, overwrite, as_json=json)


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
    hand: Annotated[str, typer.Option(metavar="KIND|FILE", help=HAND_HELP, autocompletion=complete_hand)] = "palm",
    palm: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="WIDTH LENGTH", help="Size of the palm [m], by default 0.085 0.085."),
    ] = None,
    scale: Annotated[float, typer.Option(help="Factor on the object's coordinates (0.001 for millimetres).")] = 1.0,
    up: Annotated[str, typer.Option(help="Axis of the file that points up: x, y, z, -x, -y, -z.")] = "z",
    fit: Annotated[float | None, typer.Option(metavar="SIZE", help="Longest side [m], whatever the scale.")] = None,
    rotate: Annotated[
        Three, typer.Option(metavar="X Y Z", help="Turn about the array's axes x, y, z in turn [degree].")
    ] = (0.0, 0.0, 0.0),
    at: Annotated[Three | None, typer.Option(metavar="X Y Z", help="Where the middle of the object goes [m].")] = None,
    kind: Kind = None,
    level: Level = None,
    label: Label = None,
    inside: Inside = None,
    spacing: Spacing = None,
    unit: Unit = None,
    bounds: Annotated[
        Six | None, typer.Option(metavar="X Y Z X Y Z", help="Of a function: lowest and highest coordinates [m].")
    ] = None,
    solid: SolidRule = None,
    weld: Weld = None,
    fill_holes: FillHoles = None,
    simplify: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="Simplify a mesh within this distance; 0: a quarter of the focal width."),
    ] = None,
    object_motion: Annotated[
        str | None, typer.Option(metavar="FILE", help="CSV or HDF5 of poses: where the object's middle is, when.")
    ] = None,
    side: Annotated[str | None, typer.Option(help="Which hand of a recording: left, right, or its id.")] = None,
    alignment: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Of a recording: from the tracker's frame to the array's.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help="Of a synthetic exploration [s], by default 30.")] = None,
    rate: Annotated[float | None, typer.Option(help="Poses a second of an exploration [Hz], by default 90.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of an exploration, by default 1.")] = None,
    interpolate: Annotated[float | None, typer.Option(metavar="METRES", help=INTERPOLATE_HELP)] = None,
    device: Annotated[str, typer.Option(help=DEVICE_HELP)] = "auto",
    workers: Annotated[str, typer.Option(metavar="N", help=WORKERS_HELP)] = "auto",
    memory: Annotated[int | None, typer.Option(min=5, help=MEMORY_HELP)] = None,
    gzip: Annotated[int, typer.Option(min=0, max=9, help="Compress the file: 0 not, 9 most.")] = 0,
    allow_code: AllowCode = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted rendering.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file once the new one is whole.")] = False,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 if no pose has a contour.")] = False,
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
        "exploration": {"duration": duration, "rate": rate, "seed": seed},
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
    _run(".file_commands", "run_render", options, as_json=json)


@app.command(short_help="Turn a mesh, also an open one, into voxels.")
def voxelise(
    mesh: Annotated[
        str,
        typer.Argument(metavar="MESH", help="Mesh file, or built in; open ones too.", autocompletion=complete_object),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT.npz", help="Or .npy, .nrrd, .nii, .nvdb.")],
    spacing: Annotated[float, typer.Option(metavar="METRES", help="Between voxels.")],
    kind: Annotated[str, typer.Option(help="distance (signed), or occupancy.")] = "distance",
    sign: Annotated[str, typer.Option(help="Inside by crossings, parity, winding; auto: winding if open.")] = "auto",
    scale: Annotated[float, typer.Option(help="Factor on the mesh's coordinates (0.001 for millimetres).")] = 1.0,
    up: Annotated[str, typer.Option(help="Axis of the file that points up: x, y, z, -x, -y, -z.")] = "z",
    fit: Annotated[float | None, typer.Option(metavar="SIZE", help="Longest side [m], whatever the scale.")] = None,
    rotate: Annotated[
        Three, typer.Option(metavar="X Y Z", help="Turn about the array's axes x, y, z in turn [degree].")
    ] = (0.0, 0.0, 0.0),
    at: Annotated[Three | None, typer.Option(metavar="X Y Z", help="Where the middle of the object goes [m].")] = None,
    device: Annotated[str, typer.Option(help="cpu, cuda:0, or auto: the first GPU if there is one.")] = "auto",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    json: Json = False,
) -> None:
    """Turn a mesh into voxels: the way out for open meshes."""
    placement = {"scale": scale, "up": up, "fit": fit, "rotate": rotate, "at": at}
    _run(
        ".voxelise_command", "run_voxelise", mesh, out, spacing, kind, sign, placement, device, overwrite, as_json=json
    )


app.add_typer(sweep, name="sweep", help=SWEEP_HELP, short_help="Make every combination that a plan names, as a table.")
app.command(short_help="Permit code that files name, as it is now.")(trust)


@app.command(short_help="List or draw intersection strategies and stages.")
def strategies(
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="PICTURE", help="Draw them: PNG, SVG, PDF.")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    json: Json = False,
) -> None:
    """List intersection strategies and the stages that they are made of."""
    _run(".strategies_command", "run_strategies", out, overwrite, as_json=json)


@app.command(short_help="Show what a file holds, or what is wrong with a mesh.")
def info(
    file: Annotated[Path, typer.Argument(metavar="FILE|MESH", help=KEPT_HELP + " Or a mesh, or a built-in object.")],
    scale: Annotated[float | None, typer.Option(help="Of a mesh: factor on its coordinates (0.001: mm).")] = None,
    solid: SolidRule = None,
    weld: Weld = None,
    fill_holes: FillHoles = None,
    json: Json = False,
) -> None:
    """Show what is in a contour file, in focal points or drives that a sweep keeps, or what is wrong with a mesh."""
    options = {"scale": scale, "solid": solid, "weld": weld, "fill_holes": fill_holes}
    _run(".file_commands", "run_info", file, options, as_json=json)


@app.command(short_help="Check that a file or store is whole (exit 1 if not).")
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE|STORE", help=KEPT_HELP + " Or a sweep's store, or a table.")],
    json: Json = False,
) -> None:
    """Check that a contour file, a sweep's store or what it keeps is whole: exit 0 if it is, 1 if not."""
    _run(".file_commands", "run_check", file, as_json=json)


@app.command(short_help="Draw contours, their length and draw frequency.")
def figure(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Contour files of one object and motion.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="PICTURE", help="PNG, SVG or PDF to write.")],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    json: Json = False,
) -> None:
    """Draw contours on the object, the palm, length and draw frequency over time."""
    _run(".file_commands", "run_figure", files, out, overwrite, as_json=json)


@app.command(short_help="Sample a contour file and stream it to an array.")
def play(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Contour file, or focal points: .PTLIST, or a sweep's.")],
    array: Array = "emulator",
    serial: Serial = None,
    calibration: Calibration = None,
    baud: Annotated[int | None, typer.Option(help="Of a sonicsurface with unusual firmware [Bd].")] = None,
    emulate: Emulate = False,
    sampling: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|FILE",
            help="Sampling: a preset (palpate sampling lists them) or a JSON file.",
            autocompletion=complete_sampling,
        ),
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Of the focal point [m/s], by default 7.")] = None,
    update_rate: Annotated[
        float | None, typer.Option(help="Focal points a second [Hz]: 40 kHz / n, by default 10000, or the array's.")
    ] = None,
    duration: Annotated[float | None, typer.Option(help=DURATION_HELP)] = None,
    repeats: Annotated[int, typer.Option(min=1, help="How often to play it.")] = 1,
    amplitude: Annotated[str, typer.Option(help="What an intensity is: pressure, or force.")] = "pressure",
    solver: Annotated[
        str, typer.Option(help="For several focal points at once: naive, gs-pat, wgs, gs-pat+wgs.")
    ] = "gs-pat+wgs",
    slew: Annotated[
        float | None,
        typer.Option(metavar="TURNS", help="Most that a phase changes in 25 us [turns]; 0.015625 quietens jumps."),
    ] = None,
    level_max: Annotated[float, typer.Option(help="Amplitude of intensity 1, of what the array can.")] = 1.0,
    on_time_max: Annotated[
        float, typer.Option(help="Longest emission without a pause of 1 s [s]; 0 lifts the limit.")
    ] = 120.0,
    duty_max: Annotated[
        float, typer.Option(help="Highest mean duty over 10 min, 1 being full drive; 0 lifts the limit.")
    ] = 0.5,
    sound_speed: Annotated[float, typer.Option(help="Speed of sound [m/s]: 331.3 + 0.606 x degrees C.")] = 343.0,
    transport: Annotated[str, typer.Option(help="USB writes: queued, sync, or auto.")] = "auto",
    watchdog: Watchdog = False,
    uncalibrated: Uncalibrated = False,
    device: Annotated[str, typer.Option(help="For solvers of several focal points: cpu, cuda:0.")] = "cpu",
    clock: Annotated[
        str, typer.Option(help="Of the emulated array: monotonic (real time) or virtual (as fast as it goes).")
    ] = "monotonic",
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 1 if late frames, silenced points, or too long steps are warned of."),
    ] = False,
    json: Json = False,
) -> None:
    """Sample a contour file and stream it to an array; the array is off on every way out."""
    options = {name: value for name, value in locals().items() if name not in ("file", "json")}
    _run(".play_commands", "run_play", file, options, as_json=json)


@app.command(short_help="Write focal points for other programs.")
def export(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Contour file.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT.ptlist", help="Point list to write (DOLPHIN).")],
    sampling: Annotated[
        str,
        typer.Option(metavar="NAME|FILE", help="Sampling: a preset or a JSON file.", autocompletion=complete_sampling),
    ] = "stm",
    speed: Annotated[float | None, typer.Option(help="Of the focal point [m/s], by default 7.")] = None,
    update_rate: Annotated[float | None, typer.Option(help="Focal points a second [Hz], by default 10000.")] = None,
    duration: Annotated[float | None, typer.Option(help=DURATION_HELP)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the file.")] = False,
    json: Json = False,
) -> None:
    """Sample a contour file into a list of focal points that other programs read."""
    options = {"sampling": sampling, "speed": speed, "update_rate": update_rate, "duration": duration}
    _run(".play_commands", "run_export", file, out, options, overwrite, as_json=json)


@app.command(short_help="List sampling presets, or print one as JSON.")
def sampling(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME|FILE]", help="A preset, or a JSON file.", autocompletion=complete_sampling),
    ] = None,
    json: Json = False,
) -> None:
    """List sampling presets, or print one as the JSON that --sampling takes: a start for one of your own."""
    _run(".play_commands", "run_sampling", name, as_json=json)


@app.command(short_help="List arrays, and why one cannot be opened.")
def devices(
    calibration: Annotated[
        list[Path] | None, typer.Option(metavar="BOARD.pat", help="Board files: they tell a pat16 by its serial.")
    ] = None,
    json: Json = False,
) -> None:
    """List the arrays that can be played to, and why one cannot be opened."""
    _run(".play_commands", "run_devices", calibration or [], as_json=json)


app.command(short_help="Play stimuli that a hand should feel.")(selftest)


@app.command(short_help="Time contours beside other libraries.")
def bench(
    objects: Annotated[
        str, typer.Option(metavar="NAME,...", help="Built in, or blob-N of about N triangles (blob-5000); or none.")
    ] = "cube,tube,dog,sphere,rock,blob-100k,blob-1m",
    strategies: Annotated[str, typer.Option(metavar="NAME,...", help="oc, cc.")] = "oc,cc",
    device: Annotated[str, typer.Option(help="Of palpate: cpu, cuda:0, ...; peers run on the CPU.")] = "cpu",
    poses: Annotated[
        int | None,
        typer.Option(min=1, max=10**8, help="Of palpate; by default half a second of them, on a GPU 4,000,000."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Repetitions, of which the median is taken.")] = 7,
    peers: Annotated[str, typer.Option(metavar="NAME,...", help="Libraries to compare with, or all, or none.")] = "all",
    motion: Annotated[str, typer.Option(help="Poses: random, or exploration.")] = "random",
    one_core: Annotated[
        bool, typer.Option("--one-core/--all-cores", help="Compare CPU time on one core, or wall time on all.")
    ] = True,
    curve: Annotated[bool, typer.Option("--curve", help="Cost against triangles and against poses, too.")] = False,
    first_use: Annotated[bool, typer.Option("--first-use", help="Time a first and a later `render`, too.")] = False,
    json: Json = False,
) -> None:
    """Time contours: palpate and installed libraries (pip install -e '.[bench]') in turns, beside a memory copy."""
    options = {
        "device": device,
        "objects": objects,
        "strategies": strategies,
        "poses": poses,
        "repeats": repeats,
        "peers": peers,
        "motion": motion,
        "one_core": one_core,
        "curve": curve,
        "first_use": first_use,
    }
    _run("..bench.report", "run_bench", options, as_json=json)


def main() -> None:
    """Entry point of the console script."""
    if sys.stdout is not None and not sys.stdout.isatty():
        os.environ.setdefault("COLUMNS", "120")  # tables and help in pipes and logs
    try:
        sys.exit(console.parsed(app))
    except KeyboardInterrupt:  # before a command runs, or after: it tells of its own
        sys.exit(console.fail("interrupted", console.FAILED, False))
