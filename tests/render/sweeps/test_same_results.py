"""`palpate sweep --same-results`: results of the code before a change become those of the changed code."""

import shutil
import sys
from importlib import import_module

import pytest
from command_line import MISUSED, answer, refused, run

from palpate.datasets.sweeps.table import load_table
from palpate.render.sweeps.plan.code_version import code_version

PLAN = 'metrics = ["contours"]\n[object]\nsource = "cube"\n[motion]\nduration = 0.2\n'
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
    for name in ("command", "upkeep"):  # imported only now, they would keep the patched function
        import_module(f"palpate.render.sweeps.{name}")
    for module in list(sys.modules.values()):
        is_own = getattr(module, "__name__", "").startswith("palpate.")
        if is_own and callable(getattr(module, "code_version", None)):
            monkeypatch.setattr(module, "code_version", lambda: text)


def metrics(table):
    columns = load_table(table)
    return repr({name: columns[name].tolist() for name in columns if not name.startswith(("seconds", "maker"))})


def test_results_before_a_change_are_taken_over_once(path, monkeypatch):
    before, table = code_version(), path.with_name("a.sweep") / "table.csv"
    values = metrics(table)
    change_code(monkeypatch)
    result = run("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", "--same-results")
    assert result.exit_code == 0
    assert f"--same-results: 1 chunk of {before} now count as those of {OTHER}" in " ".join(result.stderr.split())
    assert sweep(path)["poses_rendered"] == 0
    assert metrics(table) == values
    assert set(load_table(table)["maker"].tolist()) == {OTHER}
    assert {own["code_version"] for own in answer("sweep", "status", table.parent)["results"]} == {OTHER}
    refused(MISUSED, "has no results of another code version", "sweep", path, "--same-results")


def test_a_dry_run_and_a_sweep_that_is_refused_take_nothing_over(path, tmp_path, monkeypatch):
    change_code(monkeypatch)
    file = path.with_name("a.sweep") / "store.sqlite"
    before = file.read_bytes()
    assert answer("sweep", path, "--dry-run", "--device", "cpu", "--same-results")["recipes_done"] == 1
    refused(MISUSED, "gone.csv", "sweep", path, "--same-results", "--baseline", tmp_path / "gone.csv")
    assert file.read_bytes() == before
    assert answer("sweep", path, "--dry-run", "--device", "cpu")["recipes_done"] == 0
