"""A finished store on a read-only mount: tables and baselines come from it, and what would change it is refused."""

import json
import shlex
import subprocess
import sys

import pytest
from command_line import answer

from palpate.datasets.sweeps.table import load_table

PLAN = """
metrics = ["contours"]
[object]
source = ["cube", "tube"]
[motion]
duration = 0.5
"""
RUN_ALL = """
import json, sys
from command_line import run
done = [run(*words) for words in json.loads(sys.argv[1])]
print(json.dumps([(own.exit_code, own.stdout, own.stderr) for own in done]))
"""


def mounted(store, *words):
    """A command in a mount namespace of its own, where the store is read-only."""
    store = shlex.quote(str(store))
    script = f"mount --bind {store} {store} && mount -o remount,ro,bind {store} && exec {shlex.join(map(str, words))}"
    return subprocess.run(["unshare", "-rm", "sh", "-c", script], capture_output=True, text=True, check=False)


def run_all(store, *commands):
    """Exit code, JSON and messages of commands of palpate there; the store stays as it was."""
    before = content(store)
    listed = [["sweep", *map(str, words), "--json"] for words in commands]
    done = mounted(store, sys.executable, "-P", "-c", RUN_ALL, json.dumps(listed))
    assert (done.returncode, "Traceback" in done.stdout) == (0, False), done.stderr
    assert content(store) == before
    return [(code, json.loads(out), " ".join(err.split())) for code, out, err in json.loads(done.stdout)]


def content(folder):
    return {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*")}


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


@pytest.mark.exhaustive
def test_all_that_only_reads_works(store, tmp_path):
    sweep, all_of, tube = (store.with_suffix(".toml"), "--device", "cpu"), tmp_path / "all.csv", tmp_path / "tube.csv"
    (made, report, _), (partly, part, warning), *others = run_all(
        store,
        (*sweep, "--table", all_of, "--baseline", store, "--summary", tmp_path / "summary.md"),
        (*sweep, "--set", "object.source=tube", "--table", tube),
        ("status", store),
        ("failures", store),
        ("prune", store, "--dry-run"),
        ("merge", tmp_path / "merged", store),
    )
    assert (made, partly, [code for code, *_ in others]) == (0, 0, [0] * 4)
    assert (report["poses_rendered"], report["figure"]) == (0, f"{store}/summary.png")
    assert report["comparison"]["moved"] == []
    for name, column in load_table(report["table"]).items():
        assert repr(column.tolist()) == repr(load_table(all_of)[name].tolist())
    assert not {"table", "figure"} & set(part)
    assert "its own table is of another plan" in warning
    assert load_table(tube)["object"].tolist() == ["tube"]
    assert others[-1][1]["chunks_merged"] == 2
