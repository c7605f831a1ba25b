"""`palpate sweep` from plan to table: what is made, what is made again, what is refused, and what a kill leaves."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh
from command_line import FAILED, MISUSED, PALPATE, answer, refused, run

from palpate.datasets.sweeps.table import load_table, write_table
from palpate.render.cli import app as cli
from palpate.render.sweeps.run import estimate as estimate_module

SMALL = """
[object]
source = {objects}
[motion]
duration = 2.0
seed = {seeds}
[strategy]
source = {strategies}
[sampling]
speed = {speeds}
"""
LARGE = """
metrics = ["contours"]
[object]
source = ["tube", "dog"]
[motion]
source = "random"
count = 20_000
seed = {first = 1, count = 10}
"""


def plan(path, objects=("cube",), seeds=(1, 2), strategies=("oc", "cc"), speeds=(7.0,)):
    listed = {"objects": objects, "seeds": seeds, "strategies": strategies, "speeds": speeds}
    path.write_text(SMALL.format(**{name: json.dumps(list(values)) for name, values in listed.items()}))
    return path


def sweep(*arguments):
    return answer("sweep", "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def rows(told):
    """A table's rows without times, by recipe."""
    table = load_table(told["table"])
    names = [name for name in table if not name.startswith("seconds")]
    columns = [[repr(value) for value in table[name].tolist()] for name in names]
    return {row[names.index("recipe_hash")]: dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)}


@pytest.mark.exhaustive
def test_a_sweep_is_made_once_and_grows(tmp_path):
    told = answer("sweep", plan(tmp_path / "a.toml"), "--device", "cpu", "--workers", "1")
    assert (told["recipes"], told["poses"], told["poses_rendered"], told["recipes_failed"]) == (4, 720, 720, 0)
    table = load_table(told["table"])
    assert table["complete"].all()
    assert table["object"].tolist() == ["cube"] * 4
    assert (table["length_mean"] > 0).all()
    assert np.isfinite(table["r"]).tolist() == [False, True, False, True]
    assert os.path.getsize(told["figure"]) > 1000
    with h5py.File(told["table"]) as file:
        assert file["length_mean"].attrs["units"] == "m"
    written = os.stat(told["table"]).st_mtime_ns
    again = sweep(tmp_path / "a.toml")
    assert (again["poses_rendered"], again["poses_reused"], again["engine"]) == (0, 720, None)
    assert os.stat(told["table"]).st_mtime_ns == written
    plan(tmp_path / "a.toml", seeds=(1, 2, 3), speeds=(5.0, 7.0))
    more = sweep(tmp_path / "a.toml")
    assert more["recipes"] == 12
    # seed 3, and for the second speed the lengths, which are not kept for each pose, once more
    assert more["poses_rendered"] == 2 * 180 + 4 * 180
    before, after = rows({"table": told["table"]}), rows(more)
    assert len(after) == 12
    assert before.items() <= after.items()


@pytest.mark.exhaustive
def test_a_change_is_caught_against_a_baseline(tmp_path):
    path = plan(tmp_path / "a.toml")
    (tmp_path / "old.csv").write_bytes(b"of an earlier sweep")
    sweep(path, "--overwrite", "--table", tmp_path / "old.csv")
    for old in ("old.csv", "a.sweep"):
        told = sweep(path, "--store", tmp_path / "b.sweep", "--baseline", tmp_path / old)
        assert told["comparison"]["kept"] is True
        assert told["comparison"]["value_count"] > 20
    columns = load_table(tmp_path / "old.csv")
    columns["length_mean"][2] *= 1.001
    write_table(tmp_path / "old.csv", columns)
    result = run("sweep", path, "--device", "cpu", "--baseline", tmp_path / "old.csv")
    assert result.exit_code == FAILED
    assert "length_mean" in result.stderr
    assert run("sweep", path, "--baseline", tmp_path / "old.csv", "--tolerance", "length_mean=0.01").exit_code == 0
    plan(path, seeds=(5,))
    told = sweep(path, "--baseline", tmp_path / "old.csv", "--update-baseline")
    assert told["comparison"]["recipe_count"] == 0  # of another plan, and therefore replaced
    assert len(load_table(tmp_path / "old.csv")["recipe_hash"]) == 2


@pytest.mark.exhaustive
def test_an_updated_baseline_is_kept_from_then_on(tmp_path):
    path, old = plan(tmp_path / "a.toml", seeds=(1,), strategies=("cc",)), tmp_path / "old.csv"
    update = (path, "--baseline", old, "--update-baseline")
    told = sweep(*update)
    assert (told["baseline"], told["comparison"]) == (str(old), None)
    written = old.read_text()
    old.write_text(re.sub(r"0\.(\d{6,}),0\.", r"0.9\1,0.", written, count=1))
    result = run("sweep", path, "--device", "cpu", "--baseline", old)
    assert result.exit_code == FAILED
    result = run("sweep", *update, "--device", "cpu", "--summary", tmp_path / "page.md")
    assert result.exit_code == 0
    assert "what moved" in result.stderr
    assert "#### What moved" in (tmp_path / "page.md").read_text()
    assert old.read_text() == written


def test_recipes_that_cannot_be_made_are_named_and_the_rest_is_made(tmp_path):
    mesh = tmp_path / "open.stl"
    mesh.write_text(
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex -0.05 -0.05 0.2\nvertex 0.05 -0.05 0.2\nvertex 0 0.05 0.2\n"
        "endloop\nendfacet\nendsolid a\n"
    )
    path = plan(tmp_path / "a.toml", objects=("cube", "open.stl"), seeds=(1, 2))
    result = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", "--json")
    assert result.exit_code == FAILED
    told = json.loads(result.stdout)
    failure, _ = told["failures"]
    assert "open" in failure["name"]
    assert "cc" in failure["name"]
    assert "open edges" in failure["sentence"]
    assert load_table(told["table"])["complete"].tolist() == [True] * 5 + [False, True, False]
    summary = ("--summary", tmp_path / "page.md", "--no-figure")
    kept = run("sweep", path, "--device", "cpu", "--baseline", tmp_path / "b.csv", "--update-baseline", *summary)
    assert (tmp_path / "page.md").read_text().count("open edges") == 1
    assert kept.exit_code == FAILED
    assert "2 recipes could not be made" in kept.stderr
    assert kept.stderr.count("open edges") == 1
    assert "Traceback" not in kept.output
    assert "is not written, because 2 recipes could not be made" in " ".join(kept.stderr.split())
    assert not (tmp_path / "b.csv").exists()


def test_a_dry_run_tells_what_to_expect_and_makes_nothing(tmp_path):
    path = plan(tmp_path / "a.toml", speeds=(5.0, 7.0))
    told = answer("sweep", path, "--dry-run", "--device", "cpu", "--set", "motion.seed={first=1,count=5}")
    assert (told["recipes"], told["is_exact"], told["renderings"], told["poses"]) == (20, True, 10, 20 * 180)
    assert told["bytes_table"] == 20 * estimate_module.TABLE_BYTES
    large = estimate_module.Estimate(10**5, False, 0, 1, 1, 1, 1, 1, 900_000_000).sentences()
    assert large[0].startswith("100,000 recipes, about 1 poses")
    assert "memory: about 900 MB while the table is written" in large
    assert told["poses_to_render"] == 10 * 180
    assert (told["families"], told["problems"]) == (2, [])
    assert 0 < told["families_sampled"] <= 2
    assert 0 < told["seconds"] < 60
    assert 0 < told["bytes"] < 1e6
    assert not (tmp_path / "a.sweep").exists()
    shown = run("sweep", path, "--dry-run", "--device", "cpu").stdout
    assert "8 recipes" in shown
    assert "estimate" in shown


@pytest.mark.exhaustive
def test_a_dry_run_counts_a_pose_once_where_it_is_rendered_again_to_be_sampled(tmp_path):
    path = plan(tmp_path / "a.toml", seeds=(1,), strategies=("cc",))
    for metrics in ('["contours"]', '["contours", "sampling"]'):
        words = ("--dry-run", "--device", "cpu", "--set", "motion.duration=1.0", "--set", f"metrics={metrics}")
        told = answer("sweep", path, *words, "--store", tmp_path / "none")
        assert (told["renderings"], told["poses_to_render"]) == (1, 90)


@pytest.mark.exhaustive
def test_a_dry_run_tells_every_recipe_that_will_fail(tmp_path, monkeypatch):
    """18 of 120: an open sheet has no closed contours, and each of these strategies needs them."""
    monkeypatch.chdir(tmp_path)
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.Trimesh(box.vertices + np.array([0, 0, 0.2]), box.faces[:-1], process=False).export(tmp_path / "sheet.stl")
    assert not trimesh.load_mesh(tmp_path / "sheet.stl").is_watertight  # what trimesh thinks of it
    (tmp_path / "a.toml").write_text(
        'metrics = ["contours"]\n[object]\nsource = ["cube", "sphere", "tube", "sheet.stl"]\n'
        "[motion]\nduration = 0.2\nseed = {first = 1, count = 6}\n"
        '[strategy]\nsource = ["oc", "whole", "cc", "hatch", "circle"]\n'
    )
    told = answer("sweep", "a.toml", "--dry-run", "--device", "cpu")
    assert told["recipes"] == 120
    result = run("sweep", "a.toml", "--device", "cpu", "--workers", "1", "--no-figure", "--json")
    assert result.exit_code == FAILED
    failures = json.loads(result.stdout)["failures"]
    families = {tuple(own["name"].split(", ")[name] for name in (0, 3)) for own in failures}
    assert families == {("sheet.stl", "cc"), ("sheet.stl", "hatch"), ("sheet.stl", "circle")}
    assert len(failures) == 18
    for _, strategy in families:
        assert any("sheet.stl" in problem and strategy in problem for problem in told["problems"])
    assert len(told["problems"]) == len(families)


@pytest.mark.exhaustive
def test_a_dry_run_expects_the_bytes_that_kept_files_take(tmp_path):
    path = plan(tmp_path / "a.toml", seeds=(1,), speeds=(5.0, 7.0))
    path.write_text('keep = ["contours", "focal-points", "drives"]\n' + path.read_text())
    told = answer("sweep", path, "--dry-run", "--device", "cpu", "--set", "motion.duration=1.0")
    kept = sweep(path, "--set", "motion.duration=1.0")
    size = sum(file.stat().st_size for file in Path(kept["store"]).rglob("*.h5"))
    assert told["renderings"] == 2
    assert told["bytes"] == pytest.approx(size, rel=0.2)


def test_a_plan_of_a_billion_recipes_is_refused(tmp_path):
    path = plan(tmp_path / "a.toml")
    refused(
        MISUSED, "1,000,000,000 recipes", "sweep", path, "--set", "motion.seed={first=1,count=500_000_000}", "--yes"
    )


def started(path, *arguments):
    command = [*PALPATE, "sweep", str(path), "--device", "cpu", "--no-figure", "--json", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def events(store, name):
    try:
        lines = (store / "log.jsonl").read_text().splitlines()
    except OSError:
        return []
    return [event for event in map(json.loads, lines) if event["event"] == name]


def wait_for(truth, process, seconds=120):
    until = time.monotonic() + seconds
    while not truth():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.01)


@pytest.mark.exhaustive
def test_ctrl_c_tells_what_is_kept(tmp_path):
    path, store = tmp_path / "large.toml", tmp_path / "large.sweep"
    path.write_text(LARGE)
    process = started(path, "--workers", "1")
    wait_for(lambda: events(store, "task"), process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == FAILED
    told = json.loads(out)["error"]
    poses = re.search(r"of 20 recipes are done; ([\d,]+) poses rendered in this run", told)
    assert poses, told
    assert int(poses[1].replace(",", "")) > 0
    assert "Traceback" not in err


def test_ctrl_c_before_the_command_runs_is_told_without_a_traceback(tmp_path, monkeypatch, capsys):
    (tmp_path / "typer.py").write_text("raise KeyboardInterrupt")
    paths = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(PALPATE, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True)
    assert (done.returncode, done.stderr.splitlines()[-1]) == (FAILED, "error: interrupted")
    assert "Traceback" not in done.stderr

    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "app", interrupted)
    assert (cli.exit_code(), "interrupted" in capsys.readouterr().err) == (FAILED, True)


@pytest.mark.exhaustive
def test_a_finished_sweep_imports_no_more_than_it_needs(tmp_path):
    path = plan(tmp_path / "a.toml")
    sweep(path)
    code = (
        "import sys; from palpate.render.cli.app import exit_code\n"
        "sys.argv[1:] = ['sweep', sys.argv[1], '--no-figure']\n"
        "print(exit_code(), {'matplotlib', 'trimesh', 'scipy', 'pyarrow'} & set(sys.modules))"
    )
    out = subprocess.run([sys.executable, "-P", "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert out.stdout.splitlines()[-1] == "0 set()"


@pytest.mark.exhaustive
def test_json_is_one_object_whatever_device_the_plan_leaves_open(tmp_path):
    """In a process of its own, where Warp has not been started: it would print a greeting to standard output."""
    path = plan(tmp_path / "a.toml", seeds=(1,), strategies=("oc",))
    words = [*PALPATE, "sweep", path, "--no-figure", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["recipes"] == 1
    assert "Warp" not in done.stderr


def test_a_place_that_cannot_be_shared_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = plan(tmp_path / "a.toml")
    for url in ("nonsense", "zip://x"):
        refused(MISUSED, f"--share {url}", "sweep", path, "--share", url)
    assert sorted(own.name for own in tmp_path.iterdir()) == ["a.toml"]
