"""Sweeps on real workers: stages that misbehave cost their own recipes, and a kill at any moment loses nothing."""

import json
import os
import random
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
import warp as wp
from bad_stages import REASONS, write_plan
from command_line import PALPATE

from palpate.datasets.sweeps.merging import check_store
from palpate.datasets.sweeps.table import load_table
from palpate.render import load_plans, run_sweep
from palpate.render.sweeps.run.executors import LocalPool

LIMIT = 240.0
BOUNDS = ["--unit-timeout", "20", "--worker-memory", "1500"]


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
    return sorted(zip(*([repr(value) for value in columns[name].tolist()] for name in names), strict=True))


def children(pid):
    text = subprocess.run(["pgrep", "-P", str(pid)], stdout=subprocess.PIPE, text=True, check=False).stdout
    return [int(word) for word in text.split()]


def require_own_failures(values, stage):
    assert (values["recipes"], values["recipes_failed"]) == (6, 2)
    assert all(f"{stage}.json" in failure["name"] for failure in values["failures"])
    assert all(REASONS[stage] in failure["sentence"] for failure in values["failures"]), values["failures"]


@pytest.mark.exhaustive
@pytest.mark.parametrize("stage", REASONS)
def test_a_stage_that_misbehaves_costs_its_own_recipes(tmp_path, stage):
    process = started(write_plan(tmp_path, [stage]), "--workers", 2, *BOUNDS)
    values, err = finished(process)
    assert process.returncode == 1, err
    require_own_failures(values, stage)
    assert load_table(values["table"])["complete"].sum() == 4


@pytest.fixture
def cluster():
    """A scheduler and two workers as other programs start them."""
    distributed = pytest.importorskip("distributed")
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit="1.5GB", dashboard_address=":0"
        ) as workers,
    ):
        yield workers


@pytest.mark.exhaustive
@pytest.mark.parametrize("stage", ["crash", "sleep-on"])
def test_the_same_on_dask(tmp_path, stage, cluster):
    path = write_plan(tmp_path, [stage])
    values, err = finished(started(path, "--scheduler", cluster.scheduler_address, "--unit-timeout", "25"))
    require_own_failures(values, stage)
    assert "Dask at tcp://" in values["executor"], err


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
MOMENTS = int(os.environ.get("PALPATE_KILL_MOMENTS", "3"))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(MOMENTS))
def test_whatever_process_is_killed_at_whatever_moment_the_table_is_the_same(tmp_path, seed):
    """200 moments: PALPATE_KILL_MOMENTS=200."""
    path, rng = tmp_path / "large.toml", random.Random(seed)
    path.write_text(LARGE)
    process = started(path, "--workers", 2)
    time.sleep(rng.uniform(1.0, 8.0))
    below = children(process.pid)
    for pid in [process.pid, *below][:: rng.choice((1, -1))][:1]:
        os.kill(pid, signal.SIGKILL)
    process.communicate(timeout=LIMIT)
    values, err = finished(started(path, "--workers", 2))
    assert values["recipes_failed"] == 0, err
    alone, _ = finished(started(path, "--workers", 1, "--store", tmp_path / "alone.sweep"))
    assert rows(values["table"]) == rows(alone["table"])
    assert check_store(tmp_path / "large.sweep") == []
    assert not (tmp_path / "large.sweep" / "making").exists()


@pytest.mark.exhaustive
def test_processes_end_with_the_one_that_started_them(tmp_path):
    path = write_plan(tmp_path, ["never-end"])
    process = started(path, "--workers", 2)
    until = time.monotonic() + LIMIT
    while len(below := children(process.pid)) < 2:
        assert time.monotonic() < until
        time.sleep(0.2)
    time.sleep(3.0)
    process.kill()
    process.communicate()
    until = time.monotonic() + 20.0
    while [pid for pid in below if os.path.exists(f"/proc/{pid}")]:
        assert time.monotonic() < until
        time.sleep(0.2)


# Executors of the caller


@pytest.fixture
def plan(tmp_path):
    wp.init()
    path = tmp_path / "plan.toml"
    path.write_text('object.source = ["cube", "tube"]\nmotion.source = "random"\nmotion.count = 300\n')
    return load_plans([path])


def test_threads_never_run_code_of_a_user(tmp_path):
    """Nothing could end a stage that hangs in this process."""
    plan = load_plans([write_plan(tmp_path, ["fail"])], allow_code=True)
    with ThreadPoolExecutor(1) as executor:
        report = run_sweep(plan, tmp_path / "s", executor, device="cpu")
    assert "fail.json" in {failure.name.split(", ")[3] for failure in report.failures}
    assert all("an executor of processes, not of threads" in failure.sentence for failure in report.failures)


def test_this_process_makes_what_takes_seconds_and_processes_the_rest():
    assert LocalPool(4, 0, lambda: 1.0).capacity == 1
    pool = LocalPool(4, 0, lambda: 1.0)
    assert pool.name == "in this process, on cpu"
    assert not pool.is_ready
