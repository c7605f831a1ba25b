"""What people type wrong at first, and the way out that the answer names; nothing is written."""

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.datasets import write_sample
from palpate.render.cli.app import app

POSES = "time,x,y,z,qx,qy,qz,qw\n0,0,0,0.2,0.7071068,0,0,0.7071068\n0.1,0,0,0.21,0.7071068,0,0,0.7071068\n"
RENDER = "render cube m.csv -o new.h5 "
VOLUME = "render block.npz m.csv -o new.h5 "
MISTAKES = {
    "rendr cube m.csv -o new.h5": "Did you mean 'render'?",
    "Figure cube.h5": "'-o' / '--out'",
    "info tueb": "did you mean 'tube'?",
    "info .": "is a folder",
    "render grab.npz tube -o new.h5": "it is a motion, after the object",
    "render cube m.csv -o new.h5 --simplify 1": "1 mm are 0.001",
    "render cube m.csv -o new.h5 --sampling stm": "No such option: --sampling, which is of play, live, prepare, export",
    "render cube m.csv -o new.h5 --strategy stm": "is for sample and play",
    "figure cube.h5 -o nosuch/new.png": "cannot be written",
    "sweep statuss nosuch": "did you mean 'status'?",
    "render": "'OBJECT'. It is: Mesh (STL, OBJ",
    "render cube": "'MOTION'. It is: CSV or HDF5 of poses",
    "render cube m.csv new.h5 -o new.h5": "(new.h5): this command takes OBJECT MOTION",
    "render mug.stl m.csv -o new.h5": "built-in objects are cube, sphere",
    "render cube explore -o new.h5": "give the word exploration for a synthetic one",
    "render cube mm.csv -o new.h5": "did you mean 'm.csv'?",
    "render cube headless.csv -o new.h5": "header 't,x,y,z' is not 'time,x,y,z,qx,qy,qz,qw'",
    "render cube m.csv -o cube.h5": "--overwrite replaces it",
    "render cube m.csv -o nosuch/new.h5": "there is no folder",
    "render cube m.csv -o new.txt": "must end in .h5 or .hdf5",
    RENDER + "--strategy hacth": "did you mean 'hatch'?",
    RENDER + "--stratgy cc": "Possible options: --rate, --strategy",
    RENDER + "--palm 85": "--palm takes 2 values, WIDTH LENGTH, with blanks between",
    RENDER + "--palm 85 85": "85 mm are 0.085",
    RENDER + "--hand palmm": "did you mean 'palm'?",
    "render cube exploraton -o new.h5": "did you mean 'exploration'?",
    "play cube.h5 --duration 0": "--duration must be positive",
    RENDER + "--device gpu": "GPUs are cuda:0",
    RENDER + "--duration 5": "--duration is for a synthetic exploration",
    RENDER + "--gzip 30": "must be at most 9, not 30",
    "render cube exploration -o new.h5 --rate 90Hz": "'90Hz' is no number. Poses a second",
    "render cube m.csv -o new.h5 --strategy cube.h5": "not JSON, which is text",
    "play": "'FILE'. It is: Contour file",
    "play tube": "palpate render tube exploration -o tube.h5 makes one",
    "play cub.h5": "did you mean 'cube.h5'?",
    "play cube.h5 --array pat16": "--calibration BOARD.pat, --emulate or --uncalibrated",
    "play cube.h5 --array pat16 --calibration nosuch.pat": "nosuch.pat: cannot be read",
    "play cube.h5 --array pat61": "did you mean 'pat16'?",
    "play cube.h5 --speed 7000": "7000 mm/s are 7",
    "play cube.h5 --clock fast": "must be one of monotonic, virtual",
    "export cube.h5 -o new.txt": "must end in one of .vtkhdf, .csv, .npz, .ptlist",
    "info nosuch.h5": "does not exist",
    "voxelise dog -o new.npz --spacing 1": "1 mm are 0.001",
    "sweep": "Try 'palpate sweep --help' for help.",
    "sweep plam.toml": "did you mean 'plan.toml'?",
    "sweep cube": "a plan is a TOML file",
    "sweep status nosuch.sweep": "is not a sweep's store",
    "voxelise dog -o new.npz --spacing 0": "--spacing must be a positive length in metres, not 0",
    "voxelise dog -o new.npz --spacing 0.01 --kind x": "--kind must be one of distance, occupancy, not 'x'",
    RENDER + "--fit -1": "fit must be",
    RENDER + "--simplify nan": "--simplify must be a length in metres of 0 or more, not nan",
    VOLUME + "--unit inch": "--unit must be one of m, cm, mm, um, not 'inch'",
}
FAILURES = [f"render cube {words}" for words in ("headless.csv -o new.h5", "m.csv -o cube.h5")]
"""Lines whose files are at fault; others are misuse."""


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder as one has it after a first rendering."""
    folder = tmp_path_factory.mktemp("desk")
    (folder / "m.csv").write_text(POSES)
    (folder / "headless.csv").write_text("t,x,y,z\n0,0,0,0.2\n")
    write_sample("leap", folder / "grab.npz")
    np.savez(folder / "block.npz", values=np.ones((2, 2, 2), bool), affine=np.diag([0.005, 0.005, 0.005, 1.0]))
    (folder / "plan.toml").write_text("[object]\nsource = 'cube'\n")
    done = CliRunner().invoke(app, ["render", "cube", str(folder / "m.csv"), "-o", str(folder / "cube.h5"), "-q"])
    assert done.exit_code == 0, done.output
    return folder


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_answered_by_the_way_out(line, desk, monkeypatch):
    monkeypatch.chdir(desk)
    before = sorted(path.name for path in desk.rglob("*"))
    done = CliRunner().invoke(app, line.split(), terminal_width=200)
    said = " ".join(done.stderr.split())
    assert done.exit_code == (1 if line in FAILURES else 2), said
    assert MISTAKES[line] in said
    assert "unexpected;" not in said  # what palpate says of its own bugs
    assert "Traceback" not in said
    assert sorted(path.name for path in desk.rglob("*")) == before


@pytest.mark.parametrize("line", ["help", "-h", "--help", "help render", "render -h", "sweep -h", "help sweep status"])
def test_help_is_found_however_it_is_asked_for(line):
    done = CliRunner().invoke(app, line.split())
    assert done.exit_code == 0
    assert done.stdout.lstrip().startswith("Usage: ")


def test_names_are_found_in_any_case(desk, tmp_path):
    line = f"Render CUBE {desk / 'm.csv'} -o {tmp_path / 'new.h5'} --device CPU --up Z --strategy CC -q"
    assert CliRunner().invoke(app, line.split()).exit_code == 0


def test_a_sweep_over_a_motion_in_millimetres_warns_as_render_does(desk, tmp_path):
    (tmp_path / "mm.csv").write_text(POSES.replace("0.2,", "200,").replace("0.21,", "210,"))
    (tmp_path / "plan.toml").write_text("object.source = 'cube'\nmotion.source = 'mm.csv'\n")
    done = CliRunner().invoke(app, ["sweep", str(tmp_path / "plan.toml"), "--no-figure"])
    assert (done.exit_code, done.stderr.count("210 mm are 0.21")) == (0, 1)
    rendered = CliRunner().invoke(app, ["render", "cube", str(tmp_path / "mm.csv"), "-o", str(tmp_path / "mm.h5")])
    assert "mm.csv: positions reach 210 m; lengths are in metres, 210 mm are 0.21" in rendered.stderr
    assert "points=" not in rendered.stderr


def test_several_files_are_shown_and_checked_in_turn(desk, tmp_path):
    broken = tmp_path / "broken.h5"
    broken.write_bytes((desk / "cube.h5").read_bytes()[:-10])
    told = CliRunner().invoke(app, ["info", str(desk / "cube.h5"), str(desk / "cube.h5"), "--json"])
    assert len(told.stdout.splitlines()) == 2
    checked = CliRunner().invoke(app, ["check", str(desk / "cube.h5"), str(broken), str(desk / "cube.h5"), "--json"])
    assert checked.exit_code == 1
    assert [
        f'"whole": {word}' in line
        for line, word in zip(checked.stdout.splitlines(), ("true", "false", "true"), strict=True)
    ] == [True] * 3


def test_one_strategy_is_printed_as_the_json_that_render_takes(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(CliRunner().invoke(app, ["strategies", "Inset_Hatch"]).stdout)
    again = CliRunner().invoke(app, ["strategies", str(path)])
    assert again.stdout == path.read_text()
