"""A sweep's schedule: every result that is missing is made exactly once, whatever the outcomes, in whatever order."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_stand_ins import Memory, StandIn, count_poses, good, rows_of, rows_wanted

from palpate.render.errors import SweepError
from palpate.render.sweeps.make.task import CHUNK_POSES, FailedChunk, Outcome, Running
from palpate.render.sweeps.run.missing import Missing
from palpate.render.sweeps.run.schedule import TRIES, WRITES_FAILED, Schedule

GROUPS = ("contours", "frequency", "sampling", "keep-contours", "keep-drives")
DISK = "shards/a.h5: No space left on device"


def schedule_of(recipes, there, groups=("contours", "frequency"), worker_count=2, kind="cpu", **options):
    missing = Missing(iter(recipes), groups, done=there.done, pose_count=options.pop("pose_count", count_poses))
    schedule = Schedule(missing, store="store", run="run", **options)
    schedule.set_kind(kind)
    schedule.worker_count = worker_count
    return schedule


def full_disk(task):
    return Outcome(
        task.number,
        "worker 9",
        error=DISK,
        failed=tuple(FailedChunk(place, DISK, is_transient=True) for place, _ in enumerate(task.chunks)),
    )


def finish(schedule, memory, outcome_of=good):
    """Make everything, task by task in order; all tasks there were."""
    every = []
    while not schedule.is_done:
        task = schedule.next_task(0.0)
        if task is None:
            assert schedule.is_done, "nothing to do, but not done"
            break
        outcome = outcome_of(task)
        if outcome.error is None:
            made = [chunk for place, chunk in enumerate(task.chunks) if place not in outcome.left]
            memory.record(row for chunk in made for row in rows_of(chunk))
        schedule.settle(outcome, 0.0)
        every.append(task)
    return every


recipes = st.lists(
    st.builds(
        StandIn,
        thing=st.sampled_from(["cube", "tube"]),
        motion=st.sampled_from(["1", "2"]),
        sampling=st.sampled_from(["a", "b"]),
        array=st.sampled_from(["x", "y"]),
        poses=st.sampled_from([1, 1000, CHUNK_POSES, CHUNK_POSES + 1, 5 * CHUNK_POSES - 3]),
    ),
    max_size=12,
    unique=True,
)


@settings(max_examples=30, deadline=None)
@given(st.data())
def test_every_missing_row_is_made_once_whatever_comes_in_whatever_order(data):
    wanted, groups = data.draw(recipes), data.draw(st.lists(st.sampled_from(GROUPS), min_size=1, unique=True))
    every = sorted({row for recipe in wanted for group in groups for row in rows_wanted(recipe, group)})
    there = data.draw(st.lists(st.sampled_from(every), unique=True)) if every else []
    memory = Memory(dict.fromkeys(there, 1))
    bad = {recipe.title for recipe in data.draw(st.lists(st.sampled_from(wanted), unique=True))} if wanted else set()
    schedule = schedule_of(wanted, memory, groups, worker_count=data.draw(st.integers(1, 3)))
    under_way, trouble, now = [], data.draw(st.integers(0, 8)), 0.0
    while not schedule.is_done:
        while len(under_way) < schedule.worker_count and (task := schedule.next_task(now)) is not None:
            under_way.append(task)
        now += 10.0
        if not under_way:
            continue
        task = under_way.pop(data.draw(st.integers(0, len(under_way) - 1)))
        places = range(len(task.chunks))
        failed = [k for k in places if StandIn.of(task.chunks[k]).title in bad]
        event = data.draw(st.sampled_from(["done", "left", "lost", "disk"])) if trouble else "done"
        trouble -= trouble > 0 and event != "done"
        if event == "lost" and len(places) > 1:
            suspects = data.draw(st.one_of(st.none(), st.just(()), st.just((0,))))
            schedule.settle(Outcome(task.number, "w", error="killed", is_lost=True, suspects=suspects), now)
        elif event == "disk":
            schedule.settle(full_disk(task), now)
        else:
            left = tuple(places[1:]) if event == "left" else ()
            failed = [k for k in failed if k not in left]
            memory.record(r for k in places if k not in failed and k not in left for r in rows_of(task.chunks[k]))
            named = tuple(FailedChunk(k, "bad") for k in failed)
            schedule.settle(good(task, error="bad" if failed else None, failed=named, left=left), now)
    counts = schedule.missing.counts
    failures = {failure.name for failure in schedule.missing.failures}
    assert counts.done + counts.failed == counts.recipes == len(wanted)
    assert counts.failed == len(failures) == len(schedule.missing.failures)
    assert set(memory.rows.values()) <= {1}
    for recipe in wanted:
        if recipe.title not in failures:
            assert all(row in memory.rows for group in groups for row in rows_wanted(recipe, group))
        else:  # it, or one that makes the same
            assert any(row not in memory.rows for group in groups for row in rows_wanted(recipe, group))
    assert bool(failures) <= bool(bad)


def test_a_rendering_that_two_samplings_share_is_rendered_once_in_one_task():
    memory = Memory()
    schedule = schedule_of([StandIn(sampling="a"), StandIn(sampling="b")], memory)
    (task,) = finish(schedule, memory)
    assert [chunk.groups for chunk in task.chunks] == [("contours", "frequency"), ("frequency",)]
    assert schedule.missing.counts.poses_missing == 1000


def test_recipes_are_read_as_they_are_needed():
    read = []

    def endless():
        k = 0
        while True:
            read.append(k)
            yield StandIn(motion=str(k), poses=CHUNK_POSES)
            k += 1

    schedule = schedule_of(endless(), Memory())
    assert [schedule.next_task(0.0) for _ in range(4)]
    assert 0 < len(read) < 10_000


@pytest.mark.parametrize("suspects", [None, "own", "wrong"])
def test_a_chunk_that_kills_is_reported_by_name_and_the_rest_is_finished(suspects):
    wanted, memory = [StandIn(motion=str(k)) for k in range(20)], Memory()
    schedule = schedule_of(wanted, memory)
    deaths = 0

    def outcome_of(task):
        nonlocal deaths
        places = [k for k, chunk in enumerate(task.chunks) if StandIn.of(chunk).motion == "7"]
        if not places:
            return good(task)
        deaths += 1
        seen = {None: None, "own": tuple(places), "wrong": () if len(task.chunks) > 1 else tuple(places)}[suspects]
        if suspects == "wrong" and deaths > 3:
            seen = tuple(places)
        return Outcome(task.number, "w", error="worker 1 was killed by signal 9", is_lost=True, suspects=seen)

    finish(schedule, memory, outcome_of)
    (failure,) = schedule.missing.failures
    assert failure.name == wanted[7].title
    assert failure.recipe_hash == wanted[7].hash
    assert "signal 9" in failure.sentence
    assert deaths == TRIES + {None: 1, "own": 0, "wrong": 3}[suspects]
    assert schedule.missing.counts.done == 19


def test_an_error_that_names_nobody_is_found_by_trying_each_alone():
    wanted, memory = [StandIn(motion=str(k)) for k in range(20)], Memory()
    schedule = schedule_of(wanted, memory)
    finish(
        schedule,
        memory,
        lambda task: (
            good(task, error="broken") if any(StandIn.of(chunk).motion == "7" for chunk in task.chunks) else good(task)
        ),
    )
    assert [failure.name for failure in schedule.missing.failures] == [wanted[7].title]
    assert schedule.missing.counts.done == 19


def test_chunks_of_a_recipe_that_failed_are_not_made_any_more():
    memory, wanted = Memory(), [StandIn(poses=400 * CHUNK_POSES)]
    schedule = schedule_of(wanted, memory, worker_count=1)
    every = finish(schedule, memory, lambda task: good(task, error="open", failed=(FailedChunk(0, "open"),)))
    assert len(every) == 1
    assert schedule.missing.counts.failed == 1


@pytest.mark.parametrize("order", [1, -1])
def test_results_of_a_failed_chunk_serve_recipes_that_need_no_more(order):
    groups = ("contours", "keep-contours", "keep-drives")
    wanted = [StandIn(array="bad"), StandIn(array="good"), StandIn(array="late")][::order]
    memory = Memory()
    schedule = schedule_of(wanted, memory, groups)

    def outcome_of(task):
        failed = []
        for k, chunk in enumerate(task.chunks):
            rows = rows_of(chunk)
            if StandIn.of(chunk).array == "bad" and "keep-drives" in chunk.groups:
                failed.append(FailedChunk(k, "too many foci"))
                rows = [row for row in rows if row[0] != "keep-drives"]
            memory.record(rows)
        return good(task, error="too many foci" if failed else None, failed=tuple(failed))

    while not schedule.is_done:
        schedule.settle(outcome_of(schedule.next_task(0.0)), 0.0)
    assert [failure.name for failure in schedule.missing.failures] == [StandIn(array="bad").title]
    assert (schedule.missing.counts.done, schedule.missing.counts.failed) == (2, 1)


def test_poses_are_counted_once_however_many_groups_want_them():
    long = CHUNK_POSES + 5
    wanted = [StandIn(poses=long), StandIn(poses=long, array="x"), StandIn(motion="2")]
    memory = Memory(dict.fromkeys(rows_wanted(wanted[2], "contours"), 1))
    memory.record(rows_wanted(wanted[0], "contours")[:1])
    split = schedule_of(wanted, memory, ("contours",)).missing
    both = schedule_of(wanted, memory, ("contours", "keep-contours")).missing
    for missing in (split, both):
        missing.read()
    assert split.counts.poses_once == split.counts.poses_missing == 5
    assert both.counts.poses == both.counts.poses_incomplete == 2 * long + 1000
    assert both.counts.poses_once == long + 1000


def test_a_motion_that_cannot_be_read_fails_alone():
    def counted(recipe):
        if recipe.motion == "bad":
            raise OSError("gone")
        return recipe.poses

    memory = Memory()
    schedule = schedule_of([StandIn(motion="bad"), StandIn()], memory, pose_count=counted)
    finish(schedule, memory)
    (failure,) = schedule.missing.failures
    assert "gone" in failure.sentence
    assert (schedule.missing.counts.done, schedule.missing.counts.failed) == (1, 1)


def test_a_worker_that_cannot_write_is_given_time_but_not_for_ever():
    schedule = schedule_of([StandIn()], Memory())
    for k in range(WRITES_FAILED):
        outcome = full_disk(schedule.next_task(10.0 * k))
        if k < WRITES_FAILED - 1:
            schedule.settle(outcome, 10.0 * k)
            assert schedule.next_task(10.0 * k) is None
    with pytest.raises(SweepError, match=r"worker 9: .*No space left"):
        schedule.settle(outcome, 0.0)


def test_tasks_grow_to_the_length_that_is_meant():
    schedule = schedule_of([StandIn(poses=1 << 31)], Memory(), kind="cuda")
    rate = 1e7
    for _ in range(12):
        task = schedule.next_task(0.0)
        poses = len(task.chunks) * CHUNK_POSES
        schedule.settle(Outcome(task.number, "w", seconds=poses / rate), 0.0)
    assert poses / rate == pytest.approx(3.0, rel=0.05)


def test_the_end_is_shared_among_workers():
    schedule = schedule_of([StandIn(motion=str(k), poses=10_000) for k in range(100)], Memory(), worker_count=4)
    sizes = []
    while (task := schedule.next_task(0.0)) is not None:
        sizes.append(len(task.chunks))
        schedule.settle(Outcome(task.number, "w", seconds=len(task.chunks) * 0.05), 0.0)
    assert sum(sizes) == 100
    assert max(sizes) <= 20
    assert sizes[-1] <= 4


def test_a_worker_is_ended_by_its_own_time_and_memory_and_by_name():
    schedule = schedule_of([StandIn()], Memory(), timeout=100.0, memory=10**9)
    task = schedule.next_task(0.0)
    assert schedule.overdue({task.number: Running(1e6, 99.0, 10**9, waiting_seconds=799.0)}) == {}
    (reason,) = schedule.overdue({task.number: Running(5.0, 101.0, 0)}).values()
    assert "101 s of processor time" in reason
    assert "limit of 100 s for a task" in reason
    assert schedule.overdue({task.number: Running(1e6, 1e6, 0)}) == {}  # it is ended once
    schedule.settle(Outcome(task.number, "w", error="ended", is_lost=True, suspects=(0,)), 0.0)
    assert [failure.sentence for failure in schedule.missing.failures] == [reason]  # what takes for ever is tried once
    assert schedule.is_done
    other = schedule_of([StandIn()], Memory(), timeout=100.0, memory=10**9)
    (reason,) = other.overdue({other.next_task(0.0).number: Running(1.0, 1.0, 2 * 10**9)}).values()
    assert "2 GB of memory, more than the limit of 1 GB for a worker" in reason
    third = schedule_of([StandIn()], Memory(), timeout=100.0)
    number = third.next_task(0.0).number
    assert third.overdue({number: Running(1e6, 0.0, waiting_seconds=800.0)}) == {}
    (reason,) = third.overdue({number: Running(801.0, 0.0, waiting_seconds=801.0)}).values()
    assert "801 s on the wall" in reason
    assert "it sleeps, or waits for a lock" in reason
    endless = schedule_of([StandIn()], Memory(), timeout=0.0)
    assert endless.overdue({endless.next_task(0.0).number: Running(1e9, 1e9, waiting_seconds=1e9)}) == {}


def test_chunks_that_another_parent_claims_are_waited_for_and_taken_over():
    wanted, memory = [StandIn(motion=str(k)) for k in range(40)], Memory()
    theirs, is_gone = {}, []
    schedule = schedule_of(
        wanted, memory, takes=lambda bucket: is_gone or theirs.setdefault(bucket, len(theirs) % 2 == 0)
    )
    made = []
    while (task := schedule.next_task(0.0)) is not None:
        made += [row for chunk in task.chunks for row in rows_of(chunk)]
        memory.record(made[-2 * len(task.chunks) :])
        schedule.settle(good(task), 0.0)
    assert 0 < len(made) < 80
    assert not schedule.is_done
    other = [row for recipe in wanted for group in ("contours", "frequency") for row in rows_wanted(recipe, group)]
    left = [row for row in other if row not in made]
    memory.record(left[: len(left) // 4 * 2])  # the other parent makes some, then dies
    schedule.look_elsewhere(memory.done(schedule.elsewhere_keys()))
    assert not schedule.is_done
    is_gone.append(True)
    schedule.look_elsewhere(memory.done(schedule.elsewhere_keys()))
    finish(schedule, memory)
    assert schedule.is_done
    assert schedule.missing.counts.done == 40
    assert set(memory.rows.values()) == {1}


def test_what_another_parent_made_before_it_ended_is_not_made_again():
    wanted, memory = [StandIn(motion=str(k)) for k in range(40)], Memory()
    schedule = schedule_of(wanted, memory, has_company=lambda: True)
    schedule.read()
    memory.record([row for recipe in wanted[:30] for g in ("contours", "frequency") for row in rows_wanted(recipe, g)])
    made = sum(len(task.chunks) for task in finish(schedule, memory))
    assert made == 10
    assert schedule.missing.counts.done == 40


def test_shards_of_a_plan_are_disjoint_and_together_all():
    wanted = [StandIn(motion=str(k)) for k in range(50)]
    rows = []
    for k in range(3):
        memory = Memory()
        schedule = schedule_of(wanted, memory, shard=(k, 3))
        finish(schedule, memory)
        counts = schedule.missing.counts
        assert counts.done == len({key for _, key, _ in memory.rows}) // 2  # a key for each of two groups
        assert counts.done + counts.left == 50
        assert counts.failed == 0
        rows += list(memory.rows)
    assert len(rows) == len(set(rows)) == 100
