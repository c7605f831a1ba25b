"""Sampling metrics and kept focal points of many motions at once: as of each motion alone, and failures stay apart."""

import errno
from dataclasses import replace

import h5py
import pytest
from sweep_recipes import explored, recipe_of, task_of

from palpate.datasets.sweeps.shard import read_shard
from palpate.render import StrategyError
from palpate.render.sweeps.make import keep as keep_module
from palpate.render.sweeps.make import sampling_groups
from palpate.render.sweeps.make import unsplit as unsplit_module
from palpate.render.sweeps.make import work as work_module
from palpate.render.sweeps.make.work import run_task

BOTH = ("sampling", "keep-focal-points")


def made(store, recipes, groups, device="cpu", **options):
    """Payloads of a task by (group, key); timings left out."""
    outcome = run_task(task_of(store, recipes, groups, **options), device, worker="here")
    assert outcome.error is None
    rows = read_shard(store / outcome.shard).rows
    payloads = {(row.group, row.key): {**row.payload, "seconds": None} for row in rows}
    assert len(payloads) == len(rows) == outcome.row_count
    return payloads


def files_of(store):
    """Of the kept files of focal points, by their names: the values, and all attributes, digests among them."""
    out = {}
    for path in (store / "focal-points").iterdir():
        with h5py.File(path) as file:
            values = [file[name][...].tobytes() for name in ("focus/position", "focus/intensity")]
            attributes = [{key: str(value) for key, value in file[name].attrs.items()} for name in ("/", "focus")]
            out[path.name] = values, attributes
    return out


def sampled(*motions, **options):
    """Recipes of motions and of two sampling strategies."""
    return [recipe_of("tube", motion=own, sampling=name, **options) for own in motions for name in ("stm", "capped")]


def touching(*seeds):
    return [{**explored(1.0, seed=seed), "model": "over-array", "explorer": seed + 1} for seed in seeds]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("groups_asked", [BOTH, ("sampling",), ("keep-focal-points",)])
@pytest.mark.parametrize("strategy", ["cc", "corners"])
def test_motions_that_are_sampled_together_are_the_same_as_alone(tmp_path, monkeypatch, device, strategy, groups_asked):
    recipes = sampled(*touching(5, 7, 4), strategy=strategy)
    groups, real = [], sampling_groups.motion_groups

    def seen(*args, **options):
        for group in real(*args, **options):
            groups.append(group)
            yield group

    monkeypatch.setattr(sampling_groups, "motion_groups", seen)
    (tmp_path / "alone").mkdir()
    together = made(tmp_path, recipes, groups_asked, device)
    assert [(group.first, group.stop) for group in groups] == [(0, 3), (0, 3)]
    monkeypatch.setattr(sampling_groups, "_is_grouped", lambda *_: False)
    assert made(tmp_path / "alone", recipes, groups_asked, device) == together
    assert len(together) == 6 * len(groups_asked)
    if "sampling" in groups_asked:
        assert any(payload.get("jumps_per_second", 0) > 0 for payload in together.values())
    if "keep-focal-points" in groups_asked:
        assert len(files_of(tmp_path)) == 6
        assert files_of(tmp_path) == files_of(tmp_path / "alone")


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", ["am-multi-focus", "lm", "step"])
def test_kept_focal_points_are_the_same_on_every_device_and_written_in_any_blocks(tmp_path, monkeypatch, device, name):
    recipes = [recipe_of("tube", motion=own, sampling=name) for own in touching(5, 7)]
    stores = [tmp_path / place for place in ("at once", "streamed", "other device")]
    for store in stores:
        store.mkdir()
    made(stores[0], recipes, BOTH[1:])
    if device != "cpu":
        made(stores[2], recipes, BOTH[1:], device)
        assert files_of(stores[2]) == files_of(stores[0])
    monkeypatch.setattr(keep_module, "POINTS_A_WRITE", 1500)
    monkeypatch.setattr(sampling_groups, "_is_grouped", lambda *_: False)
    made(stores[1], recipes, BOTH[1:])
    assert files_of(stores[1]) == files_of(stores[0])


@pytest.mark.parametrize(("name", "together"), [("stm", True), ("multi-focus", False)])
def test_motions_of_more_focal_points_than_memory_may_hold_are_made_alone(tmp_path, monkeypatch, name, together):
    """Two foci of 10,000 samples a second are 20,000 focal points."""
    monkeypatch.setattr(sampling_groups, "FOCI_AT_ONCE", 19_999)
    seen, real = [], sampling_groups.motion_groups
    monkeypatch.setattr(sampling_groups, "motion_groups", lambda *a, **o: seen.append(1) or real(*a, **o))
    made(tmp_path, [recipe_of("tube", motion=touching(5)[0], sampling=name)], BOTH[:1])
    assert bool(seen) == together


def test_chunks_of_one_motion_share_what_each_asks_for(tmp_path):
    recipes = [recipe_of("tube", motion=touching(5)[0], array=array) for array in ("emulator", "pat16")]
    tasks = [task_of(tmp_path, [recipe], (group,)) for recipe, group in zip(recipes, BOTH, strict=True)]
    task = replace(tasks[0], chunks=tuple(task.chunks[0] for task in tasks))
    outcome = run_task(task, "cpu")
    rows = read_shard(tmp_path / outcome.shard).rows
    assert [row.group for row in rows] == list(BOTH)
    assert [bool(row.payload["seconds"]) for row in rows] == [True, False]  # counted once
    assert outcome.pose_count == 90


def test_a_file_that_cannot_be_written_fails_alone(tmp_path, monkeypatch):
    real, calls = sampling_groups.keep_focal_points, []

    def full(*args):
        calls.append(args)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(*args)

    monkeypatch.setattr(sampling_groups, "keep_focal_points", full)
    recipes = sampled(*touching(5, 7, 4))[::2]
    outcome = run_task(task_of(tmp_path, recipes, BOTH), "cpu")
    assert [(failed.place, failed.is_transient) for failed in outcome.failed] == [(1, True)]
    assert outcome.error.endswith("(keep-focal-points): No space left on device")
    groups = [row.group for row in read_shard(tmp_path / outcome.shard).rows]
    assert (groups.count("sampling"), groups.count("keep-focal-points")) == (3, 2)
    assert len(files_of(tmp_path)) == 2


def test_a_motion_that_fails_fails_alone(tmp_path, monkeypatch):
    recipes = sampled(*touching(5, 7, 4))[::2]
    real, calls = unsplit_module.sample_recipe, []

    def fails(*args, **options):
        calls.append(args)
        if len(calls) == 2:
            raise StrategyError("this motion cannot be sampled")
        return real(*args, **options)

    monkeypatch.setattr(sampling_groups, "motion_groups", lambda *_, **__: (_ for _ in ()).throw(StrategyError("one")))
    monkeypatch.setattr(unsplit_module, "sample_recipe", fails)
    outcome = run_task(task_of(tmp_path, recipes, ("sampling",)), "cpu")
    assert [failed.place for failed in outcome.failed] == [1]
    assert "this motion cannot be sampled" in outcome.error
    assert outcome.row_count == 2


def test_groups_that_a_tasks_time_does_not_reach_are_left(tmp_path, monkeypatch):
    recipes = sampled(*touching(5, 7, 4))[::2]
    monkeypatch.setattr(sampling_groups, "CPU_BYTES", 2**20)  # one motion a group
    monkeypatch.setattr(work_module.TaskWork, "is_over", property(lambda work: bool(work.rows)))
    outcome = run_task(task_of(tmp_path, recipes, ("sampling",)), "cpu")
    assert (outcome.row_count, outcome.left, outcome.failed) == (1, (1, 2), ())
