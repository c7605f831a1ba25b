"""Units of every kind, and which of palpate's files ran functions while they were made; a program of its own.

Run in a fresh process, so that nothing is in memory already: python traced_units.py FOLDER.
"""

import json
import os
import sys
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from sweep_recipes import explored, random_motion, recipe_of, recorded, sampling_of, strategy_of, unit_of
from sweep_recipes import thing_of as placed

import palpate.render
from palpate.datasets.motions.motion_file import MotionRows, row_place, write_rows
from palpate.datasets.recordings.sample import write_sample
from palpate.render.objects.functions.expression import expression_to_json, sphere
from palpate.render.sampling.presets import PRESETS as SAMPLINGS
from palpate.render.strategies.intersection_strategy import PRESETS
from palpate.render.sweeps.make.unit_making import make_unit
from palpate.render.sweeps.plan.recipe import GROUPS, digest_source

AT = [0.0, 0.0, 0.2]
WHOLE = ("sampling", "keep-contours", "keep-focal-points", "keep-drives")
BALL = "import warp as wp\n\n\n@wp.func\ndef ball(x: wp.vec3) -> float:\n    return wp.length(x) - 0.05\n"
STAGE = "from palpate.render import register_transform\nregister_transform({!r}, lambda batch, setting: batch)\n"


def objects(folder):
    """Meshes that need each repair, voxels, an expression, a function; placed and simplified."""
    box = trimesh.creation.box((0.1, 0.08, 0.06))
    moved = box.copy().apply_translation((0.04, 0.03, 0.02))
    trimesh.util.concatenate([box, moved]).export(folder / "two.stl")
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(folder / "open.obj")
    z, y, x = np.meshgrid(*[np.arange(24) - 11.5] * 3, indexing="ij")
    np.savez(folder / "ball.npz", values=x**2 + y**2 + z**2 < 81, affine=np.diag([0.005, 0.005, 0.005, 1.0]))
    (folder / "drop.json").write_text(expression_to_json(sphere(0.05)))
    (folder / "shapes.py").write_text(BALL)
    function = f"{folder}/shapes.py:ball"
    own = {"source": function, "name": "ball", "sha256": digest_source(function)}
    yield from ("cube", "dog", placed("tube", fit=0.1, rotate=[10.0, 20.0, 30.0], simplify=0.0))
    yield placed(str(folder / "open.obj"), at=AT, mesh={"fill_holes": True})
    for name in ("two.stl", "ball.npz", "drop.json"):
        yield placed(str(folder / name), at=AT)
    yield placed(function, at=AT, bounds=[-0.06] * 3 + [0.06] * 3) | own


def motions(folder):
    """From files: poses, and each tracker's recording, resampled."""
    pose = np.array([[0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 1.0]] * 3)
    for name in ("a.csv", "a.h5"):
        time = np.arange(3) / 30
        write_rows(folder / name, MotionRows(time, pose, 0.0, None, row_place), overwrite=False)
        yield "palm", recorded(folder / name)
    for tracker, suffix in (("openxr", "json"), ("leap", "json"), ("mediapipe", "json")):
        path = write_sample(tracker, folder / f"{tracker}.{suffix}", frame_count=12)
        for hand in ("planes", "skin"):
            yield hand, recorded(path, rate=90.0)


def recipes(folder):
    """Recipes, and the groups that are made of each."""
    short = explored(0.1, 60.0)
    for thing in objects(folder):
        yield recipe_of(thing, motion=random_motion(600)), ("contours",)
    for hand, motion in motions(folder):
        yield recipe_of("tube", hand, motion), ("contours", "poses")
    (folder / "own_stage.py").write_text(STAGE.format("own"))
    own = {"modules": ["own_stage"], "prune": ["outside"], "transform": ["close", "own"]}
    (folder / "own.json").write_text(json.dumps(own))
    for strategy in (*PRESETS, folder / "own.json"):
        yield recipe_of("dog", "palm", short, strategy_of(strategy)), ("contours", "frequency", "poses")
    for hand in ("planes", "skin"):
        yield recipe_of("dog", hand, short, "cc"), ("contours",)
    for name in SAMPLINGS:
        yield recipe_of("tube", motion=short, sampling=sampling_of(name, update_rate=1000.0)), WHOLE
    for name in ("emulator", "pat16", "autd3"):  # a sonicsurface plays 89 frames a second
        yield recipe_of("tube", motion=short, array=name), tuple(GROUPS)


def main(folder):
    """Print a JSON object as last line: files whose functions ran, and failures."""
    house = os.path.dirname(os.path.dirname(os.path.abspath(palpate.render.__file__)))
    ran, failures = set(), []

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_name != "<module>":
            ran.add(frame.f_code.co_filename)

    for recipe, groups in recipes(folder):
        unit = unit_of([recipe], groups, scratch=folder)
        unit = replace(unit, granted=unit.granted | {recipe.thing["sha256"]})  # of a function
        threading.setprofile(note)
        sys.setprofile(note)
        result = make_unit(unit, "cpu")
        sys.setprofile(None)
        threading.setprofile(None)
        failures += [own.message for own in result.failed] + ([result.refusal] if result.refusal else [])
    files = sorted(os.path.relpath(path, house) for path in ran if path.startswith(f"{house}/"))
    sys.stdout.write("\n" + json.dumps({"ran": files, "failures": failures}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
