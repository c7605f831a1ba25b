"""Sweeps whose stages misbehave, in real processes and on a real cluster: each ends, and healthy recipes are made."""

import contextlib
import json
import os
import random
import signal
import subprocess
import time

import pytest
from bad_stages import REASONS, write_plan
from command_line import PALPATE
from s3_server import s3_bucket

from palpate.datasets.sweeps.table import load_table
from palpate.render.sweeps.run.log import read_log

LIMIT = 150.0
BOUNDS = ["--task-timeout", "3", "--worker-memory", "1000"]


def started(path, *arguments):
    command = [*PALPATE, "sweep", str(path), "--device", "cpu", "--no-figure", "--json", "--allow-code"]
    return subprocess.Popen(
        [*command, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=path.parent
    )


def finished(process):
    out, err = process.communicate(timeout=LIMIT)
    return json.loads(out), err


def rows(table):
    """Of a table, without times."""
    columns = load_table(table)
    names = [name for name in columns if not name.startswith("seconds")]
    values = zip(*([repr(value) for value in columns[name].tolist()] for name in names), strict=True)
    return sorted(dict(zip(names, row, strict=True)).items().__repr__() for row in values)


@pytest.mark.exhaustive
@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("stage", REASONS)
def test_a_stage_that_misbehaves_costs_its_own_recipes(tmp_path, stage, workers):
    path = write_plan(tmp_path, [stage])
    process = started(path, "--workers", workers, *BOUNDS)
    values, err = finished(process)
    assert process.returncode == 1, err
    assert (values["recipes"], values["recipes_failed"]) == (6, 2)
    assert all(f"{stage}.json" in failure["name"] for failure in values["failures"])
    assert all(REASONS[stage] in failure["sentence"] for failure in values["failures"]), values["failures"]
    assert load_table(values["table"])["complete"].sum() == 4


@pytest.mark.exhaustive
@pytest.mark.parametrize("stage", ["fail", "crash", "never-end"])
def test_the_same_on_a_cluster(tmp_path, stage):
    path = write_plan(tmp_path, [stage])
    process = started(path, "--scheduler", "local", "--workers", 2, *BOUNDS)
    values, err = finished(process)
    assert process.returncode == 1, err
    assert (values["recipes"], values["recipes_failed"]) == (6, 2)
    assert all(f"{stage}.json" in failure["name"] for failure in values["failures"])


@pytest.mark.exhaustive
def test_slow_stages_are_not_ended(tmp_path):
    path = write_plan(tmp_path, ["be-slow"])
    process = started(path, "--workers", 2, *BOUNDS)
    values, err = finished(process)
    assert process.returncode == 0, err
    assert (values["recipes_failed"], values["workers_lost"]) == (0, 0)


LARGE = """
[object]
source = ["tube", "cube"]
[motion]
source = "random"
count = 20_000
seed = {first = 1, count = 6}
[strategy]
source = ["oc", "cc"]
"""


@pytest.fixture
def large(tmp_path):
    path = tmp_path / "large.toml"
    path.write_text(LARGE)
    return path


@pytest.mark.exhaustive
def test_two_parents_of_one_store_share_the_work(large):
    processes = [started(large, "--workers", 1) for _ in range(2)]
    (one, _), (other, _) = map(finished, processes)
    assert [process.returncode for process in processes] == [0, 0]
    assert one["poses_rendered"] + other["poses_rendered"] == one["poses"] == 480_000
    alone, _ = finished(started(large, "--workers", 1, "--store", large.parent / "alone.sweep"))
    assert rows(one["table"]) == rows(other["table"]) == rows(alone["table"])
    assert not (large.parent / "large.sweep" / "claims").exists()


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", ["folder", "s3"])
def test_parents_with_stores_of_their_own_share_the_work(large, kind):
    with pytest.MonkeyPatch.context() as patch, contextlib.ExitStack() as stack:
        url = f"file://{large.parent}/shared" if kind == "folder" else f"{stack.enter_context(s3_bucket(patch))}/study"
        share_work(large, url)


def share_work(large, url):
    share = ["--share", url, "--workers", 1]
    stores = [large.parent / "a.sweep", large.parent / "b.sweep"]
    processes = [started(large, *share, "--store", store) for store in stores]
    (one, err), (other, _) = map(finished, processes)
    assert [process.returncode for process in processes] == [0, 0], err
    assert one["poses_rendered"] + other["poses_rendered"] == 480_000
    assert min(one["poses_rendered"], other["poses_rendered"]) > 0
    assert rows(one["table"]) == rows(other["table"])
    assert load_table(one["table"])["complete"].all()
    late, _ = finished(started(large, *share, "--store", large.parent / "late.sweep"))
    assert (late["poses_rendered"], late["engine"]) == (0, None)
    assert rows(late["table"]) == rows(one["table"])


@pytest.mark.exhaustive
def test_a_parent_that_is_killed_leaves_its_work_to_the_other(large):
    first = started(large, "--workers", 1)
    log = large.parent / "large.sweep" / "log.jsonl"
    until = time.monotonic() + LIMIT
    while not (log.exists() and '"event": "task"' in log.read_text()):
        assert time.monotonic() < until
        time.sleep(0.01)
    second = started(large, "--workers", 1)
    time.sleep(1.0)
    first.kill()
    values, err = finished(second)
    first.communicate()
    assert second.returncode == 0, err
    assert load_table(values["table"])["complete"].all()


MOMENTS = int(os.environ.get("PALPATE_KILL_MOMENTS", "5"))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(MOMENTS))
def test_whatever_process_is_killed_at_whatever_moment_the_table_is_the_same(large, seed):
    """200 moments: PALPATE_KILL_MOMENTS=200."""
    rng = random.Random(seed)
    store = large.parent / "large.sweep"
    process = started(large, "--workers", 2)
    time.sleep(rng.uniform(0.0, 6.0))
    for pid in [process.pid, *_children(process.pid)][:: rng.choice((1, -1))][:1]:
        os.kill(pid, signal.SIGKILL)
    process.communicate(timeout=LIMIT)
    log = read_log(store / "log.jsonl")
    recorded = sum(event["poses"] for event in log if event["event"] == "task")
    values, err = finished(started(large, "--workers", 2))
    assert values["recipes_failed"] == 0, err
    assert values["poses_rendered"] + recorded <= 480_000  # what was recorded is not made again
    alone, _ = finished(started(large, "--workers", 1, "--store", large.parent / "alone.sweep"))
    assert rows(values["table"]) == rows(alone["table"])
    assert list((store / "shards").glob("*.h5")) == []


def _children(pid):
    try:
        text = subprocess.run(["pgrep", "-P", str(pid)], stdout=subprocess.PIPE, text=True, check=False).stdout
    except FileNotFoundError:
        return []
    return [int(word) for word in text.split()]
