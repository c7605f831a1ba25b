"""Every kind of input that the fuzzer damages: valid files, and the public function or command that reads them."""

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from board_file_cases import board_lines
from bounded import Refused, Wrong
from contour_cases import everything, make_contours, make_header, small_chunks, write_file, write_ranges
from gltf_files import full_file
from ply_files import MIXED, face_element, ply_file, vertex_element
from sweep_rows import recipe
from typer.testing import CliRunner
from voxel_cases import ball, balled

from palpate.datasets import (
    ContourFile,
    ContourWriter,
    HandMotion,
    check_file,
    load_recording,
    read_ptlist,
    static_pose,
    write_ptlist,
)
from palpate.datasets.errors import ContourFileError, DatasetError
from palpate.datasets.focus_files.frame_file import FrameField, FrameFile
from palpate.datasets.focus_files.frame_reader import FOCAL_POINTS, FrameReader, check_frames
from palpate.datasets.recordings.alignment import alignment_pose, write_alignment
from palpate.datasets.recordings.sample import write_sample
from palpate.datasets.sweeps.result_row import ResultRow
from palpate.datasets.sweeps.store import Failure, SweepStore
from palpate.datasets.sweeps.table import load_table, write_table
from palpate.device.playing.limits import Limits
from palpate.render import (
    DriveStrategy,
    ImplicitObject,
    MeshHand,
    MeshObject,
    Palm,
    Placement,
    VoxelObject,
    closed_contour,
    exploration,
    load_rig,
    load_sampling,
    load_strategy,
    record,
)
from palpate.render.cli.app import app
from palpate.render.objects.mesh.cache import arrays_of, mended_of, read_entry, write_entry
from palpate.render.objects.mesh.repair import Repair, repair_mesh
from palpate.render.objects.voxels.voxel_object import save_voxels
from palpate.render.sampling.presets import PRESETS
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.plan.recipe import Recipe
from palpate.render.sweeps.report.compare import load_baseline

DATA = os.environ.get("PALPATE_TEST_DATA")
FAR = 1e6
"""[m]; a pose farther away than this is no pose of a hand."""


@dataclass(frozen=True)
class Reader:
    """One kind of input."""

    name: str
    seeds: Callable[[Path], None]
    """Writes valid inputs into a folder: each a file, or a folder."""
    read: Callable[[Path], Any]
    """Reads one; raises palpate's own errors, Refused or Wrong."""
    is_checked: bool = False
    """Whether damaged bytes must be refused, or change nothing of what is read."""
    damaged: tuple[str, ...] = ("*",)
    """Patterns of the files in a folder of a seed that are damaged; {} is the folder's name."""


def one_file(path: Path, suffix: str) -> Path:
    """The file of a seed that is a folder, or the seed itself."""
    return next(iter(path.glob(f"*{suffix}")), path) if path.is_dir() else path


def near(position: Any) -> Any:
    """Positions [m]; raises Wrong for those that no hand has."""
    if not (farthest := abs(position).max()) < FAR:
        raise Wrong(f"a position of {farthest:.3g} m is accepted")
    return position


def text_seeds(files: dict[str, str], folder: Path) -> None:
    """Files by name: of a folder, if the name has one."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)


# contour files


def chunks_of(path: Path) -> Any:
    """The small chunks that some seeds are written with."""
    return small_chunks(7) if "chunks" in str(path) else contextlib.nullcontext()


def contour_seeds(folder: Path) -> None:
    write_file(folder / "plain.h5", make_contours(6))
    write_file(folder / "dwell.h5", make_contours(6, intensity=True, dwell=True), **everything(6))
    with small_chunks(7):
        write_file(folder / "chunks.h5", make_contours(40, intensity=True))
    write_file(folder / "large.h5", make_contours(3000, intensity=True, dwell=True), chunk=500)


def read_contours(path: Path) -> Any:
    """All that a contour file holds that `check` calls whole."""
    with chunks_of(path):
        problems = check_file(path)
        try:
            with ContourFile(path) as file:
                arrays = {**file.contours(), **file.metrics(), **file.motion(), **file.object(), **file.hand_arrays()}
                found = arrays, file.attributes, file.strategy, file.hand, file.recipe, tuple(file.timing())
        except DatasetError as error:
            if not problems:
                raise Wrong(f"check says whole, reading says: {error}") from error
            raise
    if problems:
        raise Refused("; ".join(problems))
    return found


def partial_seeds(folder: Path) -> None:
    """Work folders of interrupted renderings."""
    for name in ("chunks", "tails"):
        (folder / name).mkdir()
        with chunks_of(folder / name), ContourWriter(folder / name / "out.h5", make_header(40)) as writer:
            write_ranges(writer, make_contours(40), [(0, 9), (9, 23), (30, 34)])


def resume(folder: Path) -> Any:
    """The file that a resumed rendering seals: the rows done, and those that are missing written again."""
    path = folder / "out.h5"
    with chunks_of(folder):
        check_file(path)
        contours = make_contours(40)
        with ContourWriter(path, make_header(40), mode="resume") as writer:
            write_ranges(writer, contours, writer.missing())
            writer.seal()
        if problems := check_file(path):
            raise Wrong(f"sealed, and check says: {problems[0]}")
        with ContourFile(path) as file:
            found = {**file.contours(), **file.metrics()}
        if not writer.repairs:
            return found
        if wrong := [name for name, array in contours.items() if not np.array_equal(found[name], array)]:
            raise Wrong(f"rendered again, but {wrong[0]} differs")
        raise ContourFileError(writer.repairs[0])  # a block that is dropped in a sentence is refused


# motions, recordings, alignments, point lists


def motion_seeds(suffix: str, folder: Path) -> None:
    pose = np.repeat(static_pose([0, 0, 0.2]).pose, 12, axis=0)
    HandMotion(np.arange(12) / 90, pose, seed=3).save(folder / f"timed{suffix}")
    static_pose([0, 0, 0.2]).save(folder / f"static{suffix}")


def read_motion(path: Path) -> Any:
    return near(HandMotion.load(path).pose[:, :3])


def recording_seeds(folder: Path) -> None:
    for form in ("leap", "openxr", "webxr", "mediapipe"):
        for suffix in (".json", ".csv"):
            write_sample(form, folder / f"{form}{suffix}", frame_count=3)
    write_sample("leap", folder / "leap.npz", frame_count=3)
    write_sample("webxr-static", folder / "static.json")
    if DATA:
        (folder / "real.json").write_bytes((Path(DATA) / "hands" / "webxr_poses.json").read_bytes())


def read_recording(path: Path) -> Any:
    return near(load_recording(path).motion().pose[:, :3])


def alignment_seeds(folder: Path) -> None:
    write_alignment(folder / "pose.json", [0, 0.1, 0, 0.70710678, 0, 0, 0.70710678])
    (folder / "matrix.json").write_text('{"matrix": [[1,0,0,0],[0,0,-1,0.12],[0,1,0,0],[0,0,0,1]]}')


def ptlist_seeds(folder: Path) -> None:
    write_ptlist(folder / "a.ptlist", np.full((20, 3), 0.1), np.linspace(0, 1, 20), 1000.0)


# sweeps and frames

COLUMNS = {"pose": np.arange(300), "length": np.linspace(0, 1, 300, dtype=np.float32), "drawn": np.arange(300) % 3 > 0}


def table_seeds(folder: Path) -> None:
    columns = {
        "recipe_hash": [f"h{k}" for k in range(20)],
        "object.source": ["cube", "tüb"] * 10,
        "length_mean": np.linspace(0, 1, 20),
        "poses": np.arange(20),
        "complete": np.arange(20) % 2 > 0,
    }
    constants = {"maker": "me", "speed": 7, "object_fit": None}
    write_table(folder / "table.csv", columns)
    write_table(folder / "baseline.csv", columns, constants=constants)
    write_table(folder / "table.parquet", columns, units={"length_mean": "m"})


def read_table(path: Path) -> Any:
    found = load_table(path)
    if "recipe_hash" in found:
        load_baseline(path)
    return found


def store_seeds(folder: Path) -> None:
    rows = [
        ResultRow.of("fuzz", "poses", "k", n, {"stat": {"length": [1.0, n]}, "name": "ü"}, COLUMNS) for n in range(4)
    ]
    rows += [ResultRow.of("fuzz", "contours", f"k{k}", 0, {"stat": {"length": [k / 7] * 5}}) for k in range(60)]
    with SweepStore(folder / "a.sweep", "fuzz", mode="write") as store:
        store.add(rows)
        store.replace_failures([Failure("r", "a recipe", "could not be made: ü")])


def read_store(folder: Path) -> Any:
    """All that a store gives back; chunks that it does not report as done may be missing, and no others."""
    keys = [("poses", "k"), *(("contours", f"k{k}") for k in range(60))]
    with SweepStore(folder, "fuzz") as store:
        done = {place: sorted(chunks) for place, chunks in store.done(keys).items()}
        return list(store.results(keys)), store.failures(), list(store.column_chunks("k")), done


def frame_seeds(folder: Path) -> None:
    rng = np.random.default_rng(1)
    position, delay = FrameField("/focus/position", (3,), "m"), FrameField("/drive/delay", (256,), "turn")
    points = {position: rng.uniform(0.1, 0.2, (50, 3)), FrameField("/focus/intensity", (), "1"): rng.uniform(0, 1, 50)}
    drives = {delay: np.full((10, 256), 0.5), FrameField("/drive/amplitude", (), "1"): np.ones(10)}
    for name, form, group, values, more in (
        ("points", "palpate focal points", "/focus", points, {}),
        ("drives", "palpate drives", "/drive", drives, {"/array": {"names": '["emulator"]'}}),
    ):
        about = {"version": np.array([1, 0], np.int32), "recipe": '{"thing": {"name": "my thing"}}', "format": form}
        count = len(next(iter(values.values())))
        attributes = {"/": about, group: {"update_rate": 5000.0}, **more}
        with FrameFile(folder / f"{name}.h5", list(values), count, attributes=attributes) as file:
            file.append({field.path: rows for field, rows in values.items()})
            file.publish()


def read_frames(path: Path) -> Any:
    problems = check_frames(path)
    with FrameReader(path) as file:
        points = file.focal_points(0, file.frame_count) if file.format == FOCAL_POINTS else ()
        found = file.format, file.update_rate, file.recipe(), points
    if problems:
        raise Refused("; ".join(problems))
    return found


# objects and hands


RELATIVE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3/1 -1/2 -2/3\nv 0 0 1\nf 1//1 2//2 -1//4 \\\n\nf 2 3 4 # one\nf 3 1 4\n"


def box() -> Any:
    return trimesh.creation.box((0.08, 0.06, 0.05))


def mesh_seeds(folder: Path) -> None:
    mesh = box()
    for suffix in ("stl", "obj", "ply", "glb", "off"):
        mesh.export(folder / f"box.{suffix}")
    (folder / "gltf").mkdir()
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
        (folder / "gltf" / name).write_bytes(content)
    mesh.export(folder / "ascii.stl", file_type="stl_ascii")
    mesh.export(folder / "ascii.ply", encoding="ascii")
    (folder / "full.gltf").write_bytes(full_file().text())
    (folder / "full.glb").write_bytes(full_file().glb())
    (folder / "relative.obj").write_text(RELATIVE)
    for kind in ("ascii", "binary_big_endian"):
        (folder / f"mixed_{kind}.ply").write_bytes(ply_file(kind, [vertex_element(), face_element(MIXED)]))
    for path in (Path(DATA) / "meshes").glob("*.stl") if DATA else ():
        (folder / path.name).write_bytes(path.read_bytes())


def read_mesh(path: Path) -> Any:
    mesh = MeshObject.load(one_file(path, ".gltf"))
    return mesh.vertices, mesh.faces


def hand_seeds(folder: Path) -> None:
    scene = trimesh.Scene()
    for number, name in enumerate(("wrist", "middle-finger-metacarpal", "middle-finger-phalanx-proximal")):
        scene.graph.update(name, matrix=trimesh.transformations.translation_matrix([0, 0, -0.03 * (number + 1)]))
    plate = trimesh.creation.box((0.08, 0.02, 0.18))
    scene.add_geometry(plate, node_name="skin")
    scene.export(folder / "hand.glb")
    plate.export(folder / "hand.stl")
    if DATA:
        (folder / "left.glb").write_bytes((Path(DATA) / "hands" / "left.glb").read_bytes())


def volume_seeds(folder: Path) -> None:
    import nrrd

    values = ball((9, 8, 10), (0.01, 0.01, 0.01))
    for suffix in (".npz", ".npy", ".nrrd", ".nii", ".nii.gz", ".nvdb"):
        save_voxels(balled(values, spacing=0.01), folder / f"ball{suffix}")
    (folder / "detached").mkdir()
    head = {"spacings": [10.0] * 3, "units": ["mm"] * 3, "encoding": "gzip"}
    nrrd.write(str(folder / "detached" / "ball.nhdr"), values, head)


def read_volume(path: Path) -> Any:
    path = one_file(path, ".nhdr")
    spacing = 0.01 if path.suffix == ".npy" else None
    return VoxelObject.load(path, kind="distance", spacing=spacing, placement=Placement(at=(0, 0, 0.2))).values


def cache_seeds(folder: Path) -> None:
    mesh = box()
    repaired = repair_mesh(mesh.vertices, mesh.faces.astype(np.int64), Repair("winding", 0, 0))
    write_entry(folder / f"{'0' * 64}.npz", arrays_of(repaired))


def read_cache(path: Path) -> Any:
    found = read_entry(path, mended_of)
    if found is None:
        raise Refused("the entry is removed")
    return found.vertices, found.faces, found.solid_count


# strategies, samplings, plans, arrays

EXPRESSION = """{"op": "union", "of": [{"op": "sphere", "radius": 0.04}, {"op": "box", "size": [0.1, 0.05, 0.02]},
 {"op": "capsule", "start": [0, 0, 0], "stop": [0, 0, 0.05], "radius": 0.01}]}"""
STRATEGY = """{"raw": "section", "prune": ["outside", "close-together", {"stage": "small", "length": 0.008}],
 "transform": ["close", {"stage": "hatch", "spacing": 0.01}, "simplify"]}"""
PLAN = """metrics = ["contours", "frequency"]
device = "cpu"
[object]
source = ["cube", "tube"]
scale = [1.0, 0.5]
[hand]
source = "palm"
[motion]
source = "random"
seed = { first = 1, count = 3 }
count = 50
[strategy]
source = ["oc", "s.json"]
[[exclude]]
"object.source" = "tube"
"strategy.source" = ["oc"]
"""
RIG = """[{"array": "emulator", "serial": "E1"},
 {"array": "pat16", "calibration": "board.pat", "pose": [0, 0, 0.3, 1, 0, 0, 0]}]"""
BOARD = "\n".join(board_lines(np.random.default_rng(3))[0]) + "\n"
expression_seeds = partial(text_seeds, {"cup.json": EXPRESSION})
strategy_seeds = partial(text_seeds, {"s.json": STRATEGY})
plan_seeds = partial(text_seeds, {"plan/study.toml": PLAN, "plan/s.json": STRATEGY})
board_seeds = partial(text_seeds, {"rig/board.pat": BOARD, "rig/rig.json": RIG})
DESCRIBED = {"drive": DriveStrategy, "limits": Limits, "recipe": Recipe}
DESCRIPTIONS = {"drive.json": DriveStrategy().to_json(), "limits.json": Limits().to_json()}


def description_seeds(folder: Path) -> None:
    text_seeds(DESCRIPTIONS | {"recipe.json": recipe().to_json()}, folder)


def read_description(path: Path) -> Any:
    """A description that another file holds as text."""
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise Refused("no text") from error
    return DESCRIBED[path.stem].from_json(text)


def sampling_seeds(folder: Path) -> None:
    text_seeds({f"{name}.json": made().to_json() for name, made in list(PRESETS.items())[:4]}, folder)


# commands


def command(*arguments: object) -> str:
    """Standard output and error of a command; Refused with its sentence where it ends with 1 or 2."""
    os.environ["PALPATE_TRACEBACK"] = "1"  # raw errors come through
    result = CliRunner().invoke(app, [str(a) for a in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    if any((ord(letter) < 32 and letter != "\n") or 127 <= ord(letter) < 160 for letter in result.output):
        raise Wrong(f"control characters are printed: {result.output[-200:]!r}")
    if result.exit_code:
        if result.exit_code not in (1, 2) or "error" not in result.output.lower():
            raise Wrong(f"exit code {result.exit_code} without a sentence: {result.output[-200:]!r}")
        raise Refused(result.output)
    return result.output


def rendered_seeds(folder: Path) -> None:
    """Folders of an object, a motion, a strategy and a hand; the file that is damaged has its folder's name."""
    for name in ("motion", "strategy", "object", "hand"):
        own = folder / name
        own.mkdir()
        bounds = np.array([[-0.05, -0.05, 0.15], [0.05, 0.05, 0.25]])
        exploration(bounds, duration=0.2, rate=30.0, seed=1).save(own / "motion.csv")
        (own / "strategy.json").write_text(STRATEGY)
        box().apply_translation((0, 0, 0.2)).export(own / "object.stl")
        box().apply_scale(1.5).export(own / "hand.stl")


def run_render(folder: Path) -> Any:
    options = ["--hand", folder / "hand.stl"] if folder.name == "hand" else ["--strategy", folder / "strategy.json"]
    output = ("-o", folder / "out.h5", "--workers", "1", "--overwrite")
    return command("render", folder / "object.stl", folder / "motion.csv", *output, *options)


def playable_seeds(folder: Path) -> None:
    cube = MeshObject.load("cube")
    record(
        folder / "cube.h5", cube, Palm(), exploration(cube.bounds, duration=0.3, rate=30.0, seed=1), closed_contour()
    )
    ptlist_seeds(folder)
    frame_seeds(folder)


def run_on_contours(path: Path) -> Any:
    lines = {
        "check": ("check", path),
        "info": ("info", path),
        "export": ("export", path, "-o", path.with_suffix(".ptlist")),
        "play": ("play", path, "--clock", "virtual", "--duration", "0.01"),
    }
    known = {"cube": tuple(lines), "points": ("check", "info", "play"), "drives": ("check", "info"), "a": ("play",)}
    refused, output = [], ""
    for name in known[path.stem]:
        try:
            output += command(*lines[name])
        except Refused as error:
            refused.append(error)
    if refused:
        raise refused[0]
    return output


def run_check(path: Path) -> Any:
    with chunks_of(path):
        return command("check", path)


READERS: tuple[Reader, ...] = (
    Reader("contours", contour_seeds, read_contours, True),
    Reader("partial", partial_seeds, resume, True, ("poses-*.h5", "header.h5")),
    Reader("motion-csv", partial(motion_seeds, ".csv"), read_motion),
    Reader("motion-hdf5", partial(motion_seeds, ".h5"), read_motion),
    Reader("recording", recording_seeds, read_recording),
    Reader("alignment", alignment_seeds, lambda path: near(alignment_pose(path)[:3])),
    Reader("table", table_seeds, read_table),
    Reader("store", store_seeds, read_store, True, ("store.sqlite", "*.h5")),
    Reader("frames", frame_seeds, read_frames, True),
    Reader("mesh", mesh_seeds, read_mesh),
    Reader("mesh-hand", hand_seeds, lambda path: MeshHand.load(path).faces),
    Reader("mesh-cache", cache_seeds, read_cache, True),
    Reader("volume", volume_seeds, read_volume),
    Reader("expression", expression_seeds, lambda path: ImplicitObject(path).bounds),
    Reader("strategy", strategy_seeds, lambda path: load_strategy(str(path)).described()),
    Reader("sampling", sampling_seeds, lambda path: load_sampling(str(path)).described()),
    Reader("descriptions", description_seeds, read_description),
    Reader("plan", plan_seeds, lambda folder: load_plans([folder / "study.toml"]).digest),
    Reader("board", board_seeds, lambda folder: load_rig(str(folder / "rig.json"))),
    Reader("ptlist", ptlist_seeds, read_ptlist),
    Reader("palpate check", contour_seeds, run_check),
    Reader("palpate info", mesh_seeds, lambda path: command("info", one_file(path, ".gltf"))),
    Reader("palpate play", playable_seeds, run_on_contours),
    Reader("palpate render", rendered_seeds, run_render, False, ("{}.*",)),
    Reader("palpate sweep", plan_seeds, lambda folder: command("sweep", folder / "study.toml", "--dry-run")),
    Reader("palpate sampling", sampling_seeds, lambda path: command("sampling", path)),
    Reader(
        "palpate devices",
        board_seeds,
        lambda f: command("devices", "--calibration", f / "board.pat"),
        False,
        ("*.pat",),
    ),
)
"""The kinds of input; `--loader` names them."""
