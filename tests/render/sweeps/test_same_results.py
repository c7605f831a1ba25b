"""`palpate sweep --same-results`: results of the code before a change count, and everybody is told so."""

import json
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import pytest
from command_line import MISUSED, answer, refused, run

from palpate.datasets.sweeps.table import load_table, table_attributes
from palpate.render.sweeps.plan.code_version import code_version

PLAN = """
metrics = ["contours", "sampling"]
keep = ["contours"]
[object]
source = ["cube", "tube"]
[motion]
duration = 0.5
"""
OTHER = "palpate code of a later day"


@pytest.fixture
def path(tmp_path):
    (tmp_path / "a.toml").write_text(PLAN)
    return tmp_path / "a.toml"


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
    return {name: table[name].tolist() for name in table if not name.startswith(("seconds", "maker"))}


def test_results_before_a_change_are_kept(path, monkeypatch):
    first = sweep(path)
    before, made = metrics(first), code_version()
    kept = {file: file.stat().st_mtime_ns for file in (path.parent / "a.sweep/contours").iterdir()}
    change_code(monkeypatch)
    told = sweep(path, "--same-results")
    assert (told["poses_rendered"], told["also_results_of"]) == (0, [made])
    assert repr(metrics(told)) == repr(before)
    assert {file: file.stat().st_mtime_ns for file in kept} == kept
    text = f"{OTHER}; also results of {made}"
    assert set(load_table(told["table"], constants=True)["maker"].tolist()) == {text}
    assert table_attributes(told["table"])["maker"] == text
    lines = [json.loads(line) for line in (path.parent / "a.sweep/log.jsonl").read_text().splitlines()]
    assert [(line["maker"], line["counted"]) for line in lines if line["event"] == "same-results"] == [(OTHER, [made])]
    again = sweep(path)
    assert (again["poses_rendered"], again["also_results_of"]) == (0, [made])
    assert run("check", path.parent / "a.sweep").exit_code == 0


def test_a_plan_that_grows_reads_kept_contours_of_the_code_before(path, monkeypatch):
    path.write_text(PLAN.replace(', "sampling"', ""))
    sweep(path)
    change_code(monkeypatch)
    path.write_text(PLAN)
    monkeypatch.setattr("palpate.render.intersection.scene.Scene.raw_contours", None)  # nothing is rendered
    told = sweep(path, "--same-results")
    assert told["recipes_failed"] == 0
    assert load_table(told["table"])["complete"].all()


@pytest.mark.exhaustive
def test_without_it_a_change_makes_all_again(path, monkeypatch):
    first = sweep(path)
    change_code(monkeypatch)
    told = sweep(path)
    assert told["poses_rendered"] == first["poses_rendered"]
    assert told["also_results_of"] == []
    assert set(load_table(told["table"], constants=True)["maker"].tolist()) == {OTHER}


def test_the_statement_is_shown_to_people(path, monkeypatch):
    sweep(path)
    made = code_version()
    change_code(monkeypatch)
    result = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", "--same-results")
    assert result.exit_code == 0
    text = " ".join(result.stderr.split())
    assert f"results that {made} made count from now on as those of {OTHER}" in text


def test_a_dry_run_counts_them_and_records_nothing(path, monkeypatch):
    sweep(path)
    change_code(monkeypatch)
    manifest = (path.parent / "a.sweep/store.sqlite").read_bytes()
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["recipes_done"] == 0
    assert answer("sweep", path, "--dry-run", "--device", "cpu", "--same-results")["recipes_done"] == 2
    assert (path.parent / "a.sweep/store.sqlite").read_bytes() == manifest
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["recipes_done"] == 0


def test_a_store_without_results_of_other_code_is_refused(path, tmp_path):
    for arguments in ([], ["--dry-run"]):
        refused(MISUSED, "there is no store", "sweep", path, "--same-results", *arguments)
    assert not (tmp_path / "a.sweep").exists()
    sweep(path)
    with closing(sqlite3.connect(tmp_path / "a.sweep/store.sqlite")) as connection:
        before = connection.execute("SELECT * FROM maker").fetchall()
    for arguments in ([], ["--dry-run"]):
        refused(MISUSED, "has no results of another code version", "sweep", path, "--same-results", *arguments)
    with closing(sqlite3.connect(tmp_path / "a.sweep/store.sqlite")) as connection:
        assert connection.execute("SELECT * FROM maker").fetchall() == before
    (tmp_path / "other").mkdir()
    (tmp_path / "other/thesis.tex").write_text("")
    refused(MISUSED, "not a sweep's store", "sweep", path, "--same-results", "--store", tmp_path / "other")
    assert Path(tmp_path / "other/thesis.tex").exists()


def test_a_sweep_that_is_refused_for_another_reason_records_nothing(path, tmp_path, monkeypatch):
    sweep(path)
    change_code(monkeypatch)
    before = (tmp_path / "a.sweep/store.sqlite").read_bytes()
    missing = ["--baseline", tmp_path / "gone.h5"]
    refused(MISUSED, "gone.h5", "sweep", path, "--same-results", *missing)
    assert (tmp_path / "a.sweep/store.sqlite").read_bytes() == before
