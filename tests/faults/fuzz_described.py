"""What the fuzzer reads of what describes a rendering: objects, hands, strategies, plans, arrays."""

import os
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_format import Refused, one_file

# objects and hands


def box() -> Any:
    import trimesh

    return trimesh.creation.box((0.08, 0.06, 0.05))


def mesh_seeds(folder: Path) -> None:
    import trimesh

    mesh = box()
    for suffix in ("stl", "obj", "ply", "glb", "off", *(["3mf"] if find_spec("lxml") else [])):
        mesh.export(folder / f"box.{suffix}")
    (folder / "gltf").mkdir()
    for name, content in trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh)).items():
        (folder / "gltf" / name).write_bytes(content)
    with zipfile.ZipFile(folder / "box.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("box.stl", mesh.export(file_type="stl"))
    mesh.export(folder / "ascii.stl", file_type="stl_ascii")
    mesh.export(folder / "ascii.ply", encoding="ascii")
    if data := os.environ.get("PALPATE_TEST_DATA"):
        for path in (Path(data) / "meshes").glob("*.stl"):
            (folder / path.name).write_bytes(path.read_bytes())


def read_mesh(path: Path) -> Any:
    from palpate.render import MeshObject

    mesh = MeshObject.load(one_file(path, ".gltf"))
    return mesh.vertices, mesh.faces


def hand_seeds(folder: Path) -> None:
    import trimesh

    scene = trimesh.Scene()
    for name in ("wrist", "middle-finger-metacarpal", "middle-finger-phalanx-proximal"):
        scene.graph.update(
            name, matrix=trimesh.transformations.translation_matrix([0, 0, -0.03 * len(scene.graph.nodes)])
        )
    plate = trimesh.creation.box((0.08, 0.02, 0.18))
    scene.add_geometry(plate, node_name="skin")
    scene.export(folder / "hand.glb")
    plate.export(folder / "hand.stl")
    if data := os.environ.get("PALPATE_TEST_DATA"):
        (folder / "left.glb").write_bytes((Path(data) / "hands" / "left.glb").read_bytes())


def read_hand(path: Path) -> Any:
    from palpate.render import MeshHand

    return MeshHand.load(path).faces


def volume_seeds(folder: Path) -> None:
    from voxel_cases import ball, balled

    from palpate.render.objects.voxels.files import save_voxels

    shape = (9, 8, 10)
    thing = balled(ball(shape, (0.01, 0.01, 0.01)), spacing=0.01)
    for suffix in (".npz", ".npy", ".nrrd", ".nii", ".nii.gz", ".nvdb"):
        save_voxels(thing, folder / f"ball{suffix}")
    own = folder / "detached"
    own.mkdir()
    import nrrd

    nrrd.write(
        str(own / "ball.nhdr"),
        ball(shape, (0.01,) * 3),
        {"spacings": [10.0] * 3, "units": ["mm"] * 3, "encoding": "gzip"},
    )


def read_volume(path: Path) -> Any:
    from palpate.render import Placement, VoxelObject

    path = one_file(path, ".nhdr")
    spacing = 0.01 if path.suffix == ".npy" else None
    return VoxelObject.load(path, kind="distance", spacing=spacing, placement=Placement(at=(0, 0, 0.2))).values


def cache_seeds(folder: Path) -> None:
    from palpate.render.objects.mesh.kept_arrays import write_entry
    from palpate.render.objects.mesh.kept_repairs import arrays_of
    from palpate.render.objects.mesh.repair import Repair, repair_mesh

    mesh = box()
    repaired = repair_mesh(mesh.vertices, mesh.faces.astype(np.int64), Repair("winding", 0, 0))
    write_entry(folder / f"{'0' * 64}.npz", arrays_of(repaired))


def read_cache(path: Path) -> Any:
    from palpate.render.objects.mesh.kept_arrays import read_entry
    from palpate.render.objects.mesh.kept_repairs import mended_of

    found = read_entry(path, mended_of)
    if found is None:
        raise Refused("it is removed")
    return {"vertices": found.vertices, "faces": found.faces, "count": found.solid_count}


EXPRESSION = """{"op": "union", "of": [{"op": "sphere", "radius": 0.04}, {"op": "box", "size": [0.1, 0.05, 0.02]},
 {"op": "capsule", "start": [0, 0, 0], "stop": [0, 0, 0.05], "radius": 0.01}]}"""


def expression_seeds(folder: Path) -> None:
    (folder / "cup.json").write_text(EXPRESSION)


def read_expression(path: Path) -> Any:
    from palpate.render import ImplicitObject

    return ImplicitObject.load(path).bounds


# strategies, samplings, plans, arrays

STRATEGY = """{"raw": "section", "prune": ["outside", "close-together", {"stage": "small", "length": 0.008}],
 "transform": ["close", {"stage": "hatch", "spacing": 0.01}, "simplify"]}"""


def strategy_seeds(folder: Path) -> None:
    (folder / "s.json").write_text(STRATEGY)


def read_strategy(path: Path) -> Any:
    from palpate.render import load_strategy

    return load_strategy(str(path)).described()


def sampling_seeds(folder: Path) -> None:
    from palpate.render.sampling.contour_sampling import PRESETS

    for name, made in list(PRESETS.items())[:4]:
        (folder / f"{name}.json").write_text(made().to_json())


def read_sampling(path: Path) -> Any:
    from palpate.render import load_sampling

    return load_sampling(str(path)).described()


def text_seeds(folder: Path) -> None:
    from sweep_rows import recipe

    from palpate.device.playing.limits import Limits
    from palpate.render import DriveStrategy

    (folder / "drive.json").write_text(DriveStrategy().to_json())
    (folder / "limits.json").write_text(Limits().to_json())
    (folder / "recipe.json").write_text(recipe().to_json())


def read_texts(path: Path) -> Any:
    """Descriptions that other files hold, as text."""
    from palpate.device.playing.limits import Limits
    from palpate.render import DriveStrategy
    from palpate.render.sweeps.plan.recipe import Recipe

    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise Refused("no text") from error
    kind = {"drive": DriveStrategy, "limits": Limits, "recipe": Recipe}[path.stem]
    return kind.from_json(text)


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


def plan_seeds(folder: Path) -> None:
    own = folder / "plan"
    own.mkdir()
    (own / "study.toml").write_text(PLAN)
    (own / "s.json").write_text(STRATEGY)


def read_plan(folder: Path) -> Any:
    from palpate.render.sweeps.plan.loading import load_plans

    return load_plans([folder / "study.toml"]).described()


def board_seeds(folder: Path) -> None:
    from board_file_cases import board_lines

    own = folder / "rig"
    own.mkdir()
    lines, *_ = board_lines(np.random.default_rng(3))
    (own / "board.pat").write_text("\n".join(lines) + "\n")
    (own / "rig.json").write_text(
        '[{"array": "emulator", "serial": "E1"},'
        ' {"array": "pat16", "calibration": "board.pat", "pose": [0, 0, 0.3, 1, 0, 0, 0]}]'
    )


def read_rig(folder: Path) -> Any:
    from palpate.render import load_rig

    return load_rig(str(folder / "rig.json"))


def ptlist_seeds(folder: Path) -> None:
    from palpate.datasets import write_ptlist

    write_ptlist(folder / "a.ptlist", np.full((20, 3), 0.1), np.linspace(0, 1, 20), 1000.0)


def read_points(path: Path) -> Any:
    from palpate.datasets import read_ptlist

    return read_ptlist(path)
