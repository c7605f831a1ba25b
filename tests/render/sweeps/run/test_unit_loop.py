"""The fault table of a sweep, on simulated workers and a simulated clock: a fault costs its own recipes, by name."""

import pytest
from sweep_stand_ins import BAD, CODE, Memory, StandIn, Workers, count_poses, rows_wanted

from palpate.render.errors import SweepError
from palpate.render.sweeps.make.unit import Unit, UnitResult
from palpate.render.sweeps.run.missing import Missing
from palpate.render.sweeps.run.unit_loop import SYSTEM_FAILURES, TRIES, UnitCutter, UnitLoop, death_reason

GROUPS = ("contours", "sampling")
LIMIT = 60.0


def loop_of(recipes, workers, memory=None, groups=GROUPS, limit=LIMIT):
    memory = memory or Memory()
    missing = Missing(recipes, groups, done=memory.done, pose_count=count_poses)
    cutter = UnitCutter(missing.places(), missing.poses_by_family)
    return UnitLoop(
        missing,
        cutter,
        memory,
        [workers],
        lambda chunks: Unit(tuple(own.chunk for own in chunks), CODE),
        limit=limit,
        clock=workers.clock,
        wait=workers.wait,
    )


def recipes_with(bad, count=3):
    """Healthy recipes of two objects, and some of a bad one between them."""
    return [StandIn(thing, str(seed)) for thing in ("cube", bad, "tube") for seed in range(count)]


@pytest.mark.parametrize("kind", ["processes", "cluster"])
@pytest.mark.parametrize("count", [1, 2, 8])
@pytest.mark.parametrize("bad", BAD)
def test_a_fault_costs_its_own_recipes_by_name_within_a_stated_time(bad, count, kind):
    recipes, workers, memory = recipes_with(bad), Workers(count, kind), Memory()
    loop = loop_of(recipes, workers, memory)
    loop.run()
    failures = loop.missing.failures
    assert sorted(failure.name for failure in failures) == sorted(own.title for own in recipes if own.thing == bad)
    healthy = [own for own in recipes if own.thing != bad]
    assert set(memory.rows) >= {row for own in healthy for group in GROUPS for row in rows_wanted(own, group)}
    assert not any(key.startswith(bad) for _, key, _ in memory.rows)
    assert (loop.missing.counts.done, loop.missing.counts.failed) == (6, 3)
    assert workers.most <= count
    assert workers.is_closed
    hung = LIMIT * 7 if bad == "hangs" else 0.0  # a unit of three, then each alone, of two groups of chunks
    assert workers.now <= hung + 120.0


@pytest.mark.parametrize("bad", ["hangs", "crashes"])
def test_healthy_recipes_of_a_units_family_are_made(bad):
    recipes = [StandIn("cube", motion) for motion in ("1", "2", bad, "3", "4")]
    loop = loop_of(recipes, Workers(1), groups=("contours",))
    loop.run()
    assert [own.name for own in loop.missing.failures] == [recipes[2].title]
    assert loop.missing.counts.done == 4


def test_nothing_is_made_beside_a_unit_whose_worker_died():
    workers = Workers(8, "cluster")
    submit, beside = workers.submit, []

    def watch(unit):
        if workers.restarts and "crashes" in workers._things(unit):
            beside.append(len(workers.units))
        return submit(unit)

    workers.submit = watch
    loop_of(
        [StandIn("crashes"), *(StandIn(f"thing {k % 7}", str(k)) for k in range(70))], workers, groups=("contours",)
    ).run()
    assert beside == [0, 0]


def test_results_beside_a_failure_are_recorded_and_nothing_healthy_is_made_twice():
    recipes, memory = recipes_with("raises"), Memory()
    loop_of(recipes, Workers(2), memory).run()
    assert set(memory.rows.values()) == {1}
    again = loop_of([own for own in recipes if own.thing != "raises"], Workers(2), memory)
    assert again.cutter.is_empty
    assert again.missing.counts.done == 6


def test_a_system_that_fails_for_good_ends_the_sweep_with_its_reason():
    memory, workers = Memory(), Workers(1)
    loop = loop_of([StandIn("cube"), *(StandIn("full", str(seed)) for seed in range(20))], workers, memory)
    with pytest.raises(SweepError, match="nothing can be written or read any more: the disk is full"):
        loop.run()
    assert set(memory.rows) == {row for group in GROUPS for row in rows_wanted(StandIn("cube"), group)}
    assert SYSTEM_FAILURES > TRIES


def test_a_chunk_on_which_the_system_keeps_failing_is_given_up_by_name():
    loop = loop_of([StandIn("full"), StandIn("cube"), StandIn("tube")], Workers(1))
    loop.run()
    assert [(own.name, own.sentence) for own in loop.missing.failures] == [(StandIn("full").title, "the disk is full")]
    assert loop.missing.counts.done == 2


def test_a_unit_that_no_worker_has_is_an_error():
    workers = Workers(1)
    workers.submit = lambda unit: type(workers).submit(Workers(1), unit)  # given, and forgotten
    with pytest.raises(SweepError, match="no worker of it has begun"):
        loop_of([StandIn()], workers).run()
    assert workers.now < LIMIT * 5  # twice for each of two units


def test_a_worker_with_other_code_ends_the_sweep():
    workers = Workers(1)
    workers._made = lambda unit: UnitResult(refusal="a worker runs other code: b, not a")
    with pytest.raises(SweepError, match="1 simulated: a worker runs other code: b, not a"):
        loop_of([StandIn()], workers).run()


def test_units_do_not_age_while_no_process_has_started():
    workers = Workers(1)
    workers.is_ready = False
    loop = loop_of([StandIn(motion=str(seed)) for seed in range(3)], workers, limit=0.5)
    loop.run()
    assert loop.missing.failures == []


def test_reasons_of_deaths_name_the_signal():
    """The sentence is that of loky 3.7's TerminatedWorkerError."""
    text = (
        "A worker process managed by the executor was unexpectedly terminated. This could be caused by a segmentation "
        "fault while calling the function or by an excessive memory usage causing the Operating System to kill the "
        "worker.\n\nThe exit codes of the workers are {SIGSEGV(-11)}"
    )
    assert death_reason(RuntimeError(text)) == "it ended with SIGSEGV(-11)"
    assert death_reason(RuntimeError()) == "RuntimeError"
