"""The command line with every kind of object, hand and motion: render -> check -> info -> figure -> play."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import FAILED, MISUSED, answer, refused, run

from palpate.datasets import ContourFile, HandMotion, check_file, load_recording, static_pose
from palpate.datasets.recordings.sample import write_sample
from palpate.render import play_file
from palpate.render.objects.functions.expression import box, expression_to_json, sphere
from palpate.render.playback.file_playback import Connection

DOWN = static_pose([0, 0, 0.2]).pose[0, 3:]
SOLID = (box(0.08, 0.08, 0.08) - sphere(0.03)).moved(0, 0, 0.2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A motion, objects and recordings as files."""
    path = tmp_path_factory.mktemp("representations")
    z = np.linspace(0.25, 0.17, 20)
    pose = np.column_stack([0 * z, 0 * z, z, np.tile(DOWN, (20, 1))])
    HandMotion(np.arange(20) / 90.0, pose).save(path / "sink.csv")
    (path / "cube.npz.glb").write_text("no motion")
    (path / "solid.json").write_text(expression_to_json(SOLID))
    (path / "ball.py").write_text(
        "import warp as wp\n\n\n@wp.func\ndef ball(x: wp.vec3) -> float:\n"
        "    return wp.length(x - wp.vec3(0.0, 0.0, 0.2)) - 0.04\n"
    )
    for form in ("leap", "openxr", "mediapipe"):
        write_sample(form, path / f"{form}.json", frame_count=12)
        palm = load_recording(path / f"{form}.json").skin_pose()[0, :3]
        turn = [0.5**0.5, 0, 0, 0.5**0.5]  # y up becomes z up
        at = np.array([0, 0, 0.2]) - [palm[0], -palm[2], palm[1]]
        (path / f"{form}.align.json").write_text(json.dumps({"position": at.tolist(), "orientation": turn}))
    assert run("voxelise", "cube", "-o", path / "cube.npz", "--spacing", "0.004", "--device", "cpu").exit_code == 0
    return path


def played(path):
    return play_file(path, array="emulator", connection=Connection(clock="virtual")).as_dict()


OBJECTS = {"mesh": ["dog"], "voxels": ["cube.npz"], "expression": ["solid.json"]}
OBJECTS["function"] = ["ball.py:ball", "--allow-code", "--bounds", -0.05, -0.05, 0.15, 0.05, 0.05, 0.25]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("thing", "hand"), [("mesh", "palm"), ("voxels", "planes"), ("expression", "skin"), ("function", "palm")]
)
def test_every_object_is_rendered_on_every_hand_and_played(thing, hand, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    out = tmp_path / "out.h5"
    told = answer("render", OBJECTS[thing][0], "sink.csv", "-o", out, "--hand", hand, *OBJECTS[thing][1:])
    assert told["poses_drawn"] > 5
    assert check_file(out) == []
    assert ("step" in told["strategy"]) == (thing != "mesh" or hand == "skin")
    told = played(out)
    assert told["frames"] > 0
    assert told["board_underruns"] == 0


@pytest.mark.exhaustive
def test_a_picture_shows_voxels_on_a_skin_and_an_object_that_moves(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    z = np.linspace(0.19, 0.22, 20)
    HandMotion(np.arange(20) / 90.0, np.column_stack([0 * z, 0 * z, z, np.tile(DOWN, (20, 1))])).save(
        tmp_path / "m.csv"
    )
    out, picture = tmp_path / "out.h5", tmp_path / "out.png"
    arguments = ["cube.npz", "sink.csv", "-o", out, "--hand", "skin", "--object-motion", tmp_path / "m.csv"]
    assert answer("render", *arguments)["poses_drawn"] > 0
    with ContourFile(out) as file:
        assert file.object()["representation"]["representation"] == "voxels"
        assert file.object()["moved"].shape == (20, 7)
    assert run("figure", out, "-o", picture).exit_code == 0
    assert picture.stat().st_size > 10_000


@pytest.mark.exhaustive
@pytest.mark.parametrize(("form", "hand"), [("leap", "palm"), ("openxr", "planes"), ("mediapipe", "skin")])
def test_every_recording_moves_every_hand(form, hand, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    out = tmp_path / "out.h5"
    arguments = ["solid.json", f"{form}.json", "-o", out, "--hand", hand, "--alignment", f"{form}.align.json"]
    told = answer("render", *arguments, "--rate", 120)
    assert told["poses_drawn"] > 0
    assert told["poses"] > 10
    assert check_file(out) == []
    with ContourFile(out) as file:
        assert np.allclose(np.diff(file.motion()["time"]), 1 / 120)


@pytest.mark.exhaustive
def test_an_open_mesh_is_refused_with_the_way_out_that_works(tmp_path, monkeypatch, folder):
    monkeypatch.chdir(folder)
    (tmp_path / "bowl.off").write_text(
        "OFF\n4 3 0\n0 0 0.18\n0.05 0 0.23\n-0.03 0.05 0.23\n-0.03 -0.05 0.23\n3 0 1 2\n3 0 2 3\n3 0 3 1\n"
    )
    refused(FAILED, "palpate voxelise", "render", tmp_path / "bowl.off", "sink.csv", "-o", tmp_path / "a.h5")
    volume = tmp_path / "bowl.npz"
    words = ("voxelise", tmp_path / "bowl.off", "-o", volume, "--spacing", "0.002", "--device", "cpu")
    volume.write_bytes(b"precious")
    refused(MISUSED, "bowl.npz: exists; --overwrite", *words)
    assert volume.read_bytes() == b"precious"
    answer(*words, "--overwrite")
    assert answer("render", volume, "sink.csv", "-o", tmp_path / "b.h5")["poses_drawn"] > 5


def test_what_pruning_removed_is_in_the_file(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(folder)
    (tmp_path / "s.json").write_text(json.dumps({"prune": ["outside", "turned-away"], "transform": ["close"]}))
    away = HandMotion(None, np.array([[0, 0, 0.2, *(-DOWN[3], 0, 0, DOWN[0])]], np.float32))  # palm up
    away.save(tmp_path / "away.csv")
    out = tmp_path / "out.h5"
    assert (
        answer("render", "tube", tmp_path / "away.csv", "-o", out, "--strategy", tmp_path / "s.json")["poses_drawn"]
        == 0
    )
    with ContourFile(out) as file:
        assert file.metrics()["removed_turned_away"][0] > 0.1
    assert Path(out).stat().st_size > 0
