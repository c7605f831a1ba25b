"""A finished store on a read-only mount: tables and baselines come from it, and what would change it is refused."""

import json
import shlex
import subprocess

import pytest
from command_line import FAILED, PALPATE, answer

from palpate.datasets.sweeps.table import load_table

PLAN = """
metrics = ["contours"]
[object]
source = ["cube", "tube"]
[motion]
duration = 0.5
"""


def mounted(store, *words):
    """A command in a mount namespace of its own, where the store is read-only."""
    store = shlex.quote(str(store))
    script = f"mount --bind {store} {store} && mount -o remount,ro,bind {store} && exec {shlex.join(map(str, words))}"
    return subprocess.run(["unshare", "-rm", "sh", "-c", script], capture_output=True, text=True, check=False)


@pytest.fixture
def store(tmp_path):
    (tmp_path / "a.toml").write_text(PLAN)
    answer("sweep", tmp_path / "a.toml", "--device", "cpu", "--workers", "1")
    try:
        probe = mounted(tmp_path / "a.sweep", "touch", tmp_path / "a.sweep/probe")
    except FileNotFoundError:
        pytest.skip("unshare is not installed")
    if "Read-only file system" not in probe.stderr:
        pytest.skip(f"no read-only mount can be made here: {probe.stderr.strip()}")
    return tmp_path / "a.sweep"


def sweep(store, *arguments):
    plan = store.with_suffix(".toml")
    return mounted(store, *PALPATE, "sweep", plan, "--device", "cpu", "--workers", "1", "--json", *arguments)


def content(folder):
    return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*")}


@pytest.mark.exhaustive
def test_tables_and_baselines_come_from_it(store, tmp_path):
    before = content(store)
    out = tmp_path / "out.csv"
    made = sweep(store, "--table", out, "--baseline", store, "--summary", tmp_path / "summary.md")
    assert made.returncode == 0, made.stderr
    told = json.loads(made.stdout)
    assert (told["poses_rendered"], told["table"], told["figure"]) == (
        0,
        f"{store}/table.csv",
        f"{store}/summary.png",
    )
    assert told["comparison"]["moved"] == []
    for name, column in load_table(store / "table.csv").items():
        assert repr(column.tolist()) == repr(load_table(out)[name].tolist())
    assert content(store) == before


@pytest.mark.exhaustive
def test_what_looks_after_a_store_reads_it(store, tmp_path):
    before = content(store)
    for words in (("status", store), ("failures", store), ("prune", store, "--dry-run")):
        assert mounted(store, *PALPATE, "sweep", *words, "--json").returncode == 0
    merged = mounted(store, *PALPATE, "sweep", "merge", tmp_path / "all", store, "--json")
    assert json.loads(merged.stdout)["parts_merged"] == 2
    assert content(store) == before


@pytest.mark.exhaustive
def test_a_part_of_the_plan_is_served_without_the_stores_own_table(store, tmp_path):
    out = tmp_path / "out.csv"
    made = sweep(store, "--set", "object.source=tube", "--table", out)
    assert made.returncode == 0, made.stderr
    told = json.loads(made.stdout)
    assert "table" not in told
    assert "figure" not in told
    assert "its own table is of another plan" in made.stderr
    assert load_table(out)["object"].tolist() == ["tube"]


@pytest.mark.exhaustive
def test_what_it_lacks_is_refused(store):
    before = content(store)
    made = sweep(store, "--set", "motion.seed=5")
    assert made.returncode == FAILED
    assert "cannot be written, and lacks results of at least 2 recipes" in json.loads(made.stdout)["error"]
    for words in (("--same-results",), ("--update-baseline", "--baseline", store / "b.csv")):
        assert sweep(store, *words).returncode != 0
    pruned = mounted(store, *PALPATE, "sweep", "prune", store, "--json")
    assert pruned.returncode == FAILED
    assert "Traceback" not in pruned.stderr
    assert content(store) == before
