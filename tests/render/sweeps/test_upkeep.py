"""`palpate sweep status`, `failures`, `prune`, `merge`: their reports, changes, and refusals, by the command line."""

import json
import shutil
import sqlite3
from contextlib import closing

import pytest
from command_line import FAILED, MISUSED, answer, refused, run

from palpate.datasets import SweepStore
from palpate.datasets.sweeps.store import Failure
from palpate.render.sweeps.plan.code_version import code_version

PLAN = """
metrics = ["contours", "frequency"]
[object]
source = "cube"
[motion]
duration = 0.2
seed = {first = 1, count = 3}
"""
OLDER = "palpate code of an earlier day"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the plan, its finished store `a.sweep`, and stores of single seeds: `1.sweep`, `2.sweep`."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "a.toml").write_text(PLAN)
    sweep(folder / "a.toml")
    for seed in (1, 2):
        sweep(folder / "a.toml", "--set", f"motion.seed={seed}", "--store", folder / f"{seed}.sweep")
    return folder


@pytest.fixture
def path(made, tmp_path):
    """The plan, with copies of these stores beside it."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "a.toml"


def sweep(path, *arguments):
    return answer("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def age(store):
    """Have an earlier code version made all that is there."""
    with SweepStore(store, OLDER, mode="write") as own:
        assert own.take_results_of(code_version()) == 2


def content(store):
    return {file.name: file.read_bytes() for file in store.iterdir()}


def test_stores_are_joined_once(path, tmp_path):
    target, sources = tmp_path / "all", [tmp_path / "1.sweep", tmp_path / "2.sweep"]
    before = [content(own) for own in sources]
    merged = answer("sweep", "merge", target, *sources, sources[0])
    assert (merged["chunks_merged"], merged["code_version"]) == (4, code_version())
    assert [own["chunks"] for own in merged["sources"]] == [2, 2]
    assert answer("sweep", "merge", target, *sources)["chunks_merged"] == 0
    assert sweep(path, "--store", target)["poses_rendered"] == 18  # of seed 3
    assert [content(own) for own in sources] == before


def test_stores_of_two_code_versions_are_refused_and_those_of_one_are_joined(tmp_path, path):
    sources = [tmp_path / "1.sweep", tmp_path / "2.sweep"]
    age(sources[1])
    for words in ([tmp_path / "all", *sources], [tmp_path / "all", *sources[::-1]], sources):
        refused(MISUSED, f"{sources[1]} has {OLDER}", "sweep", "merge", *words)
    assert not (tmp_path / "all").exists()
    age(sources[0])
    merged = answer("sweep", "merge", tmp_path / "all", *sources)
    assert (merged["code_version"], merged["chunks_merged"]) == (OLDER, 4)
    assert answer("sweep", "failures", tmp_path / "all")["code_version"] == OLDER


def test_damage_in_a_source_is_named_and_left_out(path, tmp_path):
    with closing(sqlite3.connect(tmp_path / "1.sweep/store.sqlite")) as connection, connection:
        connection.execute("UPDATE result SET payload = '{}' WHERE rowid = 1")
    result = run("sweep", "merge", tmp_path / "all", tmp_path / "1.sweep", "--json")
    assert (result.exit_code, json.loads(result.stdout)["chunks_merged"]) == (FAILED, 1)
    assert "does not have its digest; it was left out" in " ".join(result.stderr.split())
    checked = run("check", tmp_path / "1.sweep", "--json")
    assert (checked.exit_code, len(json.loads(checked.stdout)["problems"])) == (FAILED, 1)
    assert answer("check", tmp_path / "2.sweep")["problems"] == []


def test_failures_are_shown_by_reason_with_their_names(tmp_path):
    store, reason = tmp_path / "a.sweep", "a surface with 3 open edges"
    failures = [Failure(f"{k:032x}", f"open.stl, seed {k}", f"open.stl, seed {k}: {reason}") for k in (1, 2)]
    with SweepStore(store, code_version(), mode="write") as own:
        own.replace_failures(failures)
    assert answer("sweep", "failures", store)["failures"] == [vars(failure) for failure in failures]
    shown = " ".join(run("sweep", "failures", store).stdout.split())
    assert f"open.stl, seed 1 and 1 more {reason}" in shown
    assert answer("sweep", "status", store)["recipes_failed"] == {code_version(): 2}
    assert "recipes that failed 2" in " ".join(run("sweep", "status", store).stdout.split())
    assert answer("sweep", "merge", tmp_path / "all.sweep", store)["failures_merged"] == 2


def test_pruning_keeps_this_code_alone(path, tmp_path):
    store, words = tmp_path / "1.sweep", ("--store", tmp_path / "1.sweep", "--set", "motion.seed=2")
    assert answer("sweep", "prune", store)["chunks_removed"] == 0
    age(store)
    before = content(store)
    refused(MISUSED, "so nothing would stay", "sweep", "prune", store)
    assert content(store) == before
    sweep(path, *words)
    before = content(store)
    dry = answer("sweep", "prune", store, "--dry-run")
    assert (dry["chunks_removed"], dry["chunks_kept"], dry["code_versions_removed"]) == (2, 2, [OLDER])
    with SweepStore(store, OLDER, mode="write"):
        refused(FAILED, "is in use by another process", "sweep", "prune", store)
    assert content(store) == before
    assert answer("sweep", "prune", store) == dry | {"is_dry_run": False}
    assert {own["code_version"] for own in answer("sweep", "status", store)["results"]} == {code_version()}
    assert sweep(path, *words)["poses_rendered"] == 0
