"""`palpate sweep status`, `failures`, `prune`, `merge`: what each shows, changes, and refuses, by the command line."""

import json
import shutil
import sqlite3
from contextlib import closing

import pytest
from command_line import FAILED, MISUSED, answer, refused, run

from palpate.datasets.sweeps.table import load_table
from palpate.render import InProcess, load_plans, run_sweep
from palpate.render.sweeps.plan.code_version import code_version

PLAN = """
metrics = ["contours", "frequency"]
[object]
source = "cube"
[motion]
duration = 0.2
seed = {first = 1, count = 3}
"""
OPEN = """
metrics = ["contours"]
[object]
source = ["cube", "open.stl"]
[strategy]
source = ["oc", "cc"]
[motion]
duration = 0.5
"""
OLDER = "palpate code of an earlier day"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with the plan, its finished store `a.sweep`, and stores of single seeds: `1.sweep`, `2.sweep`."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "a.toml").write_text(PLAN)
    sweep(folder / "a.toml")
    for seed in (1, 2):
        run_sweep(load_plans([folder / "a.toml"], [f"motion.seed={seed}"]), folder / f"{seed}.sweep", InProcess("cpu"))
    return folder


@pytest.fixture
def path(made, tmp_path):
    """The plan, with copies of these stores beside it."""
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    return tmp_path / "a.toml"


def sweep(path, *arguments):
    return answer("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


def table(told):
    columns = load_table(told["table"])
    return {name: repr(column.tolist()) for name, column in columns.items() if not name.startswith("seconds")}


def rename_maker(store, text=OLDER):
    """Have an earlier code version made all that is there (`PRAGMA user_version` 1 has no digests of names)."""
    from palpate.datasets.sweeps.manifest import row_digest

    with closing(sqlite3.connect(store / "store.sqlite")) as connection, connection:
        connection.execute("UPDATE maker SET maker = ?, digest = ?", (text, row_digest(text)))
        statement = 'SELECT part.id, "group", key, part, payload FROM part'
        for number, *fields in connection.execute(statement).fetchall():
            digest = row_digest(text, *fields[:3], None, None, fields[3])
            connection.execute("UPDATE part SET digest = ? WHERE id = ?", (digest, number))
        statement = "SELECT recipe, sentence FROM failure"
        for recipe, sentence in connection.execute(statement).fetchall():
            values = (row_digest(text, recipe, sentence), recipe)
            connection.execute("UPDATE failure SET digest = ? WHERE recipe = ?", values)


@pytest.mark.exhaustive
def test_shards_of_machines_merge_to_the_table_of_one(path, tmp_path):
    path.write_text(PLAN.replace('"cube"', '["cube", "tube"]'))
    whole = sweep(path)
    parts = [tmp_path / f"part{number}" for number in (1, 2)]
    rendered = [sweep(path, "--store", own, "--shard", f"{number}/2") for number, own in enumerate(parts, 1)]
    assert sum(own["poses_rendered"] for own in rendered) == 6 * 18
    merged = answer("sweep", "merge", tmp_path / "all", *parts)
    assert merged["parts_merged"] == 6 * 2
    assert [own["parts"] > 0 for own in merged["sources"]] == [True] * 2
    told = sweep(path, "--store", tmp_path / "all")
    assert (told["poses_rendered"], told["recipes_failed"]) == (0, 0)
    assert table(told) == table(whole)
    again = answer("sweep", "merge", tmp_path / "all", *parts)
    assert (again["parts_merged"], again["code_version"]) == (0, code_version())


@pytest.mark.exhaustive
def test_stores_of_two_code_versions_are_merged_only_if_asked(path, tmp_path):
    sources = [tmp_path / "1.sweep", tmp_path / "2.sweep"]
    rename_maker(sources[1])
    for message, words in ((f"code versions: {sources[1]} has", [tmp_path / "all", *sources[::-1]]), (OLDER, sources)):
        refused(MISUSED, message, "sweep", "merge", *words)
    assert not (tmp_path / "all").exists()
    told = answer("sweep", "merge", tmp_path / "all", *sources, "--other-code")
    assert (told["parts_merged"], told["code_version"]) == (4, code_version())
    makers = {own["maker"]: own["is_this_code"] for own in answer("sweep", "status", tmp_path / "all")["makers"]}
    assert list(makers.items()) == [(OLDER, False), (code_version(), True)]
    assert answer("sweep", "failures", tmp_path / "all")["maker"] == code_version()
    assert answer("sweep", "failures", sources[1])["maker"] == OLDER
    given = ["--store", tmp_path / "all", "--set", "motion.seed=2"]
    assert sweep(path, *given, "--same-results")["poses_rendered"] == 0


def test_a_source_with_older_results_too_gives_only_those_of_this_code(path, tmp_path):
    rename_maker(tmp_path / "1.sweep")
    sweep(path, "--store", tmp_path / "1.sweep", "--set", "motion.seed=2")
    result = run("sweep", "merge", tmp_path / "all", tmp_path / "1.sweep", "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["parts_merged"] == 2
    assert "results of 1 other code versions were left out" in " ".join(result.stderr.split())


def test_merging_cannot_begin_with_what_is_no_store(path, tmp_path):
    one, mixed, target = tmp_path / "1.sweep", tmp_path / "mixed", tmp_path / "all"
    mixed.mkdir()
    (mixed / "thesis.txt").write_text("mine")
    refused(MISUSED, "cannot be merged into itself", "sweep", "merge", one, mixed / "../1.sweep")
    for words in ((target, mixed), (mixed, one), (target, tmp_path / "missing"), (path, one)):
        refused(MISUSED, "is not a sweep's store", "sweep", "merge", *words)
    assert sorted(own.name for own in mixed.iterdir()) == ["thesis.txt"]
    assert not target.exists()


def test_damage_in_a_source_is_told_and_fails(path, tmp_path):
    with closing(sqlite3.connect(tmp_path / "1.sweep/store.sqlite")) as connection, connection:
        connection.execute("UPDATE part SET payload = '{}' WHERE id = 1")
    result = run("sweep", "merge", tmp_path / "all", tmp_path / "1.sweep", "--json")
    assert result.exit_code == FAILED
    assert json.loads(result.stdout)["parts_merged"] == 1
    assert "these parts were left out" in result.stderr
    checked = run("check", tmp_path / "1.sweep", "--json")
    assert (checked.exit_code, len(json.loads(checked.stdout)["problems"])) == (FAILED, 1)
    assert answer("check", tmp_path / "2.sweep")["problems"] == []


def test_failures_are_shown_by_reason_with_their_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(OPEN)
    (tmp_path / "open.stl").write_text(
        "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0.2\nvertex 0.1 0 0.2\nvertex 0 0.1 0.2\nendloop\n"
        "endfacet\nendsolid\n"
    )
    result = run("sweep", "a.toml", "--device", "cpu", "--workers", "1", "--no-figure")
    assert result.exit_code == FAILED
    told = answer("sweep", "failures", "a.sweep")
    (failure,) = told["failures"]
    assert failure["name"].startswith("open.stl, ")
    assert "cc" in failure["name"]
    assert "open" in failure["sentence"]
    assert len(failure["recipe_hash"]) == 32
    shown = run("sweep", "failures", "a.sweep").stdout
    assert failure["sentence"].split(": ", 1)[1][:20] in " ".join(shown.split())
    assert answer("sweep", "status", "a.sweep")["makers"][0]["failures"] == 1
    (tmp_path / "a.sweep/log.jsonl").unlink()
    (bare,) = answer("sweep", "failures", "a.sweep")["failures"]
    assert (bare["name"], bare["recipe_hash"]) == (failure["recipe_hash"],) * 2
    merged = answer("sweep", "merge", "all.sweep", "a.sweep")
    assert merged["failures_merged"] == 1


def test_status_of_a_store_that_ended(path, tmp_path):
    store = tmp_path / "a.sweep"
    status = answer("sweep", "status", store)
    assert (status["last_run"]["state"], status["last_run"]["plan"]) == ("ended", "a")
    assert (status["parents"], status["shards_waiting"], status["code_version"]) == ([], 0, code_version())
    (maker,) = status["makers"]
    counts = {own["group"]: (own["results"], own["parts"]) for own in maker["groups"]}
    assert counts == {"contours": (3, 3), "frequency": (3, 3)}
    assert status["bytes"]["store.sqlite"] > 10_000
    shown = run("sweep", "status", store).stdout
    assert "(this code)" in shown
    assert "ended" in shown
    with (store / "log.jsonl").open("a") as log:
        log.write('{"time": "2026-01-01", "run": "x", "event": "start", "plan": "b"}\n')
        log.write('{"time": "2026-01-02", "run": "x", "event": "stopped", "sentence": "interrupted"}\n')
    assert answer("sweep", "status", store)["last_run"]["state"] == "stopped: interrupted"
    refused(MISUSED, "is not a sweep's store", "sweep", "status", tmp_path)


@pytest.mark.exhaustive
def test_pruning_keeps_this_code_alone_and_waits_for_no_sweep(path, tmp_path):
    store = tmp_path / "1.sweep"
    assert answer("sweep", "prune", store)["parts_removed"] == 0
    rename_maker(store)
    refused(MISUSED, "so nothing would stay", "sweep", "prune", store)
    sweep(path, "--store", store, "--set", "motion.seed=2")
    before = (store / "store.sqlite").read_bytes()
    dry = answer("sweep", "prune", store, "--dry-run")
    assert (dry["parts_removed"], dry["parts_kept"], dry["code_versions_removed"]) == (2, 2, [OLDER])
    (store / "parents").mkdir()
    (store / "parents/another-host-7-00").write_text("1")
    refused(FAILED, "a sweep runs in it (another-host-7-00)", "sweep", "prune", store)
    assert (store / "store.sqlite").read_bytes() == before
    (store / "parents/another-host-7-00").unlink()
    assert answer("sweep", "prune", store) == dry | {"is_dry_run": False}
    assert [own["maker"] for own in answer("sweep", "status", store)["makers"]] == [code_version()]
    assert sweep(path, "--store", store, "--set", "motion.seed=2")["poses_rendered"] == 0


def test_a_plan_may_have_a_commands_name_behind_a_dot(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(path, "status")
    assert sweep("./status", "--set", "motion.seed=1", "--dry-run")["recipes"] == 1
    result = run("sweep", "run", "a.toml", "--dry-run", "--json")
    assert json.loads(result.stdout)["recipes"] == 3
