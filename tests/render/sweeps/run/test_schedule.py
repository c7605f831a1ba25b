"""A sweep's schedule: every part that is missing is made exactly once, whatever comes of tasks, in whatever order."""

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sweep_stand_ins import Memory, StandIn, count_poses, good, parts_of, rows_of

from palpate.render.errors import SweepError
from palpate.render.sweeps.make.task import PART, Outcome
from palpate.render.sweeps.run.missing import Missing, runs_of
from palpate.render.sweeps.run.pace import GROWTH, POSES_FIRST, Pace, device_kind
from palpate.render.sweeps.run.schedule import COPY_SECONDS, LATE_SECONDS, WRITES_FAILED, Schedule

GROUPS = ("contours", "frequency", "sampling", "keep-contours", "keep-drives")
DISK = "shards/a.h5: No space left on device"


def schedule_of(recipes, memory, groups=("contours", "frequency"), worker_count=2, kind="cpu", **options):
    missing = Missing(iter(recipes), groups, done=memory.done, pose_count=options.pop("pose_count", count_poses))
    return Schedule(missing, Pace(kind), worker_count=worker_count, store="store", run="run")


def given_out(schedule):
    """All tasks that workers have room for."""
    tasks = []
    while (task := schedule.next_task(0.0)) is not None:
        tasks.append(task)
    return tasks


def finish(schedule, memory, outcome_of=good):
    """Make everything, task by task in order; all tasks there were."""
    every = []
    while not schedule.is_done:
        tasks = given_out(schedule)
        assert tasks, "nothing to do, but not done"
        for task in tasks:
            outcome = outcome_of(task)
            if outcome.error is None:
                memory.record(row for piece in task.pieces for row in rows_of(piece))
            schedule.settle(outcome, 0.0)
        every += tasks
    return every


recipes = st.lists(
    st.builds(
        StandIn,
        thing=st.sampled_from(["cube", "tube"]),
        motion=st.sampled_from(["1", "2"]),
        sampling=st.sampled_from(["a", "b"]),
        array=st.sampled_from(["x", "y"]),
        poses=st.sampled_from([1, 1000, PART, PART + 1, 5 * PART - 3]),
    ),
    max_size=12,
    unique=True,
)


@pytest.mark.exhaustive
@settings(max_examples=200)
@given(st.data())
def test_every_missing_part_is_made_once_whatever_comes_in_whatever_order(data):
    wanted, groups = data.draw(recipes), data.draw(st.lists(st.sampled_from(GROUPS), min_size=1, unique=True))
    every = sorted({row for recipe in wanted for group in groups for row in parts_of(recipe, group)})
    there = data.draw(st.lists(st.sampled_from(every), unique=True)) if every else []
    memory = Memory(dict.fromkeys(there, 1))
    bad = {recipe.title for recipe in data.draw(st.lists(st.sampled_from(wanted), unique=True))} if wanted else set()
    schedule = schedule_of(wanted, memory, groups, worker_count=data.draw(st.integers(1, 3)))
    under_way, trouble, now = [], data.draw(st.integers(0, 8)), 0.0
    while not schedule.is_done:
        while (task := schedule.next_task(now)) is not None:
            under_way.append(task)
        now += 10.0
        if not under_way:
            continue
        task = under_way.pop(data.draw(st.integers(0, len(under_way) - 1)))
        failed = tuple((k, "bad") for k, piece in enumerate(task.pieces) if StandIn.of(piece).title in bad)
        came = data.draw(st.sampled_from(["done", "lost", "disk"])) if trouble else "done"
        if came == "lost" and len(task.pieces) > 1:
            trouble -= 1
            schedule.settle(Outcome(task.number, "w", error="killed", is_lost=True), now)
        elif came == "disk":
            trouble -= 1
            schedule.settle(Outcome(task.number, "w", error=DISK), now)
        else:
            memory.record(r for k, p in enumerate(task.pieces) if k not in dict(failed) for r in rows_of(p))
            schedule.settle(good(task, error="bad" if failed else None, failed=failed), now)
    counts = schedule.missing.counts
    failures = {failure.name for failure in schedule.missing.failures}
    assert counts.done + counts.failed == counts.recipes == len(wanted)
    assert counts.failed == len(failures) == len(schedule.missing.failures)
    assert set(memory.rows.values()) <= {1}
    for recipe in wanted:
        if recipe.title not in failures:
            assert all(row in memory.rows for group in groups for row in parts_of(recipe, group))
        else:  # it, or one that makes the same
            assert any(row not in memory.rows for group in groups for row in parts_of(recipe, group))
    assert bool(failures) <= bool(bad)


@pytest.mark.exhaustive
def test_what_is_there_is_not_asked_for_again():
    wanted, memory = [StandIn(motion=str(k)) for k in range(10_000)], Memory()
    finish(schedule_of(wanted, memory), memory)
    schedule = schedule_of(wanted, memory)
    assert schedule.next_task(0.0) is None
    assert schedule.is_done
    assert schedule.missing.counts.reused == 10_000
    assert schedule.missing.counts.poses_missing == 0


def test_a_rendering_that_two_samplings_share_is_rendered_once_in_one_task():
    memory = Memory()
    schedule = schedule_of([StandIn(sampling="a"), StandIn(sampling="b")], memory)
    (task,) = finish(schedule, memory)
    assert [piece.groups for piece in task.pieces] == [("contours", "frequency"), ("frequency",)]
    assert schedule.missing.counts.poses_missing == 1000


def test_recipes_are_read_as_they_are_needed():
    read = []

    def endless():
        k = 0
        while True:
            read.append(k)
            yield StandIn(motion=str(k), poses=PART)
            k += 1

    schedule = schedule_of(endless(), Memory())
    given_out(schedule)
    assert 0 < len(read) < 10_000


@pytest.mark.parametrize("lost", [False, True])
def test_a_poisoned_piece_is_reported_by_name_and_the_rest_is_finished(lost):
    wanted, memory = [StandIn(motion=str(k)) for k in range(20)], Memory()
    schedule = schedule_of(wanted, memory)
    deaths = 0

    def outcome_of(task):
        nonlocal deaths
        if not any(StandIn.of(piece).motion == "7" for piece in task.pieces):
            return good(task)
        deaths += 1
        return Outcome(task.number, "w", error="worker 1 was killed by signal 9", is_lost=lost)

    finish(schedule, memory, outcome_of)
    (failure,) = schedule.missing.failures
    assert failure.name == wanted[7].title
    assert failure.recipe_hash == wanted[7].hash
    assert "signal 9" in failure.sentence
    assert deaths == 3  # with others, and twice alone
    assert schedule.missing.counts.done == 19


def test_a_part_of_many_that_kills_costs_its_recipe_only():
    memory = Memory()
    schedule = schedule_of([StandIn(poses=40 * PART), StandIn(motion="2")], memory, worker_count=1, kind="cuda")

    def outcome_of(task):
        if any(piece.first <= 5 < piece.stop for piece in task.pieces):
            return Outcome(task.number, "w", error="killed", is_lost=True)
        return good(task)

    tasks = finish(schedule, memory, outcome_of)
    assert [failure.name for failure in schedule.missing.failures] == [StandIn(poses=40 * PART).title]
    assert schedule.missing.counts.done == 1
    lost = [piece for task in tasks for piece in task.pieces if piece.first <= 5 < piece.stop]
    assert len(lost) <= 3


def test_recipes_that_wait_for_what_fails_fail_under_their_own_names():
    wanted = [StandIn(sampling="a"), StandIn(sampling="b"), StandIn(thing="tube")]
    memory = Memory()
    schedule = schedule_of(wanted, memory, groups=("contours",))
    finish(
        schedule,
        memory,
        lambda task: (
            good(
                task,
                error="open",
                failed=tuple((k, "open") for k, piece in enumerate(task.pieces) if StandIn.of(piece).thing == "cube"),
            )
            if any(StandIn.of(piece).thing == "cube" for piece in task.pieces)
            else good(task)
        ),
    )
    assert {failure.name for failure in schedule.missing.failures} == {wanted[0].title, wanted[1].title}


@pytest.mark.parametrize("order", [1, -1])
def test_what_is_made_of_a_failed_piece_serves_those_who_need_no_more(order):
    groups = ("contours", "keep-contours", "keep-drives")
    wanted = [StandIn(array="bad"), StandIn(array="good"), StandIn(array="late")][::order]
    memory = Memory()
    schedule = schedule_of(wanted, memory, groups)

    def outcome_of(task):
        failed = []
        for k, piece in enumerate(task.pieces):
            rows = rows_of(piece)
            if StandIn.of(piece).array == "bad" and "keep-drives" in piece.groups:
                failed.append((k, "too many foci"))
                rows = [row for row in rows if row[0] != "keep-drives"]
            memory.record(rows)
        return good(task, error="too many foci", failed=tuple(failed)) if failed else good(task)

    while not schedule.is_done:
        for task in given_out(schedule):
            schedule.settle(outcome_of(task), 0.0)
    assert [failure.name for failure in schedule.missing.failures] == [StandIn(array="bad").title]
    assert (schedule.missing.counts.done, schedule.missing.counts.failed) == (2, 1)


def test_poses_are_counted_once_however_many_groups_want_them():
    wanted = [StandIn(poses=PART + 5), StandIn(poses=PART + 5, array="x"), StandIn(motion="2")]
    memory = Memory(dict.fromkeys(parts_of(wanted[2], "contours"), 1))
    memory.record(parts_of(wanted[0], "contours")[:1])
    cut = schedule_of(wanted, memory, ("contours",)).missing
    both = schedule_of(wanted, memory, ("contours", "keep-contours")).missing
    for missing in (cut, both):
        missing.read()
    assert (cut.counts.poses_incomplete, cut.counts.poses_once) == (10, 5)
    assert both.counts.poses == both.counts.poses_incomplete == 2 * (PART + 5) + 1000
    assert both.counts.poses_once == PART + 5 + 1000


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
        task = schedule.next_task(10.0 * k)
        outcome = Outcome(task.number, "worker 9", error=DISK)
        if k < WRITES_FAILED - 1:
            schedule.settle(outcome, 10.0 * k)
            assert schedule.next_task(10.0 * k) is None
    with pytest.raises(SweepError, match=r"worker 9: .*No space left"):
        schedule.settle(outcome, 0.0)


@pytest.mark.exhaustive
def test_tasks_grow_to_the_target_and_no_faster_than_fourfold():
    schedule, memory = schedule_of([StandIn(poses=1 << 40)], Memory(), kind="cuda"), Memory()
    rate, sizes = 1e8, []
    for _ in range(40):
        for task in given_out(schedule):
            poses = sum((piece.stop - piece.first) * PART for piece in task.pieces)
            sizes.append(poses)
            schedule.settle(Outcome(task.number, "w", seconds=poses / rate), 0.0)
    assert sizes[0] == POSES_FIRST["cuda"]
    assert all(after <= GROWTH * max(sizes[:k]) for k, after in enumerate(sizes) if k)
    assert sizes[-1] / rate == pytest.approx(3.0, rel=0.05)
    assert memory.rows == {}


def test_one_worker_shares_the_end_with_nobody():
    pace = Pace("cpu")
    assert pace.share(1e-3, 1) == pace.share(1e3, 1) == pace.target
    assert pace.share(1.0, 2) < pace.target


def test_the_end_is_shared_among_workers():
    schedule = schedule_of([StandIn(motion=str(k), poses=10_000) for k in range(100)], Memory(), worker_count=4)
    schedule.pace.learn({schedule.next_task(0.0).pieces[0].recipe and "cube/-/-/cut": 400_000}, 2.0)
    sizes = []
    while tasks := given_out(schedule):
        for task in tasks:
            sizes.append(len(task.pieces))
            schedule.settle(Outcome(task.number, "w", seconds=len(task.pieces) * 0.05), 0.0)
    assert max(sizes) < 20
    assert sizes[-1] <= 4


def test_slow_work_is_dropped_only_after_a_multiple_of_what_it_should_take_and_gets_more_time():
    schedule = schedule_of([StandIn()], Memory())
    task = schedule.next_task(0.0)
    assert schedule.late({task.number: LATE_SECONDS}) == []
    assert schedule.late({task.number: LATE_SECONDS + 1}) == [task.number]
    schedule.settle(Outcome(task.number, "w", error="was ended", is_lost=True), 0.0)
    again = schedule.next_task(0.0)
    assert schedule.late({again.number: 10 * LATE_SECONDS}) == []


def test_a_copy_goes_to_an_idle_worker_and_the_first_to_end_counts():
    schedule, memory = schedule_of([StandIn()], Memory()), Memory()
    task = schedule.next_task(0.0)
    assert schedule.copy_for_idle({task.number: COPY_SECONDS / 2}) is None
    copy, original = schedule.copy_for_idle({task.number: COPY_SECONDS + 1})
    assert (original, copy.pieces) == (task.number, task.pieces)
    assert copy.name != task.name
    assert schedule.copy_for_idle({task.number: 1e6}) is None  # one is enough
    schedule.settle(Outcome(task.number, "w", error="killed", is_lost=True), 0.0)
    assert not schedule.is_done  # the copy may do better
    assert schedule.next_task(0.0) is None
    assert schedule.settle(good(copy), 0.0) == []
    assert schedule.is_done
    assert memory.rows == {}


def test_the_copy_that_is_not_needed_any_more_is_named():
    schedule = schedule_of([StandIn()], Memory())
    task = schedule.next_task(0.0)
    copy, _ = schedule.copy_for_idle({task.number: 1e6})
    assert schedule.settle(good(copy), 0.0) == [task.number]
    assert schedule.is_done
    assert schedule.settle(Outcome(task.number, "w", error="was ended", is_lost=True), 0.0) == []
    assert schedule.is_done


@given(st.dictionaries(st.sampled_from("abc"), st.frozensets(st.integers(0, 6)), min_size=1))
def test_runs_cover_what_is_absent_once(absent):
    covered = [
        (group, part) for first, stop, groups in runs_of(absent, 7) for part in range(first, stop) for group in groups
    ]
    assert sorted(covered) == sorted((group, part) for group, parts in absent.items() for part in parts)
    runs = runs_of(absent, 7)
    assert all(a[1] <= b[0] and (a[1] < b[0] or a[2] != b[2]) for a, b in pairwise(runs))


def test_tasks_are_cut_for_the_slowest_kind_of_device():
    assert device_kind(["cuda:0", "cuda:1"]) == "cuda"
    assert device_kind(["cuda:0", "cpu"]) == "cpu"
