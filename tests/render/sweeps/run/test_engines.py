"""Engines of one host: every task comes back once, whatever becomes of workers; no worker outlives its parent."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
import sweep_works
import warp as wp
from sweep_recipes import random_motion, recipe_of, task_of

from palpate.datasets.sweeps.shard import read_shard
from palpate.render.errors import PalpateWarning, StrategyError, SweepError
from palpate.render.stages import registry
from palpate.render.stages.registry import known_stages
from palpate.render.sweeps.make.task import Chunk, Task
from palpate.render.sweeps.make.work import run_task
from palpate.render.sweeps.run import engine as engine_module
from palpate.render.sweeps.run import worker_process as worker_process_module
from palpate.render.sweeps.run.dask_engine import DaskEngine
from palpate.render.sweeps.run.engine import InProcess, LocalEngine, _is_python, choose_engine
from palpate.render.sweeps.run.messages import Frames, frame
from palpate.render.sweeps.run.processes import DEATHS_MOST, Processes

CHUNKS = (Chunk("{}", ("contours",)),)


def tasks_of(store, *names):
    return [Task(number, CHUNKS, str(store), name) for number, name in enumerate(names)]


def make(engine, tasks, longest=90.0):
    """Outcomes of tasks by number, given to workers in order; fails unless all come, each once."""
    return gather(engine, len(tasks), longest, tasks)


def gather(engine, count, longest=90.0, tasks=()):
    """Outcomes by number; fails unless so many come, each once."""
    outcomes, left, until = [], list(tasks), time.monotonic() + longest
    while len(outcomes) < count and time.monotonic() < until:
        while left and engine.free_count():
            engine.submit(left.pop(0))
        outcomes += engine.wait(1.0)
    numbers = [outcome.number for outcome in outcomes]
    assert sorted(numbers) == sorted(set(numbers))
    assert len(numbers) == count
    return {outcome.number: outcome for outcome in outcomes}


def said(store):
    """Numbers begun and by which process, in order."""
    path = store / "said"
    return [tuple(map(int, line.split())) for line in path.read_text().splitlines()] if path.exists() else []


def await_true(condition, longest=90.0, engine=None):
    until = time.monotonic() + longest
    while not condition():
        assert time.monotonic() < until
        if engine is not None:
            engine.running()
        time.sleep(0.01)


def is_alive(pid):
    """Whether a process is there and no zombie."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Two workers, which heal."""
    engine = started(tmp_path_factory.mktemp("store"), 2)
    yield engine
    engine.close()


@pytest.fixture
def engine(shared):
    """The two workers, ready and without anything to do."""
    await_true(lambda: shared.free_count() == 2, engine=shared)
    return shared


@pytest.fixture
def in_process(tmp_path):
    engine = InProcess("cpu", work=sweep_works.do)
    engine.start(tmp_path)
    return engine


def started(store, worker_count):
    """Processes that are all ready."""
    engine = Processes(["cpu"] * worker_count, work=sweep_works.do)
    engine.start(store)
    engine.grow(worker_count)
    await_true(lambda: engine.free_count() == worker_count, engine=engine)
    return engine


def test_messages_come_out_of_any_pieces():
    messages = [{"a": 1}, "b" * 1000, None]
    stream = b"".join(frame(message) for message in messages)
    for size in (1, 7, 500, len(stream)):
        frames = Frames()
        out = [m for k in range(0, len(stream), size) for m in frames.take(stream[k : k + size])]
        assert out == messages


def test_this_process_makes_tasks_in_order(in_process, tmp_path):
    outcomes = make(in_process, tasks_of(tmp_path, "done", "refuse told", "exit 3", "done", "refuse"))
    assert [number for number, _ in said(tmp_path)] == [0, 1, 2, 3, 4]
    assert outcomes[0].error is None
    assert re.fullmatch(r"worker 0 \(pid \d+, cpu\): this cannot be made", outcomes[1].error)
    assert outcomes[2].error.endswith("called exit(3)")
    assert outcomes[4].error.endswith("ZeroDivisionError: ")
    assert not any(o.is_lost for o in outcomes.values())
    assert in_process.wait(0.0) == []
    assert in_process.running() == {}


def test_ctrl_c_passes_through_this_process(tmp_path):
    def interrupted(task, device, *, worker, progress):
        raise KeyboardInterrupt

    engine = InProcess("cpu", work=interrupted)
    engine.start(tmp_path)
    engine.submit(tasks_of(tmp_path, "done")[0])
    with pytest.raises(KeyboardInterrupt):
        engine.wait(0.0)


def test_this_process_names_a_device_that_is_missing(tmp_path):
    with pytest.raises(SweepError, match=r"worker 0 \(pid \d+, cuda:77\): no device 'cuda:77'.*there is: "):
        InProcess("cuda:77", work=sweep_works.do).start(tmp_path)


def test_workers_must_find_the_work_by_name():
    with pytest.raises(SweepError, match="cannot import"):
        Processes(["cpu"], work=lambda task, device, *, worker, progress: None)
    with pytest.raises(SweepError, match="none was given"):
        Processes([])


ENGINES = {
    "in this process": lambda: InProcess("cpu"),
    "processes": lambda: Processes(["cpu", "cpu"]),
    "local": lambda: LocalEngine(2),
    "cluster": lambda: DaskEngine("local", devices="cpu", workers=2),
}


def rows_of(store, outcomes):
    """Payloads by group, key and part, without times."""
    assert [outcome.error for outcome in outcomes] == [None] * len(outcomes)
    rows = [row for outcome in outcomes for row in read_shard(store / outcome.shard).rows]
    return {(row.group, row.key, row.part): dict(row.payload, seconds=None) for row in rows}


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("kind", ENGINES)
def test_every_engine_makes_the_same_results_to_the_bit(tmp_path, kind):
    """One task of all recipes in this process is what a task for each by any engine must equal."""
    recipes = [
        recipe_of(strategy=name, motion=random_motion(600, seed=seed)) for name in ("cc", "hatch") for seed in (1, 2)
    ]
    stores = [tmp_path / name for name in ("together", "apart")]
    for store in stores:
        (store / "shards").mkdir(parents=True)
    together = rows_of(stores[0], [run_task(task_of(stores[0], recipes), "cpu")])
    with contextlib.closing(ENGINES[kind]()) as engine:
        engine.start(stores[1])
        engine.grow(2)
        tasks = [task_of(stores[1], [recipe], number=n, name=f"{n}") for n, recipe in enumerate(recipes)]
        assert rows_of(stores[1], list(make(engine, tasks).values())) == together
    assert len(together) == 2 * len(recipes)


@pytest.mark.exhaustive
def test_a_worker_has_its_device_one_thread_and_ignores_ctrl_c(engine, tmp_path):
    assert make(engine, tasks_of(tmp_path, "tell"))[0].shard == "1 cpu True"
    os.kill(engine.pids[0], signal.SIGINT)
    make(engine, tasks_of(tmp_path, "done", "done"))


DEATHS = {
    "die SIGKILL": r"was killed by signal 9\b",
    "die SIGSEGV": r"was killed by signal 11\b",
    "leave 3": "ended with exit code 3; its last output: the reason",
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("verb", DEATHS)
def test_a_worker_that_dies_loses_its_task_and_no_other(engine, tmp_path, verb):
    before = engine.pids
    outcomes = make(engine, tasks_of(tmp_path, verb, *["rest 0.05"] * 10, verb))
    lost = [o for o in outcomes.values() if o.is_lost]
    assert [(o.number, o.suspects) for o in lost] == [(0, (0,)), (11, (0,))]
    assert all(re.match(rf"worker \d \(pid \d+, cpu\) {DEATHS[verb]}", o.error) for o in lost)
    assert [number for number, _ in said(tmp_path)].count(0) == 1
    assert len(set(engine.pids) - set(before)) in (1, 2)  # others in their places


@pytest.mark.exhaustive
def test_a_workers_child_does_not_hide_that_it_died(engine, tmp_path):
    began = time.monotonic()
    lost = make(engine, tasks_of(tmp_path, "leave-child 120"))[0]
    assert lost.is_lost
    assert "ended with exit code 3" in lost.error
    assert time.monotonic() - began < 90


def test_whatever_a_task_raises_is_a_sentence_that_can_be_stored(in_process, tmp_path):
    """Where Ctrl-C is ignored, as in a worker: there a KeyboardInterrupt is the task's own."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    outcomes = make(
        in_process, tasks_of(tmp_path, "raise-strange own", "raise-strange interrupt", "raise-strange bytes")
    )
    assert not any(o.is_lost for o in outcomes.values())
    assert "OwnError: its message cannot be shown (ValueError)" in outcomes[0].error
    assert "KeyboardInterrupt: bad" in outcomes[1].error
    assert "ValueError: bad \\udcff name" in outcomes[2].error
    assert all(len(o.error.encode()) < 2100 for o in outcomes.values())


@pytest.mark.exhaustive
def test_a_worker_that_dies_while_it_waits_is_replaced_and_the_user_warned(engine, tmp_path):
    make(engine, tasks_of(tmp_path, "die-after 0.2"))
    before = engine.pids
    with pytest.warns(PalpateWarning, match=r"was killed by signal 9; another takes its place"):
        await_true(lambda: engine.wait(0.1) == [] and engine.pids != before)
    assert not any(o.is_lost for o in make(engine, tasks_of(tmp_path, "done", "done")).values())


@pytest.mark.exhaustive
def test_a_stopped_worker_stops_no_other(engine, tmp_path):
    os.kill(engine.pids[0], signal.SIGSTOP)
    chunks = tuple(Chunk("x" * 1000, ("contours",)) for _ in range(3000))  # more than a socket takes
    tasks = [Task(number, chunks, str(tmp_path), "done") for number in range(6)]
    engine.submit(tasks[0])
    assert not any(o.is_lost for o in make(engine, tasks[1:]).values())
    os.kill(engine.pids[0], signal.SIGCONT)
    gather(engine, 1)


@pytest.mark.exhaustive
def test_a_worker_that_sleeps_uses_no_processor_time_but_time_on_the_wall(engine, tmp_path):
    (task,) = tasks_of(tmp_path, "rest 2.0")
    engine.submit(task)
    latest = []
    while not (outcomes := engine.wait(0.1)):
        latest = list(engine.running().values()) or latest
    assert not outcomes[0].is_lost
    assert latest[0].waiting_seconds > 1.0
    assert latest[0].idle_seconds < 0.5


@pytest.mark.exhaustive
def test_warnings_of_workers_reach_the_user_once(engine, tmp_path):
    with pytest.warns(PalpateWarning) as shown:
        make(engine, tasks_of(tmp_path, *["warn faces were turned"] * 6))
    assert [str(w.message) for w in shown] == ["faces were turned"]


@pytest.mark.exhaustive
def test_output_of_a_worker_stays_there_and_does_not_pile_up(engine, tmp_path, capfd):
    make(engine, tasks_of(tmp_path, *["talk 600000"] * 20))
    assert capfd.readouterr() == ("", "")
    await_true(lambda: all(os.fstat(w.output.fileno()).st_size < 2 * 10**6 for w in engine._workers))


def test_workers_that_die_at_the_start_are_given_up_with_their_last_output(tmp_path, monkeypatch):
    monkeypatch.setattr(worker_process_module, "BOOT", "import os; os.write(2, b'no room here\\n'); os._exit(9)")
    engine = Processes(["cpu"], work=sweep_works.do)
    engine.start(tmp_path)
    text = rf"{DEATHS_MOST} workers in a row .*worker 0 \(pid \d+, cpu\) ended with exit code 9.*no room here"
    with pytest.raises(SweepError, match=text):
        gather(engine, 1)
    engine.close()


@pytest.mark.exhaustive
def test_closing_ends_busy_workers_and_leaves_no_zombies(tmp_path):
    engine = started(tmp_path, 2)
    for task in tasks_of(tmp_path, "count 1000", "rest 1000"):
        engine.submit(task)
    await_true(lambda: len(engine.running()) == 2)
    pids = engine.pids
    begun = time.monotonic()
    engine.close()
    assert time.monotonic() - begun < 10.0
    for pid in pids:
        with pytest.raises(ProcessLookupError):  # a zombie would still be found
            os.kill(pid, 0)
    engine.close()


@pytest.mark.exhaustive
def test_workers_end_with_their_parent_however_it_ends(tmp_path):
    script = f"""
import sys, time
sys.path[:] = {sys.path!r}
import sweep_works
from palpate.render.sweeps.run.processes import Processes
from palpate.render.sweeps.make.task import Task
engine = Processes(["cpu", "cpu"], work=sweep_works.do)
engine.start({str(tmp_path)!r})
engine.grow(2)
while engine.free_count() < 2:
    engine.wait(0.1)
engine.submit(Task(0, (), {str(tmp_path)!r}, "count 1000"))
sys.stdout.write(" ".join(map(str, engine.pids)) + chr(10))
sys.stdout.flush()
time.sleep(1000)
"""
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    with parent:
        pids = [int(pid) for pid in parent.stdout.readline().split()]
        assert len(pids) == 2
        assert all(map(is_alive, pids))
        parent.send_signal(signal.SIGKILL)
    await_true(lambda: not any(map(is_alive, pids)), longest=10.0)


def test_words_choose_the_engine():
    cores = len(os.sched_getaffinity(0))
    assert choose_engine("cpu", 1).name == "in this process, on cpu"
    assert choose_engine("cpu", 3).worker_most == 3
    assert choose_engine("cpu").worker_most == cores
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    if gpus:
        assert choose_engine("cuda").worker_most == 2 * len(gpus)
        assert choose_engine("auto").name == "processes, 2 on cuda:0"
        assert choose_engine("cuda:0", 1).name == "processes, 1 on cuda:0"
    else:
        assert choose_engine().name == "in this process, on cpu"
    for words in (("cuda:77",), ("cpu", 0), ("cpu,cpu",)):
        with pytest.raises(StrategyError):
            choose_engine(*words)


def test_a_task_that_this_process_has_not_begun_goes_to_the_processes_that_take_over(tmp_path, monkeypatch):
    """Otherwise nobody makes it, and the sweep waits for ever."""

    class Taken:
        worker_most, devices, name = 2, ("cpu",), "stand-in"

        def __init__(self, devices):
            self.tasks = []

        def start(self, store):
            pass

        def grow(self, worker_count):
            pass

        def free_count(self):
            return 1 - len(self.tasks)

        def submit(self, task):
            self.tasks.append(task)

        def wait(self, timeout):
            return []

        def close(self):
            pass

    monkeypatch.setattr(engine_module, "Processes", Taken)
    monkeypatch.setattr(engine_module, "runs_python", lambda chunk: False)
    engine = LocalEngine(2)
    engine.start(tmp_path)
    (task,) = tasks_of(tmp_path, "waits")
    engine.submit(task)
    engine.grow(2)  # more than one worker is worth it: processes take over
    assert engine.free_count() == 0
    engine.wait(0.0)
    assert engine._processes.tasks == [task]
    engine.close()


@pytest.mark.exhaustive
def test_recipes_that_run_python_are_made_in_a_process_also_with_one_worker(tmp_path, monkeypatch):
    on_host = replace(known_stages("transform")["hatch"], on="host")  # as stages of a user's run
    monkeypatch.setattr(registry, "known_stages", lambda role: {**known_stages(role), "hatch": on_host})
    _is_python.cache_clear()
    for strategy, name in (("cc", "in this process, on cpu"), ("hatch", "processes, 1 on cpu")):
        engine = LocalEngine(1)
        (store := tmp_path / strategy).mkdir()
        engine.start(store)
        outcomes = make(engine, [task_of(store, [recipe_of(strategy=strategy, motion=random_motion(100))])])
        assert [outcome.error for outcome in outcomes.values()] == [None]
        assert engine.name == name
        engine.close()
    _is_python.cache_clear()


def test_each_gpu_works_in_a_process_of_its_own(tmp_path):
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    if not gpus:
        pytest.skip("no GPU")
    engine = Processes(gpus, work=sweep_works.do)
    engine.start(tmp_path)
    engine.grow(len(gpus))
    try:
        outcomes = make(engine, tasks_of(tmp_path, *["tell"] * len(gpus)), longest=120.0)
        assert {o.shard for o in outcomes.values()} <= {f"1 {gpu} True" for gpu in gpus}
        outcomes = make(engine, tasks_of(tmp_path, "fault", *["done"] * 6))
        assert outcomes[0].is_lost
        assert "unusable" in outcomes[0].error
        assert not any(outcomes[k].is_lost or outcomes[k].error for k in range(1, 7))
    finally:
        engine.close()
