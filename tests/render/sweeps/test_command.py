"""`palpate sweep` from plan to table: results, what is made again, an estimate, and what Ctrl-C leaves."""

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh
from command_line import FAILED, MISUSED, PALPATE, answer, refused, run

from palpate.datasets.sweeps.table import load_table
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
source = "tube"
[motion]
source = "random"
count = 400_000
seed = {first = 1, count = 10}
"""
OPEN_MESH = """solid a
facet normal 0 0 1
outer loop
vertex -0.05 -0.05 0.2
vertex 0.05 -0.05 0.2
vertex 0 0.05 0.2
endloop
endfacet
endsolid a
"""


def plan(path, objects=("cube",), seeds=(1, 2), strategies=("oc", "cc"), speeds=(7.0,)):
    listed = {"objects": objects, "seeds": seeds, "strategies": strategies, "speeds": speeds}
    path.write_text(SMALL.format(**{name: json.dumps(list(values)) for name, values in listed.items()}))
    return path


def sweep(*arguments):
    return answer("sweep", "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def rows(report):
    """A table's rows without times, by recipe; in CSV a column of whole numbers loses its decimal points."""
    table = load_table(report["table"])
    names = [name for name in table if not name.startswith("seconds")]
    columns = [[str(value).removesuffix(".0") for value in table[name].tolist()] for name in names]
    return {row[names.index("recipe_hash")]: dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)}


@pytest.mark.exhaustive
def test_a_sweep_is_made_once_and_grows(tmp_path):
    first = answer("sweep", plan(tmp_path / "a.toml"), "--device", "cpu", "--workers", "1")
    assert (first["recipes"], first["poses"], first["poses_rendered"], first["recipes_failed"]) == (4, 720, 720, 0)
    assert (first["executor"], first["chunks_made"], first["recipes_left"]) == ("in this process, on cpu", 8, 0)
    table = load_table(first["table"])
    assert table["complete"].all()
    assert table["object"].tolist() == ["cube"] * 4
    assert (table["length_mean"] > 0).all()
    assert np.isfinite(table["r"]).tolist() == [False, True, False, True]
    assert os.path.getsize(first["figure"]) > 1000
    written, before = os.stat(first["table"]).st_mtime_ns, rows(first)
    again = sweep(tmp_path / "a.toml")
    assert (again["poses_rendered"], again["poses_reused"], again["executor"], again["units"]) == (0, 720, None, 0)
    assert os.stat(first["table"]).st_mtime_ns == written
    more = sweep(plan(tmp_path / "a.toml", seeds=(1, 2, 3), speeds=(5.0, 7.0)))
    # seed 3, and for the second speed the lengths, which are not kept for each pose, once more
    assert (more["recipes"], more["poses_rendered"]) == (12, 2 * 180 + 4 * 180)
    after = rows(more)
    assert len(after) == 12
    assert before.items() <= after.items()


@pytest.mark.exhaustive
def test_shards_leave_recipes_to_others_and_a_merged_store_has_the_table_of_one(tmp_path):
    path = plan(tmp_path / "a.toml", objects=("cube", "tube"))
    whole, stores = sweep(path), [tmp_path / "one", tmp_path / "two"]
    made = [sweep(path, "--store", own, "--shard", f"{number}/2") for number, own in enumerate(stores, 1)]
    assert sum(own["poses_rendered"] for own in made) == whole["poses_rendered"]
    assert [own["recipes_left"] for own in made][::-1] == [8 - own["recipes_left"] for own in made]
    assert not load_table(made[0]["table"])["complete"].all()
    merged = answer("sweep", "merge", *stores)
    assert merged["chunks_merged"] == made[1]["chunks_made"]
    both = sweep(path, "--store", stores[0])
    assert (both["poses_rendered"], both["recipes_left"]) == (0, 0)
    assert rows(both) == rows(whole)
    shown = run("sweep", path, "--device", "cpu", "--store", stores[1], "--shard", "2/2", "--no-figure").stdout
    assert f"{made[1]['recipes_left']} recipes left to other shards: palpate sweep merge joins" in shown


def test_recipes_that_cannot_be_made_are_named_and_the_rest_is_made(tmp_path):
    (tmp_path / "open.stl").write_text(OPEN_MESH)
    path = plan(tmp_path / "a.toml", objects=("cube", "open.stl"))
    result = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", "--json")
    assert result.exit_code == FAILED
    report = json.loads(result.stdout)
    failure, _ = report["failures"]
    assert failure["name"].startswith("open.stl, ")
    assert ", cc, " in failure["name"]
    assert "open edges" in failure["sentence"]
    assert load_table(report["table"])["complete"].tolist() == [True] * 5 + [False, True, False]
    words = ("--summary", tmp_path / "page.md", "--no-figure", "--baseline", tmp_path / "b.csv", "--update-baseline")
    kept = run("sweep", path, "--device", "cpu", *words)
    assert (tmp_path / "page.md").read_text().count("open edges") == 1
    assert kept.exit_code == FAILED
    assert kept.stderr.count("open edges") == 1
    assert "Traceback" not in kept.output
    text = " ".join(kept.stderr.split())
    assert "2 recipes could not be made" in text
    assert "b.csv is not written, because 2 recipes could not be made" in text
    assert not (tmp_path / "b.csv").exists()


@pytest.mark.exhaustive
def test_a_dry_run_names_every_family_that_will_fail(tmp_path, monkeypatch):
    """18 of 120: an open sheet has no closed contours, and each of these strategies needs them."""
    monkeypatch.chdir(tmp_path)
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.Trimesh(box.vertices + np.array([0, 0, 0.2]), box.faces[:-1], process=False).export("sheet.stl")
    assert not trimesh.load_mesh("sheet.stl").is_watertight  # trimesh is the outside truth
    Path("a.toml").write_text(
        'metrics = ["contours"]\n[object]\nsource = ["cube", "sphere", "tube", "sheet.stl"]\n'
        "[motion]\nduration = 0.2\nseed = {first = 1, count = 6}\n"
        '[strategy]\nsource = ["oc", "whole", "cc", "hatch", "circle"]\n'
    )
    found = answer("sweep", "a.toml", "--dry-run", "--device", "cpu")
    assert found["recipes"] == 120
    result = run("sweep", "a.toml", "--device", "cpu", "--workers", "1", "--no-figure", "--json")
    assert result.exit_code == FAILED
    failures = json.loads(result.stdout)["failures"]
    families = {tuple(own["name"].split(", ")[place] for place in (0, 3)) for own in failures}
    assert families == {("sheet.stl", "cc"), ("sheet.stl", "hatch"), ("sheet.stl", "circle")}
    assert len(failures) == 18
    for _, strategy in families:
        assert any("sheet.stl" in problem and strategy in problem for problem in found["problems"])
    assert len(found["problems"]) == len(families)


def test_a_sweep_of_too_many_poses_needs_yes(tmp_path, monkeypatch):
    monkeypatch.setattr(estimate_module, "POSES_MOST", 700)
    path = plan(tmp_path / "a.toml")
    refused(MISUSED, "720 poses to make", "sweep", path, "--device", "cpu")
    assert "more than 700 poses; --yes makes it" in " ".join(run("sweep", path, "--device", "cpu").stderr.split())
    assert "more than 700 poses" in answer("sweep", path, "--dry-run", "--device", "cpu")["refusal"]
    assert "refused without --yes: the plan has 4 recipes" in run("sweep", path, "--dry-run", "--device", "cpu").stdout
    assert sweep(path, "--yes")["poses_rendered"] == 720


@pytest.mark.exhaustive
@pytest.mark.parametrize("workers", ["1", "2"])
def test_ctrl_c_reports_what_is_kept_and_the_same_command_goes_on(tmp_path, workers):
    path, store = tmp_path / "large.toml", tmp_path / "large.sweep"
    path.write_text(LARGE)
    words = [*PALPATE, "sweep", path, "--device", "cpu", "--no-figure", "--json", "--workers", workers]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 120
    while not chunks_of(store):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < until
        time.sleep(0.2)
    assert answer("sweep", "status", store)["is_in_use"]
    refused(FAILED, "is in use by another process", "sweep", path, "--device", "cpu")
    refused(FAILED, "is in use by another process", "sweep", "prune", store)
    time.sleep(1.0)  # progress is known every half second
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == FAILED
    message = json.loads(out)["error"]
    poses = re.search(r"of 10 recipes are done, and this run has rendered ([\d,]+) poses", message)
    assert poses, message
    assert int(poses[1].replace(",", "")) > 0
    assert "Traceback" not in err
    status = answer("sweep", "status", store)
    assert (status["last_run"]["state"], status["is_in_use"]) == ("stopped: KeyboardInterrupt", False)
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["poses_to_render"] < 4_000_000


def chunks_of(store):
    """Number of chunks that a store has; 0 where it is not there yet."""
    result = run("sweep", "status", store, "--json")
    return sum(own["chunks"] for own in json.loads(result.stdout).get("results", ()))
