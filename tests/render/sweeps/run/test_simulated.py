"""Sweeps on a simulated clock: whatever chunks do, every sweep ends, and healthy recipes are made."""

import re

import pytest
from simulated_engine import MAKER, SECONDS, SimulatedEngine, StandInPlan
from sweep_stand_ins import StandIn, count_poses, rows_wanted

from palpate.datasets.sweeps.store import SweepStore
from palpate.render.sweeps.run.limits import WorkerLimits
from palpate.render.sweeps.run.parent import run_sweep

LIMITS = WorkerLimits(timeout=60.0, memory=8 * 10**9)
BAD = {
    "raise": "it cannot be made",
    "crash": "killed by signal 11",
    "endless": "no progress in .* limit of 60 s",
    "asleep": "no progress in .* limit of 60 s",
    "hog": "more than the limit of 8 GB",
}
GOOD = ("fast", "s3", "s8", "s30")
WORKERS = (1, 2, 8)


def go(folder, wanted, engine):
    return run_sweep(
        StandInPlan(wanted), folder, engine, made_by=MAKER, count_poses=count_poses, limits=LIMITS, clock=engine.clock
    )


def made(folder, wanted):
    """Titles of recipes of which every result is in the store."""
    with SweepStore(folder, maker=MAKER, mode="read") as store:
        there = store.done([(g, r.key(g)) for r in wanted for g in ("contours", "frequency")])
    rows = {r.title: [row for g in ("contours", "frequency") for row in rows_wanted(r, g)] for r in wanted}
    return {title for title, own in rows.items() if all(row[2] in there[row[:2]] for row in own)}


def healthy(count):
    return [StandIn("fast", motion=f"healthy {k}") for k in range(count)]


@pytest.mark.exhaustive(but="-2-processes")
@pytest.mark.parametrize("kind", ["processes", "dask"])
@pytest.mark.parametrize("worker_count", WORKERS)
@pytest.mark.parametrize("thing", [*BAD, *GOOD])
def test_every_sweep_ends_and_makes_what_can_be_made(tmp_path, thing, worker_count, kind):
    engine = SimulatedEngine(worker_count, kind)
    wanted = [*healthy(20), StandIn(thing), *(StandIn("fast", motion=f"after {k}") for k in range(20))]
    report = go(tmp_path / "s", wanted, engine)
    bad = {StandIn(thing).title} if thing in BAD else set()
    assert made(tmp_path / "s", wanted) == {recipe.title for recipe in wanted} - bad
    assert {failure.name for failure in report.failures} == bad
    for failure in report.failures:
        assert re.search(BAD[thing], failure.sentence)
    limit = {"endless": 61.0, "asleep": 8 * 61.0}.get(thing, min(SECONDS[thing], 30.0))
    assert engine.now < 60.0 + 2.2 * limit
    assert len(engine.ended) == (thing in ("endless", "asleep", "hog"))
    assert report.workers_lost <= 3


@pytest.mark.exhaustive(but="2-dask")
@pytest.mark.parametrize("kind", ["processes", "dask"])
@pytest.mark.parametrize("worker_count", WORKERS)
def test_all_of_them_together(tmp_path, worker_count, kind):
    engine = SimulatedEngine(worker_count, kind)
    things = [*BAD, *GOOD]
    wanted = [StandIn(thing, motion=str(k)) for k, thing in enumerate(things)] + healthy(30)
    report = go(tmp_path / "s", wanted, engine)
    bad = {recipe.title for recipe in wanted if recipe.thing in BAD}
    assert {failure.name for failure in report.failures} == bad
    assert made(tmp_path / "s", wanted) == {recipe.title for recipe in wanted} - bad


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("worker_count", WORKERS)
def test_a_busy_host_loses_nothing(tmp_path, worker_count):
    engine = SimulatedEngine(worker_count, share=0.15)
    wanted = [StandIn("s30"), StandIn("s8"), *healthy(20)]
    report = go(tmp_path / "s", wanted, engine)
    assert report.failures == ()
    assert engine.ended == []
    assert made(tmp_path / "s", wanted) == {recipe.title for recipe in wanted}


def test_an_endless_recipe_holds_no_other_up(tmp_path):
    wanted = [StandIn("endless"), *healthy(200)]
    seen = []

    class Watched(SimulatedEngine):
        def wait(self, timeout):
            seen.append((self.now, self.task_count))
            return super().wait(timeout)

    engine = Watched(2)
    go(tmp_path / "s", wanted, engine)
    assert made(tmp_path / "s", wanted) == {recipe.title for recipe in wanted[1:]}
    tasks_early = max(count for now, count in seen if now < 60.0)
    assert engine.task_count - tasks_early <= 2


def test_few_recipes_start_one_worker_and_many_start_more(tmp_path):
    few, many = SimulatedEngine(8), SimulatedEngine(8)
    go(tmp_path / "few", healthy(6), few)
    go(tmp_path / "many", [StandIn("fast", motion=str(k), poses=100_000) for k in range(100)], many)
    assert few.task_count == 1
    assert few.most_workers == 1
    assert many.most_workers == 8
