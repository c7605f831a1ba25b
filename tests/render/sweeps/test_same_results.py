"""`palpate sweep --same-results`: results of the code before a change count, and everybody is told so."""

import json
import shutil
import sqlite3
import sys
from contextlib import closing

import pytest
from command_line import MISUSED, answer, refused, run

from palpate.datasets.sweeps.table import load_table
from palpate.render.sweeps.plan.code_version import code_version

PLAN = 'metrics = ["contours"]\n[object]\nsource = "cube"\n[motion]\nduration = 0.2\n'
KEEPING = 'keep = ["contours"]\n' + PLAN
OTHER = "palpate code of a later day"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a plan and its finished store."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "a.toml").write_text(PLAN)
    sweep(folder / "a.toml")
    return folder


@pytest.fixture
def path(made, tmp_path):
    """The plan, and its store beside it."""
    return shutil.copytree(made, tmp_path / "own") / "a.toml"


def sweep(path, *arguments):
    return answer("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def change_code(monkeypatch, text=OTHER):
    """Let palpate take itself for another code version."""
    for module in list(sys.modules.values()):
        is_own = getattr(module, "__name__", "").startswith("palpate.")
        if is_own and callable(getattr(module, "code_version", None)):
            monkeypatch.setattr(module, "code_version", lambda: text)


def metrics(told):
    table = load_table(told["table"])
    return repr({name: table[name].tolist() for name in table if not name.startswith(("seconds", "maker"))})


def test_results_before_a_change_are_kept(path, monkeypatch):
    made, store = code_version(), path.with_name("a.sweep")
    before = metrics({"table": store / "table.csv"})
    change_code(monkeypatch)
    told = sweep(path, "--same-results")
    assert (told["poses_rendered"], told["also_results_of"]) == (0, [made])
    assert metrics(told) == before
    text = f"{OTHER}; also results of {made}"
    assert set(load_table(told["table"])["maker"].tolist()) == {text}
    lines = [json.loads(line) for line in (store / "log.jsonl").read_text().splitlines()]
    assert [(line["maker"], line["counted"]) for line in lines if line["event"] == "same-results"] == [(OTHER, [made])]


@pytest.mark.exhaustive
def test_a_plan_that_grows_reads_kept_contours_of_the_code_before(tmp_path, monkeypatch):
    path, made = tmp_path / "a.toml", code_version()
    path.write_text(KEEPING)
    sweep(path)
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "a.sweep/contours").iterdir()}
    change_code(monkeypatch)
    assert sweep(path, "--same-results")["poses_rendered"] == 0
    path.write_text(KEEPING.replace('["contours"]\n[', '["contours", "sampling"]\n['))
    monkeypatch.setattr("palpate.render.intersection.scene.Scene.raw_contours", None)  # nothing is rendered
    again = sweep(path)
    assert (again["recipes_failed"], again["also_results_of"]) == (0, [made])
    assert load_table(again["table"])["complete"].all()
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    assert run("check", tmp_path / "a.sweep").exit_code == 0


def test_without_it_a_change_makes_all_again(path, monkeypatch):
    change_code(monkeypatch)
    told = sweep(path)
    assert (told["poses_rendered"], told["also_results_of"]) == (18, [])
    assert set(load_table(told["table"])["maker"].tolist()) == {OTHER}


def test_the_statement_is_shown_to_people(path, monkeypatch):
    made = code_version()
    change_code(monkeypatch)
    result = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", "--same-results")
    assert result.exit_code == 0
    text = " ".join(result.stderr.split())
    assert f"results that {made} made count from now on as those of {OTHER}" in text


def test_a_dry_run_and_a_sweep_that_is_refused_record_nothing(path, tmp_path, monkeypatch):
    change_code(monkeypatch)
    manifest = path.with_name("a.sweep") / "store.sqlite"
    before = manifest.read_bytes()
    assert answer("sweep", path, "--dry-run", "--device", "cpu", "--same-results")["recipes_done"] == 1
    refused(MISUSED, "gone.h5", "sweep", path, "--same-results", "--baseline", tmp_path / "gone.h5")
    assert manifest.read_bytes() == before
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["recipes_done"] == 0


def test_a_store_without_results_of_other_code_is_refused(path, tmp_path):
    with closing(sqlite3.connect(path.with_name("a.sweep") / "store.sqlite")) as connection:
        before = connection.execute("SELECT * FROM maker").fetchall()
        for arguments in ([], ["--dry-run"]):
            refused(MISUSED, "has no results of another code version", "sweep", path, "--same-results", *arguments)
        assert connection.execute("SELECT * FROM maker").fetchall() == before
    for arguments in ([], ["--dry-run"]):
        none = ["--store", tmp_path / "none.sweep", *arguments]
        refused(MISUSED, "there is no store", "sweep", path, "--same-results", *none)
    assert not (tmp_path / "none.sweep").exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other/thesis.tex").write_text("")
    refused(MISUSED, "not a sweep's store", "sweep", path, "--same-results", "--store", tmp_path / "other")
    assert (tmp_path / "other/thesis.tex").exists()
