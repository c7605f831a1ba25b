"""A sweep's worker: what it stores is what rendering gives, however pieces are batched, and failures stay apart."""

import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from sweep_recipes import explored, random_motion, recipe_of, recorded, strategy_of, task_of, thing_of

from palpate.datasets import HandMotion
from palpate.datasets.motions.motion_file import MotionRows, row_place, write_rows
from palpate.datasets.recordings.alignment import Y_UP, write_alignment
from palpate.datasets.recordings.files import load_recording
from palpate.datasets.recordings.sample import write_sample
from palpate.datasets.sweeps.shard import read_shard
from palpate.kernels.metrics.random_pose import random_poses
from palpate.render import render
from palpate.render.errors import StrategyError
from palpate.render.intersection import batch_rendering as render_batch
from palpate.render.intersection.named_inputs import load_hand, load_hand_and_motion, load_solid
from palpate.render.objects.functions.expression import sphere
from palpate.render.objects.functions.expression_json import expression_to_json
from palpate.render.objects.mesh.placement import Placement
from palpate.render.strategies.intersection_strategy import load_strategy
from palpate.render.sweeps.make import batch as batch_module
from palpate.render.sweeps.make import work as work_module
from palpate.render.sweeps.make.batch import PoseRange, RenderedChunk, join_ranges, take_batch
from palpate.render.sweeps.make.poses import pose_count
from palpate.render.sweeps.make.rendering import CostCache
from palpate.render.sweeps.make.task import CHUNK_POSES, SPAN
from palpate.render.sweeps.make.work import run_task

KINDS = ("object", "hand", "made")
EXACT = [("tube", "palm", "cc"), ("sphere", "palm", "oc"), ("dog", "planes", "cc"), ("cube", "palm", "hatch")]
OTHERS = [("dog", "palm", "smooth"), ("tube", "palm", "inset-hatch"), ("tube", "planes", "simplified")]


def made(store, recipes, groups=("contours",), device="cpu", **options):
    """Payloads and columns of a task by (group, key, part); timings left out."""
    outcome = run_task(task_of(store, recipes, groups, **options), device, worker="here")
    assert outcome.error is None
    return rows_of(store, outcome)


def rows_of(store, outcome):
    shard = read_shard(store / outcome.shard)
    out = {}
    for row, columns in zip(shard.rows, shard.columns, strict=True):
        payload = {name: value for name, value in row.payload.items() if name != "seconds"}
        out[row.group, row.key, row.part] = payload, {k: v.tobytes() for k, v in (columns or {}).items()}
    assert len(out) == len(shard.rows) == outcome.row_count
    return out


def poses_of(count, seed=1, device="cpu"):
    rows = random_poses(0, count, seed=seed, size=0.13, at=(0.0, 0.0, 0.2), device=device)
    return rows.numpy().reshape(-1, 7)


def expected(values):
    values = np.asarray(values, np.float64)
    return [len(values), values.sum(), (values**2).sum(), values.min(), values.max()]


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize(("thing", "hand", "strategy"), EXACT + OTHERS)
def test_statistics_are_those_of_what_render_gives(tmp_path, thing, hand, strategy):
    count = 300
    recipe = recipe_of(thing, hand, random_motion(count), strategy)
    ((payload, _),) = made(tmp_path, [recipe]).values()
    batch = render(
        load_solid(thing, Placement()), load_hand(hand, None), poses_of(count), load_strategy(strategy), device="cpu"
    )
    lengths = batch.lengths()
    assert (lengths > 0).any()
    for name, column in zip(KINDS, lengths.T, strict=True):
        np.testing.assert_allclose(payload["stat"][f"length_{name}"], expected(column), rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(payload["stat"]["length"], expected(lengths.sum(axis=1)), rtol=1e-6, atol=1e-12)
    assert payload["stat"]["polylines"] == expected(np.diff(batch.pose_start))
    assert (payload["poses"], payload["poses_drawn"]) == (count, np.count_nonzero(lengths.sum(axis=1)))


@pytest.fixture
def things(tmp_path):
    """Objects that are no meshes, as recipes have them."""
    z, y, x = np.meshgrid(*[np.arange(24) - 11.5] * 3, indexing="ij")
    np.savez(tmp_path / "ball.npz", values=x**2 + y**2 + z**2 < 81, affine=np.diag([0.005, 0.005, 0.005, 1.0]))
    (tmp_path / "drop.json").write_text(expression_to_json(sphere(0.05)))
    at = [0.0, 0.0, 0.2]
    return [thing_of(str(tmp_path / name), at=at) for name in ("ball.npz", "drop.json")]


@pytest.mark.exhaustive
def test_voxels_and_expressions_are_rendered_as_render_does(tmp_path, things):
    for thing in things:
        recipe = recipe_of(thing, motion=random_motion(200))
        ((payload, _),) = made(tmp_path, [recipe]).values()
        solid = load_solid(thing["source"], Placement(at=tuple(thing["at"])))
        lengths = render(solid, load_hand("palm", None), poses_of(200), load_strategy("cc")).length()
        assert payload["poses_drawn"] == np.count_nonzero(lengths) > 20
        assert payload["stat"]["length"][1] == pytest.approx(lengths.sum(dtype=np.float64), rel=1e-6)


def mixed():
    """Recipes of two scenes, of motions made here and there, one without any contact."""
    away = recipe_of(thing_of("tube", at=[0.0, 0.0, 3.0]), motion=random_motion(700))
    motions = [explored(1.0, seed=4), random_motion(1300), random_motion(513, seed=9), explored(0.1), random_motion(1)]
    both = [recipe_of("tube", motion=motion, strategy=name) for motion in motions for name in ("cc", "hatch")]
    return [away, *both]


GROUPS = ("contours", "frequency", "poses")


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What each recipe is when it is made by itself on the CPU."""
    store = tmp_path_factory.mktemp("alone")
    out = {}
    for number, recipe in enumerate(mixed()):
        out |= made(store, [recipe], GROUPS, number=number)
    assert len(out) == 33
    return out


BATCHES = {  # how batches are made otherwise: of everything, of two spans, and too large ones halved
    "together": {},
    "small": {"batch_capacity": lambda *_: 2 * SPAN},
    "halved": {"point_limit": lambda _: 12_000, "_batches_known": {}},  # some 600 poses of the tube
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("batches", BATCHES)
def test_recipes_in_any_batches_and_on_every_device_are_the_same_to_the_bit(
    tmp_path, alone, monkeypatch, device, batches
):
    counts, measure = [], work_module.measure_batch
    monkeypatch.setattr(work_module, "measure_batch", lambda *a, **o: counts.append(len(a[1])) or measure(*a, **o))
    for name, value in BATCHES[batches].items():
        monkeypatch.setattr(work_module, name, value)
    assert made(tmp_path, mixed(), GROUPS, device) == alone
    assert (max(counts) > 2 * SPAN) == (batches != "small")
    assert batches != "halved" or min(counts[1:6]) < max(counts)


def test_parts_are_counted_from_the_first_pose_and_made_where_asked(tmp_path):
    recipe = recipe_of("cube", motion=random_motion(CHUNK_POSES + 700))
    task = task_of(tmp_path, [recipe], ("contours", "poses"), chunk_count=2)
    outcome = run_task(task, "cpu", worker="here")
    rows = rows_of(tmp_path, outcome)
    poses = [rows["contours", recipe.key("contours"), part][0]["poses"] for part in (0, 1)]
    assert (poses, outcome.pose_count) == ([CHUNK_POSES, 700], CHUNK_POSES + 700)
    columns = read_shard(tmp_path / outcome.shard).columns
    number = np.concatenate([own["pose"] for own in columns if own])
    np.testing.assert_array_equal(number, np.arange(CHUNK_POSES + 700))
    assert pose_count(recipe) == CHUNK_POSES + 700


def test_several_sampling_strategies_share_a_rendering(tmp_path, monkeypatch):
    rendered = []
    measure = work_module.measure_batch
    monkeypatch.setattr(work_module, "measure_batch", lambda *a, **o: rendered.append(len(a[1])) or measure(*a, **o))
    recipes = [recipe_of(sampling=name) for name in ("stm", "capped", "dtp")]
    rows = made(tmp_path, recipes, ("contours", "frequency"))
    assert rendered == [180]
    assert [group for group, _, _ in rows] == ["contours", *["frequency"] * 3]
    timed = [row.payload["seconds"] for row in read_shard(tmp_path / "shards/shard-0.h5").rows]
    assert [{"find", "join"} <= own.keys() for own in timed] == [True, False, False, False]  # counted once
    for recipe in recipes:
        alone = made(tmp_path, [recipe], ("frequency",), name=f"alone-{recipe.sampling['name']}")
        assert alone["frequency", recipe.key("frequency"), 0] == rows["frequency", recipe.key("frequency"), 0]


@pytest.fixture
def recording(tmp_path):
    """A recorded hand over the array, and its alignment."""
    path = write_sample("openxr", tmp_path / "hand.json", frame_count=40)
    middle = np.median(load_recording(path, alignment=Y_UP).skin_pose()[:, :3], axis=0)
    write_alignment(tmp_path / "above.json", [*(np.array([0.0, 0.05, 0.2]) - middle), *Y_UP[3:]])
    return recorded(path, alignment=tmp_path / "above.json", rate=900.0)


@pytest.mark.exhaustive
def test_hands_that_are_posed_by_a_recording_keep_to_their_rows(tmp_path, recording, monkeypatch):
    recipes = [recipe_of("tube", "planes", recording), recipe_of("tube", "palm", recording)]
    rows = made(tmp_path, recipes, GROUPS)
    source, above = recording["source"], recording["alignment"]["source"]
    for recipe in recipes:
        options = {"duration": None, "rate": recording["rate"], "seed": None}
        kind = recipe.hand["source"]
        hand, motion = load_hand_and_motion(kind, None, source, None, exploration_options=options, alignment=above)
        lengths = render(load_solid("tube", Placement()), hand, motion, load_strategy("cc")).length()
        payload, _ = rows["contours", recipe.key("contours"), 0]
        assert payload["poses"] == pose_count(recipe) == len(motion) > 2 * SPAN
        assert payload["poses_drawn"] == np.count_nonzero(lengths) > 100
        assert payload["stat"]["length"][1] == pytest.approx(lengths.sum(dtype=np.float64), rel=1e-6)
    monkeypatch.setattr(work_module, "batch_capacity", lambda *_: SPAN)
    assert made(tmp_path, recipes, GROUPS, name="cut") == rows


def test_poses_are_counted_without_making_them(tmp_path, recording):
    for duration, rate in ((0.1, 30.0), (2.0, 90.0), (1.0, 7.3)):
        recipe = recipe_of(motion=explored(duration, rate))
        assert pose_count(recipe) == work_module.recipe_cache("cpu").rendering(recipe).poses.count
    pose = poses_of(7)
    for name in ("a.h5", "a.csv"):
        HandMotion(None, pose).save(tmp_path / name)
        assert pose_count(recipe_of(motion=recorded(tmp_path / name))) == 7
    for hand in ("palm", "planes"):
        recipe = recipe_of("tube", hand, recording)
        assert pose_count(recipe) == work_module.recipe_cache("cpu").rendering(recipe).poses.count > 20


def test_a_word_for_an_alignment_turns_a_recording_as_its_transform_does(tmp_path):
    path = write_sample("openxr", tmp_path / "hand.json", frame_count=4)
    recipe = recipe_of(motion=recorded(path) | {"alignment": {"source": "y-up", "name": "y-up"}})
    poses = work_module.recipe_cache("cpu").rendering(recipe).poses
    assert pose_count(recipe) == poses.count == 4
    np.testing.assert_array_equal(poses.rows(0, 4, "cpu"), load_recording(path, alignment=Y_UP).motion().pose)


OWN = """
from palpate.render import register_transform


def refuse(batch, setting):
    '''Nothing, but an error for a hand far from the axis.'''
    if (abs(setting.pose[:, 0]) > 0.5).any():
        raise RuntimeError("a hand too far out")
    return batch


register_transform("refuse-%s", refuse)
"""


@pytest.mark.filterwarnings("ignore::palpate.render.errors.PalpateWarning")
def test_a_recipe_that_fails_leaves_the_others(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    trimesh.Trimesh(box.vertices, box.faces[:-1], process=False).export(tmp_path / "open.stl")
    thing = thing_of(str(tmp_path / "open.stl"), at=[0.0, 0.0, 0.2])
    for name in ("gone.stl", "changed.stl"):
        box.export(tmp_path / name)
    gone, changed = (thing_of(str(tmp_path / name)) for name in ("gone.stl", "changed.stl"))
    (tmp_path / "gone.stl").unlink()
    (tmp_path / "changed.stl").write_bytes((tmp_path / "changed.stl").read_bytes() + b" ")
    recipes = [
        recipe_of("cube"),
        recipe_of(thing),
        recipe_of(thing, strategy="oc"),
        recipe_of(gone),
        recipe_of(changed),
        recipe_of("cube", strategy="oc"),
    ]
    outcome = run_task(task_of(tmp_path, recipes), "cpu", worker="here")
    assert [failed.place for failed in outcome.failed] == [1, 3, 4]
    sentences = {failed.place: failed.message for failed in outcome.failed}
    assert "open.stl, palm" in sentences[1]
    assert "open edges" in sentences[1]
    assert "gone.stl: cannot be read" in sentences[3]
    assert "changed.stl: has changed since the plan was read" in sentences[4]
    assert sentences[1] in outcome.error
    assert "\n" not in outcome.error
    keys = {key for group, key, _ in rows_of(tmp_path, outcome) if group == "contours"}
    assert keys == {recipes[k].key("contours") for k in (0, 2, 5)}


def test_a_stage_that_fails_on_one_motion_takes_no_other_with_it(tmp_path):
    module = f"refusing_{tmp_path.name}"
    (tmp_path / f"{module}.py").write_text(OWN % module)
    own = {"modules": [module], "prune": ["outside"], "transform": ["close", f"refuse-{module}"]}
    (tmp_path / "own.json").write_text(json.dumps(own))
    far = poses_of(5)
    far[3, 0] = 0.6
    write_rows(tmp_path / "far.csv", MotionRows(None, far, 0.0, None, row_place), overwrite=False)
    strategy = strategy_of(tmp_path / "own.json")
    motions = [random_motion(600), recorded(tmp_path / "far.csv"), random_motion(30, seed=2)]
    recipes = [recipe_of(motion=motion, strategy=strategy) for motion in motions]
    outcome = run_task(task_of(tmp_path, recipes), "cpu", worker="here")
    assert [failed.place for failed in outcome.failed] == [1]
    assert "far.csv" in outcome.error
    assert "a hand too far out" in outcome.error
    assert {key for _, key, _ in rows_of(tmp_path, outcome)} == {
        recipes[k].key(group) for k in (0, 2) for group in ("contours", "frequency")
    }


def test_a_rendering_that_fails_takes_none_of_its_batch_with_it(tmp_path, monkeypatch):
    recipes = [recipe_of(motion=random_motion(count)) for count in (60, 50, 40)]
    measure, counts = work_module.measure_batch, []

    def measured(scene, pose, slices, **options):
        counts.append([own.count for own in slices])
        if 50 in counts[-1]:
            raise StrategyError("fifty poses are too many")
        return measure(scene, pose, slices, **options)

    monkeypatch.setattr(work_module, "measure_batch", measured)
    outcome = run_task(task_of(tmp_path, recipes, ("contours",)), "cpu", worker="here")
    assert counts == [[60, 50, 40], [60], [50], [40]]
    assert [failed.place for failed in outcome.failed] == [1]
    assert "fifty poses" in outcome.error
    assert {key for _, key, _ in rows_of(tmp_path, outcome)} == {recipes[k].key("contours") for k in (0, 2)}


def test_what_is_kept_for_later_tasks_has_a_limit():
    kept, made_of = CostCache(10, len), []

    def value(text):
        return kept.get(text[:1], lambda: made_of.append(text) or text)

    for text in ("aaaa", "bbbb", "a", "cccc", "b", "dddddddddddd", "d", "c"):
        value(text)
    assert made_of == ["aaaa", "bbbb", "cccc", "b", "dddddddddddd", "c"]
    asked = []
    other = CostCache(10**6, lambda value: asked.append(value) or 1)
    for k in range(100):
        other.get(str(k), lambda k=k: k)
    assert asked == list(range(100))  # what a thing costs is asked once


def test_a_task_that_cannot_be_read_is_told(tmp_path):
    task = task_of(tmp_path, [recipe_of()])
    broken = type(task)(3, (type(task.chunks[0])("{}", ("contours",)),), str(tmp_path), "a")
    outcome = run_task(broken, "cpu", worker="here")
    assert (outcome.number, outcome.shard, outcome.row_count) == (3, None, 0)
    assert outcome.failed[0].place == 0


FULL = """
import resource, sys
from palpate.kernels import compile_kernels
from palpate.render.sweeps.make.work import run_task
from sweep_recipes import random_motion, recipe_of, task_of
task = task_of(sys.argv[1], [recipe_of("cube", motion=random_motion(4000))], ("contours", "poses"))
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))
print(run_task(task, "cpu", worker="here").error)
"""


@pytest.mark.exhaustive
def test_a_full_disk_is_told_and_nothing_is_left(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert "File too large" in done.stdout.splitlines()[-1]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_batch_on_a_cpu_is_as_large_as_those_of_render():
    for hand in (None, "planes"):
        scene_bytes = 1024 * (1 if hand is None else load_hand(hand, None).patch_count)
        capacity = batch_module.batch_capacity(scene_bytes, "cpu")
        assert capacity % SPAN == 0
        assert capacity * scene_bytes <= render_batch.CPU_SPAN_BYTES


@given(
    counts=st.lists(st.integers(1, 12 * SPAN), min_size=1, max_size=6),
    spans=st.integers(1, 16),
    fits=st.lists(st.booleans(), max_size=30),
)
def test_batches_cover_every_pose_once_in_order_whatever_does_not_fit(counts, spans, fits):
    left = [PoseRange(k, 0, count) for k, count in enumerate(counts)]  # a chunk is a name here
    capacity, reached = spans * SPAN, [0] * len(counts)
    while left:
        batch, left = take_batch(left, capacity)
        if not (fits.pop() if fits else True) and capacity > SPAN:
            capacity, left = capacity // 2 // SPAN * SPAN, join_ranges([*batch, *left], lambda chunk: chunk)
            continue
        assert 0 < sum(own.count for own in batch) <= capacity
        assert len({own.chunk for own in batch}) == len(batch)
        for own in batch:
            assert reached[own.chunk] == own.first
            assert own.stop % SPAN == 0 or own.stop == counts[own.chunk]
            reached[own.chunk] = own.stop
    assert reached == counts


def test_poses_are_those_of_each_rendering_though_one_ends_where_the_next_begins():
    class Rows:
        def __init__(self, value):
            self.value = value

        def rows(self, first, stop, device):
            return np.full((stop - first, 7), self.value, np.float32)

    one, other = (SimpleNamespace(poses=Rows(value)) for value in (1.0, 2.0))
    batch = [
        PoseRange(RenderedChunk(one, 0), CHUNK_POSES - 2, CHUNK_POSES),
        PoseRange(RenderedChunk(one, 1), CHUNK_POSES, CHUNK_POSES + 1),
        PoseRange(RenderedChunk(other, 1), CHUNK_POSES + 1, CHUNK_POSES + 4),
    ]
    assert batch_module.poses_of(batch, "cpu")[:, 0].tolist() == [1.0] * 3 + [2.0] * 3
    assert [(s.first, s.stop) for s in join_ranges(batch, lambda chunk: chunk)] == [(s.first, s.stop) for s in batch]
