"""What the documents of sweeps show is so: plans load, tables are read, the workflow works; CI's own plan is wide."""

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from palpate.datasets.shapes.built_in import shape_names
from palpate.render import MeshObject
from palpate.render.cli.app import app
from palpate.render.sweeps.make.poses import pose_count
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.report.compare import parse_tolerances
from palpate.render.sweeps.report.table import is_metric

ROOT = Path(__file__).parents[3]
SWEEP, CI = (ROOT / "docs/guide" / name for name in ("sweep.md", "sweep-ci.md"))


def blocks(document, language):
    """Blocks of a document in a language, marked or not."""
    return re.findall(rf"^```{language}[^\n]*\n(.*?)^```", document.read_text(), re.MULTILINE | re.DOTALL)


def commands(document):
    """Commands of a document, its workflow's included, as words."""
    text = re.sub(r"(?: \\)?\n {8,}--", " --", document.read_text())  # lines that go on in the next
    return [shlex.split(line) for line in re.findall(r"^ +(palpate sweep .*)$", text, re.MULTILINE)]


def words_about(plan):
    """Numbers of recipes and poses, as the document writes them."""
    recipes = list(plan.recipes())
    return f"{len(recipes):,} recipes, {sum(map(pose_count, recipes)):,} poses"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the plan of the document, and files that plans name."""
    (tmp_path / "study.toml").write_text(blocks(SWEEP, "toml")[0])
    (tmp_path / "ci.toml").write_text(blocks(CI, "toml")[0])
    (tmp_path / "meshes").mkdir()
    tube = MeshObject.load("tube")
    import trimesh

    trimesh.Trimesh(tube.vertices, tube.faces).export(tmp_path / "meshes" / "mine.stl")
    (tmp_path / "strategies").mkdir()
    (tmp_path / "strategies" / "mine.json").write_text('{"raw": "section"}')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_first_plan_has_as_many_recipes_and_poses_as_it_says(folder):
    assert words_about(load_plans([folder / "study.toml"])) in SWEEP.read_text()


@pytest.mark.exhaustive
def test_the_table_is_read_as_the_document_reads_it(folder):
    small = ["motion.duration=4.0", "motion.seed=1", "hand.palm=[0.05,0.05]", 'object.source=["cube","tube"]']
    options = [word for value in small for word in ("--set", value)]
    done = CliRunner().invoke(app, ["sweep", "study.toml", "--device", "cpu", "--workers", "1", "--json", *options])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["recipes"] == 6
    said = {}
    reading = next(block for block in blocks(SWEEP, "python") if "read_csv" in block)
    exec(reading.replace("print(", "said = ("), said)  # what a user types
    assert said["said"].sel(object="tube", strategy="cc").item() > 1
    assert said["frame"].shape[0] == 6
    assert said["data"].sizes == {"object": 2, "palm_width": 1, "seed": 1, "strategy": 3}
    files = set(re.findall(r"`([a-z0-9.]+)`", SWEEP.read_text().split("| `study.sweep/` | is |")[1].split("![")[0]))
    assert {"table.csv", "summary.png", "store.sqlite"} <= files & {p.name for p in Path("study.sweep").iterdir()}


@pytest.mark.parametrize("document", [SWEEP, CI], ids=lambda path: path.name)
def test_commands_have_options_that_there_are(document):
    known = {option for own in get_command(app).commands["sweep"].commands["run"].params for option in own.opts}
    found = commands(document)
    assert found
    for words in found:
        assert {word for word in words if word.startswith("--")} <= known
        named = [words[k + 1] for k, word in enumerate(words) if word == "--tolerance"]
        assert all(is_metric(t.columns) or "*" in t.columns for t in parse_tolerances(named))


def test_the_plan_of_palpates_own_ci_is_wide_and_large():
    plan = load_plans([ROOT / ".ci" / "sweep.toml"])
    recipes = list(plan.recipes())
    rendered = {one.key("contours"): pose_count(one) for one in recipes}
    assert sum(rendered.values()) >= 100_000
    assert (
        f"{len(recipes)} recipes, {len(rendered)} renderings of {sum(rendered.values()):,} poses"
        in (ROOT / ".ci" / "sweep.toml").read_text()
    )
    assert {one.thing["source"] for one in recipes} == set(shape_names())
    assert {one.hand["source"] for one in recipes} == {"palm", "planes"}
    assert {one.motion["source"] for one in recipes} == {"exploration", "random"}
    assert {"oc", "cc"} < {one.strategy["name"] for one in recipes}
    assert plan.groups == ("contours", "frequency", "sampling")
    assert plan.device == "cpu"
    stages = json.dumps([one.strategy["described"] for one in recipes])
    assert all(f'"{stage}"' in stages for stage in ("small", "turned-away", "hatch", "inset", "corners", "contact"))
