"""The parent of a sweep: what workers leave is recorded, what goes wrong is mended or named."""

import json
import resource
import shutil
from dataclasses import replace
from itertools import count

import pytest
from simulated_engine import MAKER, StandInPlan
from sweep_stand_ins import StandIn, count_poses, rows_of, rows_wanted

from palpate.datasets.errors import SweepStoreError
from palpate.datasets.sweeps.shard import ShardRow, write_shard
from palpate.datasets.sweeps.store import SweepStore
from palpate.render.errors import SweepError
from palpate.render.sweeps.make.task import FailedChunk, Outcome
from palpate.render.sweeps.run import recording as recording_module
from palpate.render.sweeps.run.parent import run_sweep

DISK = "shards/a.h5: No space left on device"


class StandInEngine:
    """Makes tasks at once; `trouble` may take a task's outcome into its own hands."""

    name, devices, worker_most = "stand-in", ("cpu", "cpu"), 2

    def __init__(self, trouble=lambda task: None):
        self.trouble, self.is_closed = trouble, False
        self.queue, self.tasks, self.begun, self.outcomes = [], [], {}, []

    def start(self, store):
        self.store = store

    def grow(self, worker_count):
        pass

    def free_count(self):
        return 2 - len(self.queue) - len(self.begun)

    def submit(self, task):
        self.queue.append(task)

    def wait(self, timeout):
        if self.outcomes or not self.queue:
            outcomes, self.outcomes = self.outcomes, []
            return outcomes
        task = self.queue.pop(0)
        self.tasks.append(task)
        return [self.trouble(task) or made(task, self.store)]

    def running(self):
        return self.begun

    def drop(self, number, reason):
        del self.begun[number]
        self.outcomes.append(Outcome(number, "worker 1", error=f"worker 1 was ended: {reason}", is_lost=True))

    def close(self):
        self.is_closed = True


def made(task, store):
    rows = [ShardRow(*row, {"poses": 1}) for chunk in task.chunks for row in rows_of(chunk)]
    name = f"shards/{task.name}.h5"
    write_shard(store / name, rows, maker=MAKER)
    poses = sum(StandIn.of(chunk).poses for chunk in task.chunks)
    return Outcome(task.number, "worker 0", name, row_count=len(rows), pose_count=poses, seconds=0.05)


def full(task, worker="w"):
    failed = tuple(FailedChunk(place, DISK, is_transient=True) for place, _ in enumerate(task.chunks))
    return Outcome(task.number, worker, error=DISK, failed=failed)


def go(folder, wanted, engine, **options):
    return run_sweep(StandInPlan(wanted), folder, engine, made_by=MAKER, count_poses=count_poses, **options)


def is_whole(folder, wanted):
    with SweepStore(folder, maker=MAKER, mode="read") as store:
        there = store.done([(g, r.key(g)) for r in wanted for g in ("contours", "frequency")])
    return all(
        number in there[group, key]
        for r in wanted
        for g in ("contours", "frequency")
        for group, key, number in rows_wanted(r, g)
    )


def lines(folder):
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


RECIPES = [StandIn(motion=str(k)) for k in range(40)]


def test_a_sweep_is_made_recorded_and_told(tmp_path):
    told, engine = [], StandInEngine()
    report = go(tmp_path / "s", RECIPES, engine, progress=told.append)
    assert is_whole(tmp_path / "s", RECIPES)
    assert (report.recipes, report.poses, report.poses_rendered, report.poses_reused) == (40, 40_000, 40_000, 0)
    assert (report.rows, report.tasks, report.retries, report.failures) == (80, len(engine.tasks), 0, ())
    assert told[-1].recipes == told[-1].recipe_count == 40
    assert [line["event"] for line in lines(tmp_path / "s")] == ["start", *["task"] * report.tasks, "end"]
    assert len({line["run"] for line in lines(tmp_path / "s")}) == 1
    assert engine.is_closed
    assert not list((tmp_path / "s" / "shards").iterdir())


def test_a_finished_sweep_needs_no_engine(tmp_path):
    go(tmp_path / "s", RECIPES, StandInEngine())

    def none():
        raise AssertionError("asked for")

    report = go(tmp_path / "s", RECIPES, none)
    assert (report.recipes, report.poses_rendered, report.poses_reused, report.engine) == (40, 0, 40_000, None)


@pytest.mark.parametrize(("hold", "most"), [(-1.0, 100), (1e9, 1)])
def test_tasks_that_come_within_a_time_are_recorded_together(tmp_path, monkeypatch, hold, most):
    counts, record_all = [], SweepStore.record_all
    monkeypatch.setattr(recording_module, "HOLD", hold)
    monkeypatch.setattr(
        SweepStore, "record_all", lambda store, shards: counts.append(len(shards)) or record_all(store, shards)
    )
    report = go(tmp_path / "s", RECIPES, StandInEngine())
    assert is_whole(tmp_path / "s", RECIPES)
    recordings = [count for count in counts if count]
    assert len(recordings) == min(most, report.tasks)
    assert sum(recordings) == report.tasks > 1


def test_a_task_that_no_worker_has_is_an_error_and_what_was_made_is_kept(tmp_path):
    class Forgetful(StandInEngine):
        def submit(self, task):
            if len(self.tasks) < 2:
                super().submit(task)

    wanted, clock = [StandIn(motion=str(number)) for number in range(40)], count(0.0, 0.5)
    with pytest.raises(SweepError, match=r"no worker has task 3, .*given to stand-in"):
        go(tmp_path, wanted, forgetful := Forgetful(), clock=lambda: next(clock))
    assert next(clock) < 100.0  # [s]
    go(tmp_path, wanted, engine := StandInEngine())
    made = [chunk for task in (*forgetful.tasks, *engine.tasks) for chunk in task.chunks]
    assert len(forgetful.tasks) == 3
    assert len(set(made)) == len(made)  # none is made again
    assert is_whole(tmp_path, wanted)


def test_an_interrupt_keeps_what_is_made(tmp_path):
    def interrupt(task):
        if task.number == 1:
            raise KeyboardInterrupt

    engine = StandInEngine(interrupt)
    with pytest.raises(KeyboardInterrupt):
        go(tmp_path / "s", RECIPES, engine)
    assert engine.is_closed
    assert lines(tmp_path / "s")[-1]["event"] == "stopped"
    kept = sum(line.get("poses", 0) for line in lines(tmp_path / "s"))
    assert kept > 0
    assert go(tmp_path / "s", RECIPES, StandInEngine()).poses_rendered == 40_000 - kept


def test_what_cannot_be_made_is_named_kept_in_mind_and_tried_again_next_time(tmp_path):
    def poisoned(task):
        bad = [k for k, chunk in enumerate(task.chunks) if StandIn.of(chunk).motion == "7"]
        if not bad:
            return None
        good = replace(task, chunks=tuple(chunk for k, chunk in enumerate(task.chunks) if k not in bad))
        outcome = made(good, tmp_path / "s") if good.chunks else Outcome(task.number, "w")
        return replace(outcome, error="it is open", failed=tuple(FailedChunk(k, "it is open") for k in bad))

    report = go(tmp_path / "s", RECIPES, StandInEngine(poisoned))
    (failure,) = report.failures
    assert (failure.name, failure.sentence) == (RECIPES[7].title, "it is open")
    with SweepStore(tmp_path / "s", maker=MAKER, mode="read") as store:
        assert store.failed() == {RECIPES[7].hash: "it is open"}
    assert is_whole(tmp_path / "s", RECIPES[:7] + RECIPES[8:])
    report = go(tmp_path / "s", RECIPES, StandInEngine())
    assert report.poses_rendered == 1000
    with SweepStore(tmp_path / "s", maker=MAKER, mode="read") as store:
        assert store.failed() == {}


def test_a_damaged_shard_is_made_again(tmp_path):
    damaged = []

    def damage(task):
        if damaged:
            return None
        outcome = made(task, tmp_path / "s")
        damaged.append(outcome.shard)
        path = tmp_path / "s" / outcome.shard
        path.write_bytes(path.read_bytes()[:-100])
        return outcome

    report = go(tmp_path / "s", RECIPES, StandInEngine(damage))
    assert is_whole(tmp_path / "s", RECIPES)
    assert (report.failures, report.rows) == ((), 80)
    assert damaged[0] in " ".join(report.notes)
    assert {"lost", "task", "end"} <= {line["event"] for line in lines(tmp_path / "s")}


def test_a_full_disk_of_the_store_stops_the_sweep_and_tells_what_is_safe(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    engine = StandInEngine(lambda task: full(task) if task.number == 1 else None)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 19, hard))
    try:
        with pytest.raises(SweepError, match=r"takes no more: File too large; what 2 tasks of this run made is safe"):
            go(tmp_path / "s", RECIPES, engine)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert engine.is_closed
    rest = go(tmp_path / "s", RECIPES, StandInEngine())
    assert 0 < rest.poses_rendered < 40_000
    assert is_whole(tmp_path / "s", RECIPES)


@pytest.mark.parametrize("is_told", [False, True])
def test_a_store_that_is_removed_meanwhile_is_told(tmp_path, is_told):
    def remove(task):
        if task.number != 1:
            return None
        outcome = made(task, tmp_path / "s")
        shutil.rmtree(tmp_path / "s")
        return replace(outcome, shard=None, error="shards: No such file or directory") if is_told else outcome

    with pytest.raises(SweepError, match=r"s was removed while the sweep ran.* begins anew"):
        go(tmp_path / "s", RECIPES, StandInEngine(remove))


def test_devices_are_told_that_an_engine_forgets_when_it_is_closed(tmp_path):
    class Cluster(StandInEngine):
        @property
        def devices(self):
            return () if self.is_closed else ("cuda:0", "cpu") if self.tasks else ("cpu",)

    assert go(tmp_path / "s", RECIPES[:3], Cluster()).devices == ("cuda:0", "cpu")


@pytest.mark.parametrize("count", [40, 5])
def test_what_was_made_of_a_failed_piece_and_not_recorded_yet_serves_others(tmp_path, count):
    """Of two groups of a piece one fails: whoever needs the other only is made, the moment of recording regardless."""
    wanted = [StandIn(array="bad"), StandIn(array="good"), *RECIPES[:count]]

    def spoil(task):
        rows, failed = [], []
        for k, chunk in enumerate(task.chunks):
            bad = StandIn.of(chunk).array == "bad" and "keep-drives" in chunk.groups
            failed += [FailedChunk(k, "too many foci")] if bad else []
            rows += [row for row in rows_of(chunk) if not (bad and row[0] == "keep-drives")]
        if not failed:
            return None
        name = f"shards/{task.name}.h5"
        write_shard(tmp_path / "s" / name, [ShardRow(*row, {"poses": 1}) for row in rows], maker=MAKER)
        return Outcome(task.number, "worker 0", name, error="too many foci", failed=tuple(failed), seconds=0.5)

    plan = StandInPlan(wanted, ("contours", "sampling", "keep-drives"))
    report = run_sweep(plan, tmp_path / "s", StandInEngine(spoil), made_by=MAKER, count_poses=count_poses)
    assert [failure.name for failure in report.failures] == [wanted[0].title]


def test_poses_that_two_groups_lack_are_not_reused_and_count_once(tmp_path):
    wanted = [StandIn(motion=str(k)) for k in range(5)]
    for recipes, reused in ((wanted[:4], 0), (wanted, 4000)):
        plan = StandInPlan(recipes, ("contours", "keep-contours"))
        report = run_sweep(plan, tmp_path / "s", StandInEngine(), made_by=MAKER, count_poses=count_poses)
        assert report.poses_reused == reused


def test_results_of_other_code_than_the_parents_stop_the_sweep(tmp_path):
    def other(task):
        write_shard(tmp_path / "s" / "shards" / "other.h5", [ShardRow("contours", "0", 0, {})], maker="other")
        return Outcome(task.number, "w", "shards/other.h5")

    with pytest.raises((SweepError, SweepStoreError), match="made by other"):
        go(tmp_path / "s", RECIPES, StandInEngine(other))


def test_nothing_is_made_of_what_is_not_approved(tmp_path):
    def refuse(counts):
        assert counts.poses_missing == 40_000
        raise SweepError("too much")

    engine = StandInEngine()
    with pytest.raises(SweepError, match="too much"):
        go(tmp_path / "s", RECIPES, engine, approve=refuse)
    assert engine.tasks == []
