"""`palpate sweep --baseline`: changes are caught, baselines updated, and files that cannot serve refused before."""

import re

import pytest
from command_line import FAILED, MISUSED, answer, refused, run

from palpate.datasets.sweeps.table import load_table, write_table

PLAN = """
[object]
source = "cube"
[motion]
duration = 0.5
seed = {seeds}
[strategy]
source = ["oc", "cc"]
"""


@pytest.fixture
def path(tmp_path):
    return plan(tmp_path / "a.toml", [1, 2])


def plan(path, seeds):
    path.write_text(PLAN.format(seeds=seeds))
    return path


def sweep(path, *arguments):
    return answer("sweep", path, "--device", "cpu", "--workers", "1", "--no-figure", *arguments)


@pytest.mark.exhaustive
def test_a_change_is_caught(path, tmp_path):
    old = tmp_path / "old.csv"
    old.write_bytes(b"of an earlier sweep")
    sweep(path, "--overwrite", "--table", old)
    for baseline in (old, tmp_path / "a.sweep"):
        comparison = sweep(path, "--store", tmp_path / "b.sweep", "--baseline", baseline)["comparison"]
        assert comparison["kept"] is True
        assert comparison["value_count"] > 20
    columns = load_table(old)
    columns["length_mean"][2] *= 1.001
    write_table(old, columns)
    result = run("sweep", path, "--device", "cpu", "--baseline", old)
    assert result.exit_code == FAILED
    assert "length_mean" in result.stderr
    assert run("sweep", path, "--baseline", old, "--tolerance", "length_mean=0.01").exit_code == 0
    comparison = sweep(plan(path, [5]), "--baseline", old, "--update-baseline")["comparison"]
    assert comparison["recipe_count"] == 0  # of another plan, and therefore replaced
    assert len(load_table(old)["recipe_hash"]) == 2


@pytest.mark.exhaustive
def test_an_updated_baseline_holds_from_then_on(path, tmp_path):
    old, page = tmp_path / "old.csv", tmp_path / "page.md"
    update = ("--baseline", old, "--update-baseline")
    report = sweep(path, *update)
    assert (report["baseline"], report["comparison"]) == (str(old), None)
    written = old.read_text()
    old.write_text(re.sub(r"0\.(\d{6,}),0\.", r"0.9\1,0.", written, count=1))
    assert run("sweep", path, "--device", "cpu", "--baseline", old).exit_code == FAILED
    result = run("sweep", path, *update, "--device", "cpu", "--summary", page)
    assert result.exit_code == 0
    assert "what moved" in result.stderr
    assert "#### What moved" in page.read_text()
    assert old.read_text() == written


@pytest.mark.exhaustive
def test_a_baseline_that_cannot_serve_is_refused_before_a_sweep(path, tmp_path):
    store, words = tmp_path / "new.sweep", ("sweep", path, "--store", tmp_path / "new.sweep", "--baseline")
    for name in ("old", "old.xlsx", "."):
        refused(MISUSED, "--update-baseline writes only .csv", *words, tmp_path / name, "--update-baseline")
    refused(MISUSED, "gone.csv does not exist", *words, tmp_path / "gone.csv")
    (tmp_path / "thesis.csv").write_text("year,title\n")
    for more in ([], ["--update-baseline"]):
        refused(MISUSED, "is no table", *words, tmp_path / "thesis.csv", *more)
    (tmp_path / "no.csv").write_bytes(b"no table")
    refused(MISUSED, "no.csv", *words, tmp_path / "no.csv")
    sweep(path)
    old = tmp_path / "a.sweep"
    refused(MISUSED, "no such metric", *words, old, "--tolerance", "lenght_mean=1")
    refused(MISUSED, "--tolerance length_mean=x", *words, old, "--tolerance", "length_mean=x")
    other = plan(tmp_path / "b.toml", [7])
    refused(MISUSED, "no recipe in common", "sweep", other, "--store", store, "--baseline", old)
    assert not store.exists()
    shared = sweep(plan(tmp_path / "c.toml", [3, 2, 1]), "--baseline", old)["comparison"]
    assert (shared["kept"], shared["recipe_count"], len(shared["added"])) == (True, 4, 2)
