"""Files that are no contour files: what palpate itself writes, and commands that take it, are named."""

import json
import re

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from palpate.datasets.recordings.alignment import write_alignment
from palpate.datasets.recordings.sample import write_sample
from palpate.render import FocalPoints, VoxelObject, exploration, save_voxels
from palpate.render.cli.app import app
from palpate.render.exports.contour_tables import HEADER
from palpate.render.exports.focal_points import FOCUS_WRITERS, write_focus
from palpate.render.file_kinds import NOT_READ, described_file
from palpate.render.playback.focal_points import PointSource
from palpate.render.validation import refuse_object

WORDS = {
    "a.stl": "a mesh: palpate info .*a.stl describes it, palpate render .*a.stl MOTION",
    "a.nrrd": "a volume of voxels: palpate render .*a.nrrd MOTION",
    "a.nii.gz": "a volume of voxels",
    "a.npz": "a volume of voxels",
    "hand.npz": "a motion or a recording of a hand: palpate render OBJECT .*hand.npz",
    "poses.csv": "a motion or a recording of a hand: palpate render OBJECT .*poses.csv",
    "exported.csv": "contours as palpate export writes them .*: give their contour file",
    "exported.npz": "contours as palpate export writes them",
    "focus.csv": "focal points as palpate export writes them, .*: give the file that they were exported from",
    "focus.npz": "focal points as palpate export writes them",
    "focus.bin": "focal points as palpate export writes them, which palpate-ultraleap plays",
    "hand.json": "a motion or a recording of a hand",
    "expression.json": "an expression, which is an object: palpate render .*expression.json MOTION",
    "strategy.json": "a strategy: palpate render OBJECT MOTION --strategy .*strategy.json",
    "place.json": "an alignment: palpate render OBJECT RECORDING --alignment .*place.json",
    "plan.toml": "a plan of a sweep: palpate sweep .*plan.toml",
    "cc.vtkhdf": "an export to VTKHDF, which ParaView reads",
    "cc.PTLIST": "a point list: palpate play .*cc.PTLIST takes it",
    "own.py": "Python source: palpate render .*own.py:FUNCTION",
    "a.3mf": "a 3MF file.*: save it as STL",
    "a.step": "a CAD file without triangles: export STL",
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "a.stl")
    solid = VoxelObject(np.pad(np.ones((3, 3, 3), bool), 1), spacing=0.01)
    save_voxels(solid, folder / "a.npz")
    exploration(np.array([[0, 0, 0.1], [0.1, 0.1, 0.2]]), duration=0.5, rate=10.0).save(folder / "poses.csv")
    write_sample("openxr", folder / "hand.json", frame_count=2)
    write_sample("leap", folder / "hand.npz", frame_count=2)
    np.savez(folder / "exported.npz", polyline_start=np.zeros(1, np.int64), points=np.zeros((0, 3)))
    (folder / "exported.csv").write_text(f"{HEADER}\n0,0.0,0,-0.04,-0.04,0.2,hand,1.0\n")
    points = PointSource(FocalPoints(np.zeros((3, 3), np.float32), np.ones(3, np.float32)), update_rate=1e4)
    for suffix in FOCUS_WRITERS:
        write_focus(points, folder, folder / f"focus{suffix}", suffix, watch=lambda done, total: None)
    write_alignment(folder / "place.json", "y-up")
    shape = {"op": "union", "of": [{"op": "sphere", "radius": 0.05}]}
    (folder / "expression.json").write_text(json.dumps(shape, indent=1))
    (folder / "strategy.json").write_text(CliRunner().invoke(app, ["strategies", "cc"]).stdout)
    for name in WORDS.keys() - {path.name for path in folder.iterdir()}:
        (folder / name).write_bytes(b"x")
    return folder


@pytest.mark.parametrize("name", WORDS)
@pytest.mark.parametrize("command", ["check", "info"])
def test_commands_name_what_a_file_is_and_what_takes_it(command, name, files):
    if (command, name) == ("info", "a.stl"):  # it describes meshes
        return
    found = CliRunner().invoke(app, [command, str(files / name)])
    assert found.exit_code != 0
    assert re.search(f"is no contour file but {WORDS[name]}", " ".join(found.output.split()))


@pytest.mark.parametrize("suffix", NOT_READ)
def test_every_format_that_is_not_read_is_described(suffix, tmp_path):
    assert described_file(tmp_path / f"A{suffix.upper()}") == NOT_READ[suffix]


def test_a_contour_file_and_an_unknown_file_are_not_judged_by_their_names(tmp_path):
    for name in ("a.h5", "a.hdf5", "a.txt", "a", "a.bin"):
        (tmp_path / name).write_bytes(b"x")
        assert described_file(tmp_path / name) is None
        refuse_object(tmp_path / name)
    refuse_object(tmp_path / "missing.stl")
