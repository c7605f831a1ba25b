"""The cluster engine: local, somebody's, a queueing system's; workers that die, hang, come late or are not fit."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from sweep_dask_work import make_task, work

from palpate.render.errors import PalpateWarning, SweepError
from palpate.render.sweeps.run.dask_engine import DaskEngine

TESTS = Path(__file__).parent
LIMIT = 120.0  # [s] nothing here takes nearly as long, unless the machine is busy


@pytest.fixture(scope="module", autouse=True)
def importable():
    """Workers import the stand-ins that this module imports."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(TESTS), prepend=os.pathsep)
        yield


@pytest.fixture
def store(tmp_path):
    (tmp_path / "store" / "shards").mkdir(parents=True)
    return tmp_path / "store"


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """An engine of two processes here, and its store; tests leave nothing under way."""
    folder = tmp_path_factory.mktemp("crowd")
    (folder / "shards").mkdir()
    engine = DaskEngine("local", devices="cpu", workers=2, work=work, patience=LIMIT)  # a busy machine starts slowly
    with contextlib.closing(engine):
        engine.start(folder)
        yield engine, folder
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


@pytest.fixture(scope="module")
def theirs():
    """Somebody's cluster of one worker."""
    with local_cluster() as cluster:
        yield cluster


def local_cluster(**options):
    from distributed import LocalCluster

    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0", "silence_logs": 60} | options
    return LocalCluster(**options)


def client_of(cluster, **options):
    from distributed import Client

    return Client(cluster, set_as_default=False, **options)


@contextlib.contextmanager
def started(store, *words, **options):
    """An engine of somebody's cluster that has begun."""
    with contextlib.closing(DaskEngine(*words, **{"devices": "cpu", "work": work} | options)) as engine:
        engine.start(store)
        yield engine


def outcomes_of(engine, tasks):
    """Outcomes of tasks by number, given to workers in order, once all are there."""
    return gathered(engine, [task.number for task in tasks], tasks)


def gathered(engine, numbers, tasks=()):
    told, left, end = {}, list(tasks), time.monotonic() + LIMIT
    while told.keys() != set(numbers):
        assert time.monotonic() < end, f"only {sorted(told)} came; {engine.running()} run on {engine.devices}"
        while left and engine.free_count():
            engine.submit(left.pop(0))
        for outcome in engine.wait(1.0):
            assert outcome.number not in told  # once only
            told[outcome.number] = outcome
    return told


def until(condition):
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.exhaustive
def test_what_a_task_raises_is_its_error_and_no_reason_to_lose_the_worker(crowd):
    engine, store = crowd
    outcomes_of(engine, [make_task(n, "sleep 0.1", f"write pid-{n}", store=store) for n in (1, 2, 3, 4)])
    words = {1: "raise bad value", 2: "exit 3", 3: "disk", 4: "text fine"}
    told = outcomes_of(engine, [make_task(n, word, store=store) for n, word in words.items()])
    assert [told[n].is_lost for n in words] == [False] * 4
    assert "bad value" in told[1].error
    assert "exit(3)" in told[2].error
    assert "No space left on device" in told[3].error
    assert socket.gethostname() in told[3].error
    assert told[4].error is None
    outcomes_of(engine, [make_task(n, "sleep 0.1", f"write later-{n}", store=store) for n in (1, 2, 3, 4)])
    pids = {name: {p.read_text() for p in store.glob(f"{name}-*")} for name in ("pid", "later")}
    assert pids["pid"] == pids["later"]


@pytest.mark.exhaustive
@pytest.mark.parametrize("word", ["die-once seen", "die", "spoil badly"])
def test_a_killed_worker_loses_the_task_that_it_had_begun_and_no_other(crowd, word):
    engine, store = crowd
    tasks = [make_task(n, word if n == 3 else "sleep 0.1", store=store) for n in range(1, 9)]
    told = outcomes_of(engine, tasks)
    assert [n for n, outcome in told.items() if outcome.is_lost] == [3]
    assert [n for n, outcome in told.items() if outcome.error] == [3]
    assert "tls://127.0.0.1" in told[3].error
    assert socket.gethostname() in told[3].error
    assert ("badly (it left cpu unusable)" if "spoil" in word else "task 3") in told[3].error
    until(lambda: engine.wait(0.05) == [] and len(engine.devices) == 2)  # there is another in its place
    if word == "die-once seen":
        assert outcomes_of(engine, [tasks[2]])[3].error is None


@pytest.mark.exhaustive
def test_a_task_that_is_dropped_is_lost_at_once_and_its_worker_replaced(crowd):
    engine, store = crowd
    engine.submit(make_task(1, "sleep 1000", store=store))
    until(lambda: engine.wait(0.05) == [] and 1 in engine.running())
    until(lambda: engine.running()[1].seconds > 0.2)
    begun = time.monotonic()
    engine.drop(1, "it took too long")
    (outcome,) = engine.wait(1.0)
    assert time.monotonic() - begun < 1.0
    assert outcome.is_lost
    assert outcome.error == "it took too long"
    assert outcome.suspects == (0,)
    assert engine.running() == {}
    engine.drop(1, "again")  # not there any more
    told = outcomes_of(engine, [make_task(n, "sleep 0.1", store=store) for n in range(2, 8)])
    assert not any(outcome.error for outcome in told.values())
    until(lambda: engine.wait(0.05) == [] and len(engine.devices) == 2)


@pytest.mark.exhaustive
def test_an_engine_that_is_closed_while_busy_leaves_no_process_and_no_file(store):
    engine = DaskEngine(devices="cpu", workers=1, work=work)
    engine.start(store)
    engine.submit(make_task(1, "write pid", "sleep 1000", store=store))
    until((store / "pid").exists)
    until(lambda: engine.wait(0.05) == [] and 1 in engine.running())
    begun = time.monotonic()
    engine.close()
    assert time.monotonic() - begun < 3.0
    assert not is_alive(int((store / "pid").read_text()))
    assert sorted(path.name for path in store.iterdir()) == ["pid", "shards"]
    with pytest.raises(SweepError, match="closed"):
        engine.submit(make_task(2, "text", store=store))
    engine.close()


@pytest.mark.exhaustive
def test_workers_end_when_their_parent_is_killed(store):
    script = (
        "import sys; from pathlib import Path; from palpate.render.sweeps.run.dask_engine import DaskEngine\n"
        "from sweep_dask_work import make_task, work\n"
        "if __name__ == '__main__':\n"
        "    engine = DaskEngine('local', devices='cpu', workers=1, work=work)\n"
        "    engine.start(Path(sys.argv[1]))\n"
        "    engine.submit(make_task(1, 'write pid', 'sleep 1000', store=sys.argv[1]))\n"
        "    engine.wait(1000.0)\n"
    )
    (store.parent / "parent.py").write_text(script)
    with subprocess.Popen([sys.executable, store.parent / "parent.py", store]) as parent:
        until(lambda: (store / "pid").exists() and (store / "pid").read_text())
        parent.kill()
    pid = int((store / "pid").read_text())
    until(lambda: not is_alive(pid))


def is_alive(pid):
    """Whether a process is there, and not only not waited for."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.exhaustive
def test_somebodys_cluster_is_used_and_left_alone(theirs, store):
    with started(store, theirs.scheduler_address) as engine:
        assert engine.devices == ("cpu",)
        told = outcomes_of(engine, [make_task(n, "text", store=store) for n in range(20)])
        assert not any(outcome.error for outcome in told.values())
        order = sorted(told, key=lambda n: (store / told[n].shard).stat().st_mtime_ns)
        assert order == list(range(20))  # as they were submitted
        engine.submit(make_task(1, "sleep 0.2", store=store))
    with client_of(theirs) as client:
        assert client.submit(sum, (1, 2)).result(timeout=LIMIT) == 3
        with started(store, client) as engine:
            assert outcomes_of(engine, [make_task(1, "text", store=store)])[1].error is None
        assert client.status == "running"


@pytest.mark.exhaustive
def test_a_worker_that_joins_later_takes_part(theirs, store):
    with started(store, theirs.scheduler_address, workers=1) as engine:
        theirs.scale(2)
        until(lambda: engine.wait(0.05) == [] and len(engine.devices) == 2)
        told = outcomes_of(engine, [make_task(n, "sleep 0.2", store=store) for n in range(8)])
        assert len({outcome.worker for outcome in told.values()}) == 2
    theirs.scale(1)
    until(lambda: worker_count(theirs) == 1)


@contextlib.contextmanager
def stranger(scheduler, *before, code="pass"):
    """A worker that somebody starts by hand, in a process of its own."""
    main = "from distributed.cli.dask_worker import main; main()"
    words = [*before, sys.executable, "-c", f"import sys; {code}; {main}", scheduler]
    options = ["--no-nanny", "--nthreads", "1", "--no-dashboard", "--name", "stranger"]
    with subprocess.Popen([*words, *options], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def worker_count(cluster):
    return len(cluster.scheduler.workers)


@pytest.mark.exhaustive
def test_a_worker_without_palpate_is_reported_at_the_start(theirs, store):
    with stranger(theirs.scheduler_address, code="sys.modules['palpate'] = None"):
        until(lambda: worker_count(theirs) == 2)
        with pytest.raises(SweepError, match=r"a worker cannot import palpate.*install the same"):
            DaskEngine(theirs.scheduler_address, devices="cpu", work=work).start(store)
    until(lambda: worker_count(theirs) == 1)


@pytest.mark.exhaustive
def test_a_worker_that_joins_later_and_is_unfit_is_reported_and_not_used(theirs, store):
    address = theirs.scheduler_address
    other = "import palpate.render.sweeps.plan.code_version as version; version.code_version = lambda: 'palpate 0.0.1'"
    with started(store, address) as engine, stranger(address, code=other):
        with pytest.warns(PalpateWarning, match=r"worker tcp.*it has palpate 0\.0\.1.*not used") as told:
            until(lambda: engine.wait(0.05) == [] and len(engine._fitness) == 2)
        assert len(told) == 1
        assert engine.free_count() == 1
        came = outcomes_of(engine, [make_task(n, "sleep 0.05", store=store) for n in range(12)])
        assert not any(outcome.error for outcome in came.values())
    until(lambda: worker_count(theirs) == 1)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("mount -t tmpfs none {0}", "does not see the store"),
        ("mount -o ro,bind {0} {0}", "cannot write into the store"),
    ],
    ids=["not-seen", "read-only"],
)
def test_a_worker_that_has_no_such_store_is_named(theirs, store, how, says):
    if subprocess.run(["unshare", "-rm", "true"], check=False, capture_output=True).returncode:
        pytest.skip("no namespaces here: a worker cannot be given other mounts")
    before = ["unshare", "-rm", "sh", "-c", how.format(store) + ' && exec "$@"', "sh"]
    with stranger(theirs.scheduler_address, *before):
        until(lambda: worker_count(theirs) == 2)
        with pytest.raises(SweepError, match=rf"worker tcp.* {socket.gethostname()}.*{says} {store}"):
            DaskEngine(theirs.scheduler_address, devices="cpu", work=work).start(store)
    assert sorted(path.name for path in store.iterdir()) == ["shards"]
    until(lambda: worker_count(theirs) == 1)


@pytest.mark.exhaustive
def test_a_missing_device_is_named_with_worker_and_host(theirs, store):
    says = rf"worker tcp.* {socket.gethostname()}.*no device 'cuda:7'.*cpu"
    with pytest.raises(SweepError, match=says):
        DaskEngine(theirs.scheduler_address, devices="cuda:7", work=work).start(store)
    with pytest.raises(SweepError, match="no device 'cuda:7'"):
        DaskEngine("local", devices="cuda:7", work=work).start(store)


@pytest.mark.exhaustive
def test_a_worker_with_other_code_is_named(theirs, store, monkeypatch):
    monkeypatch.setattr("palpate.render.sweeps.run.dask_engine.code_version", lambda: "palpate 0.0.1")
    with pytest.raises(SweepError, match=r"worker tcp.*it has palpate.*made with palpate 0\.0\.1"):
        DaskEngine(theirs.scheduler_address, devices="cpu", work=work).start(store)


@pytest.mark.exhaustive
def test_a_scheduler_that_does_not_answer_is_named_in_time(store):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # nobody listens there
        address = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        begun = time.monotonic()
        with pytest.raises(SweepError, match=f"no scheduler answers at {address}"):
            DaskEngine(address, patience=0.5, work=work).start(store)
        assert time.monotonic() - begun < 10.0


@pytest.mark.exhaustive
def test_workers_that_do_not_come_are_counted(theirs, store):
    with pytest.raises(SweepError, match="only 1 of 3 workers"):
        DaskEngine(theirs.scheduler_address, workers=3, patience=0.5, work=work).start(store)


@pytest.mark.exhaustive
def test_a_scheduler_that_goes_ends_the_sweep_with_a_sentence(store):
    with local_cluster() as cluster:
        engine = DaskEngine(cluster.scheduler_address, devices="cpu", work=work, patience=3.0)
        engine.start(store)
        engine.submit(make_task(1, "sleep 1000", store=store))
        until(lambda: engine.wait(0.05) == [] and 1 in engine.running())
        for nanny in cluster.workers.values():
            os.kill(nanny.pid, signal.SIGKILL)
    with contextlib.closing(engine), pytest.raises(SweepError, match=r"scheduler is gone.*what was finished is kept"):
        until(lambda: not all(outcome.is_lost for outcome in engine.wait(1.0)))


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"scheduler": "slurm", "workers": 2}, "unknown scheduler 'slurm'; known: local, tcp.*by their own package"),
        ({"workers": 0}, "workers must be at least 1, not 0"),
        ({"scheduler": "tcp://127.0.0.1:1", "devices": "cuda:0,cuda:1"}, "one device"),
    ],
    ids=["unknown", "no-workers", "several-devices"],
)
def test_words_that_cannot_be_are_refused(store, words, says):
    with pytest.raises(SweepError, match=says):
        DaskEngine(**words, work=work).start(store)


@pytest.mark.exhaustive
def test_a_cluster_of_ours_lets_nobody_in_without_its_keys(crowd):
    """Whoever can connect can run code: other users of this host reach 127.0.0.1, too."""
    from distributed.security import Security

    address = crowd[0]._connection.cluster.scheduler_address
    assert address.startswith("tls://127.0.0.1:")
    for where, keys in ((address.replace("tls", "tcp"), None), (address, Security.temporary())):
        with pytest.raises((OSError, TimeoutError)):
            client_of(where, security=keys, timeout=2)


SBATCH = '#!/bin/sh\ncp "$1" {0}/job.sh\nsetsid sh {0}/job.sh >{0}/out 2>&1 &\necho "Submitted batch job $!"\n'
SCANCEL = "#!/bin/sh\nfor job; do kill -9 -- -$job; done\necho $* >>{0}/cancelled\n"


@pytest.mark.exhaustive
def test_a_cluster_of_slurm_jobs_is_used_by_its_client(tmp_path, store, monkeypatch):
    """Slurm's two commands are stand-ins that run the job script here; the cluster is dask-jobqueue's own."""
    from dask_jobqueue import SLURMCluster

    for name, text in {"sbatch": SBATCH, "scancel": SCANCEL}.items():
        (tmp_path / name).write_text(text.format(tmp_path))
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    options = {"cores": 1, "processes": 1, "memory": "1GiB", "queue": "gpus", "local_directory": str(tmp_path)}
    scheduler = {"host": "127.0.0.1", "dashboard_address": ":0"}
    with (
        SLURMCluster(**options, scheduler_options=scheduler) as cluster,
        client_of(cluster) as client,
    ):
        cluster.scale(jobs=1)
        with started(store, client, patience=LIMIT) as engine:
            told = outcomes_of(engine, [make_task(n, "text", store=store) for n in (1, 2)])
            assert [outcome.error for outcome in told.values()] == [None, None]
        assert "#SBATCH -p gpus" in (tmp_path / "job.sh").read_text()
    until((tmp_path / "cancelled").exists)


@pytest.mark.exhaustive
def test_a_worker_that_dies_with_two_tasks_is_charged_to_neither(store):
    with local_cluster(threads_per_worker=2) as cluster, started(store, cluster.scheduler_address) as engine:
        assert engine.free_count() == 2
        tasks = [make_task(1, "sleep 1", "die", store=store), make_task(2, "sleep 30", store=store)]
        told = outcomes_of(engine, tasks)
        assert [(told[n].is_lost, told[n].suspects) for n in (1, 2)] == [(True, ()), (True, ())]
