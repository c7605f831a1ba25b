"""Engines of one host: every task comes back once, whatever becomes of workers; no worker outlives its parent."""

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
from palpate.render.sweeps.run import worker_process as worker_process_module
from palpate.render.sweeps.run.engine import InProcess, LocalEngine, _is_python, choose_engine
from palpate.render.sweeps.run.messages import Frames, frame
from palpate.render.sweeps.run.processes import DEATHS_MOST, Processes
from palpate.render.sweeps.run.worker import attempt

CHUNKS = (Chunk("{}", ("contours",)),)


def tasks_of(store, *names):
    return [Task(number, CHUNKS, str(store), name) for number, name in enumerate(names)]


def make(engine, tasks, longest=30.0):
    """Outcomes of tasks by number, given to workers in order; fails unless all come, each once."""
    return gather(engine, len(tasks), longest, tasks)


def gather(engine, count, longest=30.0, tasks=()):
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


def await_true(condition, longest=20.0, engine=None):
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


def test_an_engine_that_was_not_started_says_so(tmp_path):
    with pytest.raises(SweepError, match="not started"):
        InProcess("cpu", work=sweep_works.do).wait(0.0)
    with pytest.raises(SweepError, match="not started"):
        Processes(["cpu"], work=sweep_works.do).wait(0.0)
    Processes(["cpu"], work=sweep_works.do).close()


def test_workers_must_find_the_work_by_name():
    with pytest.raises(SweepError, match="cannot import"):
        Processes(["cpu"], work=lambda task, device, *, worker, progress: None)
    with pytest.raises(SweepError, match="none was given"):
        Processes([])


@pytest.mark.exhaustive
def test_both_kinds_of_engine_give_the_same_outcomes(engine, in_process, tmp_path):
    tasks = tasks_of(tmp_path, *["done", "refuse told", "exit 2"] * 4)
    outcomes = [make(one, tasks) for one in (engine, in_process)]
    for number in range(len(tasks)):
        ours, theirs = outcomes[0][number], outcomes[1][number]
        assert (ours.shard, ours.row_count, ours.pose_count) == (theirs.shard, theirs.row_count, theirs.pose_count)
        assert re.sub(r"worker.*\)", "", ours.error or "") == re.sub(r"worker.*\)", "", theirs.error or "")


@pytest.mark.exhaustive
def test_all_kinds_of_engine_make_the_same_results_to_the_bit(tmp_path):
    recipes = [
        recipe_of(strategy=name, motion=random_motion(600, seed=seed)) for name in ("cc", "hatch") for seed in (1, 2)
    ]
    results = []
    for one in (InProcess("cpu"), Processes(["cpu", "cpu"]), LocalEngine(2)):
        (store := tmp_path / str(len(results))).mkdir()
        one.start(store)
        tasks = [task_of(store, [recipe], number=n, name=f"{n}") for n, recipe in enumerate(recipes)]
        shards = [read_shard(store / outcome.shard) for outcome in make(one, tasks).values()]
        one.close()
        rows = {(row.group, row.key, row.part): row.payload for shard in shards for row in shard.rows}
        results.append({place: dict(payload, seconds=None) for place, payload in rows.items()})
    assert len(results[0]) == 2 * len(recipes)
    assert results[0] == results[1] == results[2]


@pytest.mark.exhaustive
def test_many_tasks_are_made_by_all_workers_in_order(engine, tmp_path):
    tasks = tasks_of(tmp_path, *["done"] * 300)
    outcomes = make(engine, tasks)
    begun = said(tmp_path)
    assert sorted(number for number, _ in begun) == list(range(len(tasks)))
    assert {pid for _, pid in begun} == set(engine.pids)
    for pid in engine.pids:
        own = [number for number, who in begun if who == pid]
        assert own == sorted(own)
    assert {o.worker for o in outcomes.values()} == {
        f"worker {k} (pid {pid}, cpu)" for k, pid in enumerate(engine.pids)
    }
    assert engine.wait(0.0) == []


@pytest.mark.exhaustive
def test_large_tasks_pass(engine, tmp_path):
    chunks = tuple(Chunk("x" * 1000, ("contours",), number) for number in range(3000))
    tasks = [Task(number, chunks, str(tmp_path), "done") for number in range(6)]
    assert {o.row_count for o in make(engine, tasks).values()} == {3000}


@pytest.mark.exhaustive
def test_a_worker_has_its_device_one_thread_and_ignores_ctrl_c(engine, tmp_path):
    assert make(engine, tasks_of(tmp_path, "tell"))[0].shard == "1 cpu True"
    os.kill(engine.pids[0], signal.SIGINT)
    make(engine, tasks_of(tmp_path, "done", "done"))


def test_a_task_for_which_no_worker_is_free_is_refused(tmp_path):
    engine = Processes(["cpu"], work=sweep_works.do)
    engine.start(tmp_path)
    try:
        with pytest.raises(SweepError, match="task 0: no worker is free"):
            engine.submit(tasks_of(tmp_path, "done")[0])
    finally:
        engine.close()


@pytest.mark.exhaustive
@pytest.mark.parametrize("verb", ["die SIGKILL", "die SIGSEGV"])
def test_a_worker_that_dies_loses_its_task_and_no_other(engine, tmp_path, verb):
    before = engine.pids
    outcomes = make(engine, tasks_of(tmp_path, verb, *["rest 0.05"] * 10))
    lost = [o for o in outcomes.values() if o.is_lost]
    assert [(o.number, o.suspects) for o in lost] == [(0, (0,))]
    number = int(getattr(signal, verb.split()[1]))
    assert re.match(rf"worker \d \(pid \d+, cpu\) was killed by signal {number}\b", lost[0].error)
    assert [number for number, _ in said(tmp_path)].count(0) == 1
    assert len(set(before) & set(engine.pids)) == 1


@pytest.mark.exhaustive
def test_a_worker_killed_from_outside_is_replaced(engine, tmp_path):
    engine.submit(tasks_of(tmp_path, "rest 60")[0])
    await_true(lambda: 0 in engine.running() and 0 in dict(said(tmp_path)))  # given, and begun
    victim = dict(said(tmp_path))[0]
    os.kill(victim, signal.SIGKILL)
    outcomes = gather(engine, 1)
    assert outcomes[0].is_lost
    assert f"(pid {victim}, cpu) was killed by signal 9" in outcomes[0].error
    assert victim not in engine.pids
    assert not is_alive(victim)
    assert not any(o.is_lost for o in make(engine, tasks_of(tmp_path, *["rest 0.02"] * 6)).values())


@pytest.mark.exhaustive
def test_a_task_that_kills_every_worker_costs_no_other_task(engine, tmp_path):
    tasks = tasks_of(tmp_path, "leave 3", "done", "leave 4", "leave 5", "done")
    outcomes = make(engine, tasks, longest=60.0)
    assert {n for n, o in outcomes.items() if o.is_lost} == {0, 2, 3}
    assert re.fullmatch(
        r"worker \d \(pid \d+, cpu\) ended with exit code 3; its last output: the reason", outcomes[0].error
    )


def test_a_workers_child_does_not_hide_that_it_died(engine, tmp_path):
    began = time.monotonic()
    lost = make(engine, tasks_of(tmp_path, "leave-child 30"))[0]
    assert lost.is_lost
    assert "ended with exit code 3" in lost.error
    assert time.monotonic() - began < 20


def test_whatever_a_task_raises_is_a_sentence_that_can_be_stored(engine, tmp_path):
    outcomes = make(engine, tasks_of(tmp_path, "raise-strange own", "raise-strange interrupt", "raise-strange bytes"))
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
def test_time_is_counted_by_the_processor_and_by_the_wall_for_a_worker_that_waits(engine, tmp_path):
    waiting, busy = tasks_of(tmp_path, "rest 1000", "count 1000")
    engine.submit(waiting)
    engine.submit(busy)
    await_true(lambda: {0, 1} <= dict(said(tmp_path)).keys())  # both have begun,
    engine.wait(0.2)  # and their signs of progress have come
    time.sleep(3.0)
    running = engine.running()
    assert running[0].seconds > 3.0
    assert 3.0 / 8 <= running[0].idle_seconds < 1.5
    assert running[1].idle_seconds > running[0].idle_seconds
    assert all(10**7 < own.memory < 2 * 10**9 for own in running.values())
    for number in running:
        engine.drop(number, "it took too long")
    outcomes = gather(engine, 2)
    for outcome in outcomes.values():
        assert outcome.is_lost
        assert re.fullmatch(r"worker \d \(pid \d+, cpu\) was ended: it took too long", outcome.error)
    engine.drop(99, "it is unknown")


@pytest.mark.exhaustive
def test_the_memory_of_a_worker_is_seen(engine, tmp_path):
    engine.submit(tasks_of(tmp_path, "hog 500")[0])
    await_true(lambda: engine.running()[0].memory > 500e6)
    engine.drop(0, "too much memory")
    assert gather(engine, 1)[0].is_lost


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
def test_warnings_of_workers_reach_the_user_once(engine, tmp_path):
    with pytest.warns(PalpateWarning) as shown:
        make(engine, tasks_of(tmp_path, *["warn faces were turned"] * 6))
    assert [str(w.message) for w in shown] == ["faces were turned"]


@pytest.mark.exhaustive
def test_output_of_a_worker_stays_there_and_does_not_pile_up(engine, tmp_path, capfd):
    make(engine, tasks_of(tmp_path, *["talk 600000"] * 20))
    assert capfd.readouterr() == ("", "")
    await_true(lambda: all(os.fstat(w.output.fileno()).st_size < 2 * 10**6 for w in engine._workers))


@pytest.mark.exhaustive
def test_a_missing_device_is_named_at_the_start(tmp_path):
    engine = Processes(["cuda:77"], work=sweep_works.do)
    engine.start(tmp_path)
    with pytest.raises(SweepError, match=r"worker 0 \(pid \d+, cuda:77\): no device 'cuda:77'.*there is: "):
        gather(engine, 1)
    engine.close()
    assert engine.pids == ()


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
    assert time.monotonic() - begun < 2.0
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
    await_true(lambda: not any(map(is_alive, pids)), longest=2.0)


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
        outcomes = make(engine, tasks_of(tmp_path, "fault", *["done"] * 6), longest=60.0)
        assert outcomes[0].is_lost
        assert "unusable" in outcomes[0].error
        assert not any(outcomes[k].is_lost or outcomes[k].error for k in range(1, 7))
    finally:
        engine.close()


def test_an_attempt_reports_how_long_it_took(tmp_path):
    task = tasks_of(tmp_path, "refuse told")[0]
    outcome = attempt(sweep_works.do, task, "cpu", "someone", lambda places: None)
    assert outcome.error == "someone: this cannot be made"
    assert outcome.seconds > 0
