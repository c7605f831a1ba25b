"""Engines of one host: every task comes back once, whatever becomes of workers; no worker outlives its parent."""

import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise

import pytest
import sweep_works
import warp as wp
from sweep_recipes import random_motion, recipe_of, task_of

from palpate.datasets.sweeps.shard import read_shard
from palpate.render.errors import PalpateWarning, StrategyError, SweepError
from palpate.render.sweeps.make.task import Piece, Task
from palpate.render.sweeps.run import worker_process as worker_process_module
from palpate.render.sweeps.run.engine import InProcess, choose_engine
from palpate.render.sweeps.run.messages import Frames, frame
from palpate.render.sweeps.run.processes import DEATHS_MOST, Processes
from palpate.render.sweeps.run.worker import attempt

PIECES = (Piece("{}", ("contours",)),)


def tasks_of(store, *names):
    return [Task(number, PIECES, str(store), name) for number, name in enumerate(names)]


def submit(engine, tasks):
    for task in tasks:
        engine.submit(task)


def gather(engine, count, longest=30.0):
    """Outcomes by number; fails unless so many come, each once."""
    outcomes, until = [], time.monotonic() + longest
    while len(outcomes) < count and time.monotonic() < until:
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
    engine = Processes(["cpu", "cpu"], work=sweep_works.do)
    engine.start(tmp_path_factory.mktemp("store"))
    yield engine
    engine.close()


@pytest.fixture
def engine(shared):
    """The two workers, ready and without anything to do."""
    await_true(lambda: all(worker.takes_tasks for worker in shared._workers), engine=shared)
    return shared


@pytest.fixture
def in_process(tmp_path):
    engine = InProcess("cpu", work=sweep_works.do)
    engine.start(tmp_path)
    return engine


def test_messages_come_out_of_any_pieces():
    messages = [{"a": 1}, "b" * 1000, None]
    stream = b"".join(frame(message) for message in messages)
    for size in (1, 7, 500, len(stream)):
        frames = Frames()
        out = [m for k in range(0, len(stream), size) for m in frames.take(stream[k : k + size])]
        assert out == messages


def test_this_process_makes_tasks_in_order_and_forgets_what_is_dropped(in_process, tmp_path):
    submit(in_process, tasks_of(tmp_path, "done", "refuse told", "exit 3", "done", "refuse"))
    in_process.drop(3)
    first = in_process.wait()
    assert [(o.number, o.is_lost) for o in first] == [(3, True)]
    outcomes = gather(in_process, 4)
    assert [number for number, _ in said(tmp_path)] == [0, 1, 2, 4]
    assert outcomes[0].error is None
    assert re.fullmatch(r"worker 0 \(pid \d+, cpu\): this cannot be made", outcomes[1].error)
    assert outcomes[2].error.endswith("called exit(3)")
    assert outcomes[4].error.endswith("ZeroDivisionError: ")
    assert not any(o.is_lost for o in outcomes.values())
    assert in_process.wait() == []
    assert in_process.running() == {}


def test_ctrl_c_passes_through_this_process(tmp_path):
    def interrupted(task, device, *, worker):
        raise KeyboardInterrupt

    engine = InProcess("cpu", work=interrupted)
    engine.start(tmp_path)
    submit(engine, tasks_of(tmp_path, "done"))
    with pytest.raises(KeyboardInterrupt):
        engine.wait()


def test_this_process_names_a_device_that_is_missing(tmp_path):
    with pytest.raises(SweepError, match=r"worker 0 \(pid \d+, cuda:77\): no device 'cuda:77'.*there is: "):
        InProcess("cuda:77", work=sweep_works.do).start(tmp_path)


def test_an_engine_that_was_not_started_says_so(tmp_path):
    with pytest.raises(SweepError, match="not started"):
        InProcess("cpu", work=sweep_works.do).wait()
    with pytest.raises(SweepError, match="not started"):
        Processes(["cpu"], work=sweep_works.do).wait(0.0)
    Processes(["cpu"], work=sweep_works.do).close()


def test_workers_must_find_the_work_by_name():
    with pytest.raises(SweepError, match="cannot import"):
        Processes(["cpu"], work=lambda task, device, *, worker: None)
    with pytest.raises(SweepError, match="none was given"):
        Processes([])


@pytest.mark.exhaustive
def test_both_kinds_of_engine_give_the_same_outcomes(engine, in_process, tmp_path):
    tasks = tasks_of(tmp_path, *["done", "refuse told", "exit 2"] * 4)
    outcomes = []
    for one in (engine, in_process):
        submit(one, tasks)
        outcomes.append(gather(one, len(tasks)))
    for number in range(len(tasks)):
        ours, theirs = outcomes[0][number], outcomes[1][number]
        assert (ours.shard, ours.part_count, ours.pose_count) == (theirs.shard, theirs.part_count, theirs.pose_count)
        assert re.sub(r"worker.*\)", "", ours.error or "") == re.sub(r"worker.*\)", "", theirs.error or "")


@pytest.mark.exhaustive
def test_both_kinds_of_engine_make_the_same_results_to_the_bit(tmp_path):
    recipes = [
        recipe_of(strategy=name, motion=random_motion(600, seed=seed)) for name in ("cc", "hatch") for seed in (1, 2)
    ]
    results = []
    for one in (InProcess("cpu"), Processes(["cpu", "cpu"])):
        (store := tmp_path / str(len(results))).mkdir()
        one.start(store)
        submit(one, [task_of(store, [recipe], number=n, name=f"{n}") for n, recipe in enumerate(recipes)])
        shards = [read_shard(store / outcome.shard) for outcome in gather(one, len(recipes)).values()]
        one.close()
        rows = {(row.group, row.key, row.part): row.payload for shard in shards for row in shard.rows}
        results.append({place: dict(payload, seconds=None) for place, payload in rows.items()})
    assert len(results[0]) == 2 * len(recipes)
    assert results[0] == results[1]


@pytest.mark.exhaustive
def test_many_tasks_are_begun_in_order_by_all_workers(engine, tmp_path):
    tasks = tasks_of(tmp_path, *["done"] * 300)
    submit(engine, tasks)
    outcomes = gather(engine, len(tasks))
    begun = said(tmp_path)
    assert sorted(number for number, _ in begun) == list(range(len(tasks)))
    assert {pid for _, pid in begun} == set(engine.pids)
    for pid in engine.pids:
        own = [number for number, who in begun if who == pid]
        turns = sum(later < earlier for earlier, later in pairwise(own))
        assert turns <= len(engine.pids)  # in order, but for what one without work takes over from another
    assert {o.worker for o in outcomes.values()} == {
        f"worker {k} (pid {pid}, cpu)" for k, pid in enumerate(engine.pids)
    }
    assert engine.wait() == []


@pytest.mark.exhaustive
def test_large_tasks_pass(engine, tmp_path):
    pieces = tuple(Piece("x" * 1000, ("contours",), first, first + 1) for first in range(3000))
    submit(engine, [Task(number, pieces, str(tmp_path), "done") for number in range(6)])
    assert {o.part_count for o in gather(engine, 6).values()} == {3000}


@pytest.mark.exhaustive
def test_a_worker_has_its_device_one_thread_and_no_ear_for_ctrl_c(engine, tmp_path):
    submit(engine, tasks_of(tmp_path, "tell"))
    assert gather(engine, 1)[0].shard == "1 cpu True"
    os.kill(engine.pids[0], signal.SIGINT)
    submit(engine, tasks_of(tmp_path, "done", "done"))
    gather(engine, 2)


@pytest.mark.exhaustive
def test_what_a_worker_holds_in_advance_is_made_by_one_without_work(engine, tmp_path):
    # Both have two tasks; the first would keep its second waiting for as long as its first takes.
    submit(engine, tasks_of(tmp_path, "rest 60", "done", "done", "done", "done"))
    outcomes = gather(engine, 4)
    assert 0 not in outcomes
    assert list(engine.running()) == [0]
    engine.drop(0)
    assert gather(engine, 1)[0].is_lost


@pytest.mark.exhaustive
@pytest.mark.parametrize("verb", ["die SIGKILL", "die SIGSEGV"])
def test_a_worker_that_dies_loses_the_task_it_had_begun_and_no_other(engine, tmp_path, verb):
    before = engine.pids
    submit(engine, tasks_of(tmp_path, verb, *["rest 0.05"] * 10))
    outcomes = gather(engine, 11)
    lost = [o for o in outcomes.values() if o.is_lost]
    assert [o.number for o in lost] == [0]
    number = int(getattr(signal, verb.split()[1]))
    assert re.match(rf"worker \d \(pid \d+, cpu\) was killed by signal {number}\b", lost[0].error)
    assert [number for number, _ in said(tmp_path)].count(0) == 1
    assert len(set(before) & set(engine.pids)) == 1


@pytest.mark.exhaustive
def test_a_worker_killed_from_outside_is_replaced(engine, tmp_path):
    submit(engine, tasks_of(tmp_path, "rest 60", *["rest 0.02"] * 6))
    await_true(lambda: 0 in engine.running() and 0 in dict(said(tmp_path)))  # sent, and begun
    victim = dict(said(tmp_path))[0]
    os.kill(victim, signal.SIGKILL)
    outcomes = gather(engine, 7)
    assert outcomes[0].is_lost
    assert f"(pid {victim}, cpu) was killed by signal 9" in outcomes[0].error
    assert not any(outcomes[k].is_lost for k in range(1, 7))
    assert victim not in engine.pids
    assert not is_alive(victim)


@pytest.mark.exhaustive
def test_a_task_that_kills_every_worker_costs_no_other_task(engine, tmp_path):
    tasks = tasks_of(tmp_path, "leave 3", "done", "leave 4", "leave 5", "done")
    submit(engine, tasks)
    outcomes = gather(engine, len(tasks), longest=60.0)
    assert {n for n, o in outcomes.items() if o.is_lost} == {0, 2, 3}
    assert re.fullmatch(
        r"worker \d \(pid \d+, cpu\) ended with exit code 3; its last words: the reason", outcomes[0].error
    )


@pytest.mark.exhaustive
def test_a_worker_that_dies_while_it_waits_is_replaced_and_the_user_told(engine, tmp_path):
    submit(engine, tasks_of(tmp_path, "die-after 0.2"))
    gather(engine, 1)
    before = engine.pids
    with pytest.warns(PalpateWarning, match=r"was killed by signal 9; another takes its place"):
        await_true(lambda: engine.wait(0.1) == [] and engine.pids != before)
    submit(engine, tasks_of(tmp_path, "done", "done"))
    assert not any(o.is_lost for o in gather(engine, 2).values())


@pytest.mark.exhaustive
def test_a_worker_that_never_answers_is_dropped(engine, tmp_path):
    submit(engine, tasks_of(tmp_path, "rest 1000", "count 1000", "done", "done", "done"))
    await_true(lambda: len(engine.running()) == 2)
    assert engine.wait(0.05) == []
    assert all(0 < seconds < 20 for seconds in engine.running().values())
    engine.drop(4)  # nobody has it
    assert gather(engine, 1)[4].error == "it was dropped before it began"
    engine.drop(2)  # held in advance
    assert gather(engine, 1)[2].is_lost
    engine.drop(0)
    engine.drop(1)
    outcomes = gather(engine, 3)
    assert outcomes[0].is_lost
    assert re.fullmatch(r"worker \d \(pid \d+, cpu\) was ended \d+ s after it had begun the task", outcomes[0].error)
    assert outcomes[1].is_lost
    assert not outcomes[3].is_lost
    assert sorted(number for number, _ in said(tmp_path)) == [0, 1, 3]
    engine.drop(99)  # unknown: long finished


@pytest.mark.exhaustive
def test_a_stopped_worker_stops_nobody_else(engine, tmp_path):
    os.kill(engine.pids[0], signal.SIGSTOP)
    pieces = tuple(Piece("x" * 1000, ("contours",), 0, 1) for _ in range(3000))  # more than a socket takes
    submit(engine, [Task(number, pieces, str(tmp_path), "done") for number in range(6)])
    outcomes = gather(engine, 4)
    assert not any(o.is_lost for o in outcomes.values())
    os.kill(engine.pids[0], signal.SIGCONT)
    gather(engine, 2)


@pytest.mark.exhaustive
def test_warnings_of_workers_reach_the_user_once(engine, tmp_path):
    submit(engine, tasks_of(tmp_path, *["warn faces were turned"] * 6))
    with pytest.warns(PalpateWarning) as told:
        gather(engine, 6)
    assert [str(w.message) for w in told] == ["faces were turned"]


@pytest.mark.exhaustive
def test_what_is_printed_in_a_worker_stays_there_and_does_not_pile_up(engine, tmp_path, capfd):
    submit(engine, tasks_of(tmp_path, *["talk 600000"] * 20))
    gather(engine, 20)
    assert capfd.readouterr() == ("", "")
    await_true(lambda: all(os.fstat(w.words.fileno()).st_size < 2 * 10**6 for w in engine._workers))


@pytest.mark.exhaustive
def test_a_missing_device_is_named_at_the_start(tmp_path):
    engine = Processes(["cuda:77"], work=sweep_works.do)
    with pytest.raises(SweepError, match=r"worker 0 \(pid \d+, cuda:77\): no device 'cuda:77'.*there is: "):
        engine.start(tmp_path)
    assert engine.pids == ()


def test_workers_that_die_at_the_start_are_given_up_with_their_last_words(tmp_path, monkeypatch):
    monkeypatch.setattr(worker_process_module, "BOOT", "import os; os.write(2, b'no room here\\n'); os._exit(9)")
    engine = Processes(["cpu"], work=sweep_works.do)
    told = rf"{DEATHS_MOST} workers in a row .*worker 0 \(pid \d+, cpu\) ended with exit code 9.*no room here"
    with pytest.raises(SweepError, match=told):
        engine.start(tmp_path)


@pytest.mark.exhaustive
def test_closing_ends_busy_workers_and_leaves_no_zombies(tmp_path):
    engine = Processes(["cpu", "cpu"], work=sweep_works.do)
    engine.start(tmp_path)
    submit(engine, tasks_of(tmp_path, "count 1000", "rest 1000", "rest 1000"))
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
engine.submit(Task(0, (), {str(tmp_path)!r}, "count 1000"))
while not engine.running():
    time.sleep(0.01)
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
    assert choose_engine("cpu", 3).name == "processes, 3 on cpu"
    assert choose_engine("cpu").devices == ("cpu",) * cores
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    if gpus:
        assert choose_engine("cuda").devices == tuple(gpu for gpu in gpus for _ in range(2))
        assert choose_engine("auto").name == "processes, 2 on cuda:0"
        assert choose_engine("cuda:0", 1).name == "processes, 1 on cuda:0"
    else:
        assert choose_engine().devices == ("cpu",) * cores
    for words in (("cuda:77",), ("cpu", 0), ("cpu,cpu",)):
        with pytest.raises(StrategyError):
            choose_engine(*words)


def test_each_gpu_works_in_a_process_of_its_own(tmp_path):
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    if not gpus:
        pytest.skip("no GPU")
    engine = Processes(gpus, work=sweep_works.do)
    engine.start(tmp_path)
    try:
        submit(engine, tasks_of(tmp_path, *["tell"] * len(gpus)))
        assert {o.shard for o in gather(engine, len(gpus)).values()} <= {f"1 {gpu} True" for gpu in gpus}
        submit(engine, tasks_of(tmp_path, "fault", *["done"] * 6))
        outcomes = gather(engine, 7, longest=60.0)
        assert outcomes[0].is_lost
        assert "unusable" in outcomes[0].error
        assert not any(outcomes[k].is_lost or outcomes[k].error for k in range(1, 7))
    finally:
        engine.close()


def test_an_attempt_says_how_long_it_took(tmp_path):
    outcome = attempt(sweep_works.do, tasks_of(tmp_path, "refuse told")[0], "cpu", "someone")
    assert outcome.error == "someone: this cannot be made"
    assert outcome.seconds > 0
