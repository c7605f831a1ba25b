"""Making a unit: its results are what rendering gives, however poses are batched, and failures stay apart."""

import errno
import json
import signal
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from sweep_recipes import (
    explored,
    made,
    payloads_of,
    random_motion,
    recipe_of,
    strategy_of,
    thing_of,
    unit_of,
)

from palpate.kernels.metrics.random_pose import random_poses
from palpate.render import render
from palpate.render.errors import StrategyError
from palpate.render.intersection.named_inputs import load_hand, load_solid
from palpate.render.objects.mesh.placement import Placement
from palpate.render.strategies.intersection_strategy import load_strategy
from palpate.render.sweeps.make import unit_making
from palpate.render.sweeps.make.unit import CHUNK_POSES, SPAN, Chunk, Unit, this_process
from palpate.render.sweeps.make.unit_making import make_unit

EXACT = [("tube", "palm", "cc"), ("sphere", "palm", "oc"), ("dog", "planes", "cc"), ("cube", "palm", "hatch")]
OTHERS = [("dog", "palm", "smooth"), ("tube", "palm", "inset-hatch"), ("tube", "planes", "simplified")]
GROUPS = ("contours", "frequency", "poses")


def poses_of(count, seed=1):
    rows = random_poses(0, count, seed=seed, size=0.13, at=(0.0, 0.0, 0.2), device="cpu")
    return rows.numpy().reshape(-1, 7)


def contours_of(recipe, **options):
    """The payload of the only group that is asked for."""
    (((payload, _),),) = (made([recipe], ("contours",), **options).values(),)
    return payload


def expected(values):
    values = np.asarray(values, np.float64)
    return [len(values), values.sum(), (values**2).sum(), values.min(), values.max()]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("solid", "hand", "strategy"), EXACT + OTHERS)
def test_statistics_are_those_of_what_render_gives(solid, hand, strategy):
    payload = contours_of(recipe_of(solid, hand, random_motion(300), strategy))
    batch = render(load_solid(solid, Placement()), load_hand(hand, None), poses_of(300), load_strategy(strategy))
    lengths = batch.lengths()
    columns = {f"length_{kind}": lengths[:, k] for k, kind in enumerate(("object", "hand", "made"))}
    for name, column in (columns | {"length": lengths.sum(axis=1)}).items():
        np.testing.assert_allclose(payload["stat"][name], expected(column), rtol=1e-6, atol=1e-12)
    assert payload["stat"]["polylines"] == expected(np.diff(batch.pose_start))
    assert (payload["poses"], payload["poses_drawn"]) == (300, np.count_nonzero(lengths.sum(axis=1)))
    assert payload["poses_drawn"] > 0


def mixed():
    """Recipes of two scenes, of motions made on the host and on the device, and one without any contact."""
    away = recipe_of(thing_of("tube", at=[0.0, 0.0, 3.0]), motion=random_motion(700))
    motions = [explored(1.0, seed=4), random_motion(1300), random_motion(513, seed=9), explored(0.1), random_motion(1)]
    return [away, *(recipe_of("tube", motion=motion, strategy=name) for motion in motions for name in ("cc", "hatch"))]


@pytest.fixture(scope="module")
def alone():
    """The results of each recipe in a unit of its own on the CPU."""
    results = {}
    for recipe in mixed():
        results |= made([recipe], GROUPS)
    assert len(results) == 33
    return results


BATCHES = {  # how batches are made otherwise: of everything, of two spans, and too large ones halved
    "together": {},
    "small": {"batch_capacity": lambda *_: 2 * SPAN},
    "halved": {"point_limit": lambda _: 12_000},  # some 600 poses of the tube
}


@pytest.fixture
def counts(monkeypatch):
    """The number of poses of each batch that is measured."""
    found, measure = [], unit_making.measure_batch
    monkeypatch.setattr(unit_making, "measure_batch", lambda *a, **o: found.append(len(a[1])) or measure(*a, **o))
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("batches", BATCHES)
def test_recipes_in_any_batches_and_on_every_device_are_bit_identical(alone, monkeypatch, device, batches, counts):
    for name, value in BATCHES[batches].items():
        monkeypatch.setattr(unit_making, name, value)
    unit_making.learned_size.cache_clear()
    assert made(mixed(), GROUPS, device) == alone
    assert (max(counts) > 2 * SPAN) == (batches != "small")
    assert batches != "halved" or min(counts[1:6]) < max(counts)


def test_several_sampling_strategies_share_a_rendering(counts):
    recipes = [recipe_of(sampling=name) for name in ("stm", "capped", "dtp")]
    payloads = payloads_of(make_unit(unit_of(recipes), "cpu"))
    assert counts == [180]
    assert [group for group, _, _ in payloads] == ["contours", *["frequency"] * 3]
    stages = [own["seconds"].keys() for own in payloads.values()]
    assert [{"find", "join"} <= own for own in stages] == [True, False, False, False]  # counted once
    for recipe in recipes:
        place = "frequency", recipe.key("frequency"), 0
        assert made([recipe], ("frequency",))[place][0] == payloads[place] | {"seconds": None}


# Failures


def failures_of(result):
    """Messages by the place of the chunk."""
    return {failed.place: failed.message for failed in result.failed}


@pytest.fixture
def open_box(tmp_path):
    """A mesh that lacks a triangle."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "open.stl")
    return thing_of(tmp_path / "open.stl", at=[0.0, 0.0, 0.2])


def test_a_recipe_that_fails_leaves_the_others(tmp_path, open_box):
    for name in ("gone.stl", "changed.stl"):
        trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / name)
    gone, changed = (thing_of(tmp_path / name) for name in ("gone.stl", "changed.stl"))
    (tmp_path / "gone.stl").unlink()
    (tmp_path / "changed.stl").write_bytes((tmp_path / "changed.stl").read_bytes() + b" ")
    given = [("cube", "cc"), (open_box, "cc"), (open_box, "oc"), (gone, "cc"), (changed, "cc"), ("cube", "oc")]
    recipes = [recipe_of(solid, strategy=strategy) for solid, strategy in given]
    unit = unit_of(recipes)
    unit = replace(unit, chunks=(*unit.chunks, Chunk("{}", ("contours",))))
    result = make_unit(unit, "cpu")
    messages = failures_of(result)
    assert list(messages) == [1, 3, 4, 6]
    assert "open.stl, palm" in messages[1]
    assert "open edges" in messages[1]
    assert "gone.stl: cannot be read" in messages[3]
    assert "changed.stl: has changed since the plan was read" in messages[4]
    assert "\n" not in "".join(messages.values())
    keys = {key for group, key, _ in payloads_of(result) if group == "contours"}
    assert keys == {recipes[k].key("contours") for k in (0, 2, 5)}
    assert not result.is_unnamed


def own_strategy(folder, body):
    """A strategy with a stage of a user's, by the lines of its function."""
    module = f"stage_{folder.name}"
    lines = f"def stage(batch, setting):\n{body}\nregister_transform('{module}', stage)\n"
    (folder / f"{module}.py").write_text(f"from palpate.render import register_transform\n{lines}")
    described = {"modules": [module], "prune": ["outside"], "transform": ["close", module]}
    (folder / "own.json").write_text(json.dumps(described))
    return strategy_of(folder / "own.json")


def test_a_rendering_that_fails_takes_none_of_its_batch_with_it(monkeypatch):
    recipes = [recipe_of(motion=random_motion(count)) for count in (60, 50, 40)]
    measure, slice_counts = unit_making.measure_batch, []

    def measured(scene, pose, slices, **options):
        slice_counts.append([own.count for own in slices])
        if 50 in slice_counts[-1]:
            raise StrategyError("fifty poses are too many")
        return measure(scene, pose, slices, **options)

    monkeypatch.setattr(unit_making, "measure_batch", measured)
    result = make_unit(unit_of(recipes, ("contours",)), "cpu")
    assert slice_counts == [[60, 50, 40], [60], [50], [40]]
    assert failures_of(result).keys() == {1}
    assert "fifty poses" in result.failed[0].message
    assert {key for _, key, _ in payloads_of(result)} == {recipes[k].key("contours") for k in (0, 2)}


def test_all_chunks_of_a_rendering_that_fails_have_failed(monkeypatch):
    def fail(*_, **__):
        raise StrategyError("no batch of it can be made")

    recipe = recipe_of("cube", motion=random_motion(2 * CHUNK_POSES))
    monkeypatch.setattr(unit_making, "measure_batch", fail)
    result = make_unit(unit_of([recipe], chunk_count=3), "cpu")
    assert failures_of(result).keys() == {0, 1, 2}
    assert "it has no chunk 2, as its motion has 262144 poses" in result.failed[2].message


# KeyboardInterrupt stands last: where a fault lets it out of the test, it ends pytest, and nothing after it runs.
RAISED = ["type('Strange', (BaseException,), {})()", "GeneratorExit()", "KeyboardInterrupt()"]


@pytest.mark.parametrize("raised", RAISED)
def test_no_exception_of_a_stage_ends_a_worker(tmp_path, raised, monkeypatch):
    """A worker ignores Ctrl-C, so that KeyboardInterrupt is the stage's own."""
    monkeypatch.setattr(signal, "getsignal", lambda number: signal.SIG_IGN)
    strategy = own_strategy(tmp_path, f"    raise {raised}")
    recipes = [recipe_of(), recipe_of(strategy=strategy)]
    result = make_unit(unit_of(recipes, ("contours",)), "cpu")
    assert result.is_unnamed  # each chunk is made again, in a unit of its own
    assert failures_of(result).keys() == {0, 1}
    assert raised.removeprefix("type('").split("'")[0].removesuffix("()") in result.failed[0].message
    assert result.rows == ()


def test_code_of_a_user_never_runs_in_the_process_that_gives_the_unit(tmp_path):
    strategy = own_strategy(tmp_path, "    return batch")
    recipes = [recipe_of(strategy=strategy), recipe_of(strategy="cc")]
    (tmp_path / f"stage_{tmp_path.name}.py").write_text("raise SystemExit('it has run')\n")
    result = make_unit(unit_of(recipes, parent=this_process()), "cpu")
    assert failures_of(result).keys() == {0}
    assert "give run_sweep an executor of processes" in result.failed[0].message
    function = Chunk(recipes[1].to_json(), ("contours", "metric 0123 f"))
    unit = Unit((function,), result_code(), user_metrics=(("metric 0123 f", "mine.py:f"),))
    assert "executor of processes" in make_unit(unit, "cpu").failed[0].message


def result_code():
    return unit_of([]).code_version


def test_a_disk_on_which_no_folder_can_be_made_is_a_transient_failure(monkeypatch):
    def full(**_):
        raise OSError(errno.ENOSPC, "No space left on device", "/scratch")

    monkeypatch.setattr(unit_making.tempfile, "mkdtemp", full)
    result = make_unit(unit_of([recipe_of(), recipe_of("cube")]), "cpu")
    assert result.is_unnamed
    assert [(own.place, own.is_transient) for own in result.failed] == [(0, True), (1, True)]
    assert result.failed[0].message == "No space left on device (/scratch)"
