"""`palpate figure` and `palpate strategies -o`: options, what is written, and a sentence for every mistake."""

import json
from pathlib import Path

import pytest
from command_line import MISUSED, answer, refused, run

from palpate.render import MeshObject, exploration, render


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """OC, CC and a hatched contact of a cube that a palm explores for 2 s."""
    folder = tmp_path_factory.mktemp("explored")
    cube = MeshObject.load("cube")
    motion = exploration(cube.bounds, duration=2.0, rate=30.0, seed=1)
    return [render(cube, "palm", motion, name).save(folder / f"{name}.h5") for name in ("oc", "cc", "hatch")]


@pytest.mark.exhaustive
def test_a_picture_has_the_times_views_labels_and_array_asked_for(files, tmp_path):
    out = tmp_path / "a.svg"
    options = (
        "--times",
        "0.4,0.6",
        "--view",
        "palm",
        "--label",
        "open one",
        "--label",
        "closed one",
        "--array",
        "pat16",
        "--width",
        "double",
        "--font-size",
        "7",
    )
    assert answer("figure", *files[:2], "-o", out, *options) == {"picture": str(out)}
    content = out.read_text()
    for text in ("open one", "closed one", "0.40 s", "0.60 s", "pat16, 256 transducers", "50 mm"):
        assert text in content, text
    refused(MISUSED, "exists", "figure", files[0], "-o", out)
    answer("figure", *files[1:], "-o", out, "--overwrite", "--no-array", "--view", "-30,45", "--times", "0.6")
    content = out.read_text()
    assert "transducers" not in content
    for text in ("cc", "hatch", "made by a stage"):
        assert f">{text}<" in content, text


MISTAKES = {
    "--times 9": "time 9 s is outside",
    "--times 0.4,x": "--times must be numbers with commas between",
    "--times 0,0.01": "shows pose 0 again",
    "--view upside": "unknown view 'upside'",
    "--view 100,0": "between -90 and 90 degrees",
    "--array nosuch": "unknown array 'nosuch'",
    "--label= --label two": "--label must be a name, not an empty text",
    "--no-array --array emulator": "--array and --no-array exclude each other",
    "--label one": "--label must be given once for each file: 1 for 2 files",
    "--label one --label one": "two files are named alike",
    "--width 300": "width must lie in 0.06..0.6 m, not 300.0; lengths are in metres",
    "--width wide": "unknown width 'wide'",
    "--font-size 99": "font size must lie in 4..14 points, not 99",
}


@pytest.mark.parametrize("options", MISTAKES)
def test_mistakes_are_one_sentence_and_nothing_is_written(files, tmp_path, options):
    refused(MISUSED, MISTAKES[options], "figure", *files[:2], "-o", tmp_path / "a.png", *options.split())
    assert list(tmp_path.iterdir()) == []


MINE = {"prune": ["outside"], "transform": ["close", {"stage": "inset", "distance": 0.004}, "hatch"]}


@pytest.mark.exhaustive
def test_ones_own_strategy_is_drawn_beside_its_raw_intersection(tmp_path):
    mine, out = tmp_path / "mine.json", tmp_path / "mine.svg"
    mine.write_text(json.dumps(MINE))
    told = answer("strategies", mine, "cc", "-o", out)
    assert told["picture"] == str(out)
    assert list(told["strategies"]) == ["mine", "cc"]
    assert told["strategies"]["mine"]["transform"] == MINE["transform"]
    content = out.read_text()
    assert content.count(">raw: section<") == 1  # both begin with it
    for text in (">mine<", ">cc<", "inset, distance 0.004", "made by a stage"):
        assert text in content, text
    assert "pause" not in content  # a mark that is not there is not explained
    refused(MISUSED, "exists", "strategies", mine, "-o", out)


def test_strategies_are_printed_one_at_a_time_and_unknown_ones_refused(tmp_path):
    assert json.loads(run("strategies", "cc", "--json").stdout)["transform"] == ["close"]
    refused(MISUSED, "one strategy is printed at a time", "strategies", "cc", "oc")
    refused(MISUSED, "unknown strategy 'cz'", "strategies", "cz", "-o", tmp_path / "a.png")
    refused(MISUSED, "must end in one of", "strategies", "cc", "-o", tmp_path / "a.gif")
    assert not Path(tmp_path / "a.png").exists()


def test_code_of_ones_own_strategy_runs_only_with_permission(tmp_path):
    (tmp_path / "own_stage.py").write_text(
        "from palpate.render import register_transform\n"
        "@register_transform('halved')\n"
        "def halved(batch, scene):\n"
        "    '''The same.'''\n"
        "    return batch\n"
    )
    mine = tmp_path / "mine.json"
    mine.write_text(json.dumps({**MINE, "transform": ["close", "halved"], "modules": ["own_stage"]}))
    refused(MISUSED, "--allow-code", "strategies", mine, "-o", tmp_path / "a.png")
    assert not (tmp_path / "a.png").exists()
