"""Metrics of poses: the same bits in any batches and on any device; NaN where a metric does not apply."""

import json

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from palpate.kernels.metrics.random_pose import random_poses
from palpate.render import (
    IntersectionStrategy,
    MeshObject,
    Palm,
    SamplingStrategy,
    closed_contour,
    open_contour,
)
from palpate.render.contour_batch import ContourBatch
from palpate.render.intersection.scene import Scene
from palpate.render.sampling.presets import PRESETS
from palpate.render.sweeps.make.histogram import merge, quantiles
from palpate.render.sweeps.make.metrics import FREQUENCIES, ChunkSlice, UserMetric, measure_batch
from palpate.render.sweeps.make.unit import SPAN

TUBE, CUBE, CC = MeshObject.load("tube"), MeshObject.load("cube"), closed_contour()
STM, RETURN = SamplingStrategy(), PRESETS["fast-return"]()
PRUNED = IntersectionStrategy(prune=("outside", "turned-away", "small"), transform=("close",))
CUBE_SCENE = Scene.of(CUBE, Palm(), CC)


def share(contours):
    """Numbers that depend on the other poses of the same call, with NaN among them."""
    own = np.where(contours.length() > 0.1, contours.length("hand"), np.nan)
    return {"hand": own, "among": np.full(len(own), np.nansum(own) + len(own))}


USERS = (UserMetric("metric 0 length", "mine.py:length", ContourBatch.length), UserMetric("metric 0 share", "", share))


def random_on(device, count, seed=0):
    return random_poses(0, count, seed=seed, size=0.13, at=(0, 0, 0.2), device=device)


def measured(scene, pose, device, samplings=(STM,), **options):
    """All poses as one chunk."""
    own = ChunkSlice(0, 0, len(pose), tuple(samplings))
    return measure_batch(scene, pose, [own], device=device, **options)[0]


def without_seconds(result):
    """All that must be bit-identical, as it is stored."""
    payloads = [result.contours, *result.frequency, *result.user_metrics.values()]
    return json.dumps([{name: value for name, value in p.items() if name != "seconds"} for p in payloads])


@pytest.fixture(scope="module")
def renderings():
    """Poses of three recipes, the metrics that each asks for, and the result of each alone, in one batch."""
    poses = [random_on("cpu", count, seed).numpy() for seed, count in enumerate((3 * SPAN + 70, 2 * SPAN, 45))]
    asked = [((STM, RETURN), USERS), ((), ()), ((RETURN,), USERS[1:])]
    whole = [
        measure_batch(CUBE_SCENE, own, [ChunkSlice(0, 0, len(own), *metrics)], device="cpu", per_pose=True)[0]
        for own, metrics in zip(poses, asked, strict=True)
    ]
    return poses, asked, whole


def batches_of(takes, counts):
    """Batches of (rendering, first, count): spans as given, then all that is left, a rendering once a batch."""
    at, batch = [0] * len(counts), []
    for rendering, spans, ends in (*takes, *((rendering, 99, False) for rendering in range(len(counts)))):
        count = min(spans * SPAN, counts[rendering] - at[rendering])
        if ends or rendering in [own for own, _, _ in batch]:
            yield batch
            batch = []
        if count:
            batch.append((rendering, at[rendering], count))
            at[rendering] += count
    yield batch


@given(takes=st.lists(st.tuples(st.integers(0, 2), st.integers(1, 3), st.booleans()), max_size=8))
@settings(max_examples=8, phases=[Phase.generate])  # shrinking renders more than it tells
def test_bits_do_not_depend_on_how_chunks_are_cut_and_joined(takes, renderings):
    poses, asked, whole = renderings
    done, columns = [None] * 3, [[], [], []]
    for batch in filter(None, batches_of(takes, [len(p) for p in poses])):
        starts = np.cumsum([0, *(count for _, _, count in batch)]).tolist()
        slices = [
            ChunkSlice(0, first, count, *asked[rendering], before=done[rendering])
            for first, (rendering, _, count) in zip(starts, batch, strict=False)  # the last start is the end
        ]
        pose = np.concatenate([poses[rendering][at : at + count] for rendering, at, count in batch])
        results = measure_batch(CUBE_SCENE, pose, slices, device="cpu", per_pose=True)
        for (rendering, _, _), result in zip(batch, results, strict=True):
            done[rendering] = result
            columns[rendering].append(result.columns)
    for rendering in range(3):
        assert without_seconds(done[rendering]) == without_seconds(whole[rendering])
        for k, want in enumerate(whole[rendering].columns):
            for name, column in want.items():
                got = np.concatenate([one[k][name] for one in columns[rendering]])
                np.testing.assert_array_equal(got, column)
                assert got.dtype == column.dtype


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("solid", [TUBE, CUBE], ids=lambda solid: solid.name)
@pytest.mark.parametrize("strategy", [CC, open_contour()], ids=["cc", "oc"])
def test_every_device_gives_the_same_bits(solid, strategy, device):
    scene = Scene.of(solid, Palm(), strategy)
    samplings = tuple(make() for make in PRESETS.values())
    pose = random_on("cpu", 1100, 5).numpy()
    there = measured(scene, random_on(device, 1100, 5), device, samplings)
    assert without_seconds(there) == without_seconds(measured(scene, pose, "cpu", samplings))


def test_statistics_are_those_of_the_columns(device):
    pose = random_on(device, 2 * SPAN + 100)
    result = measured(Scene.of(TUBE, Palm(), CC), pose, device, (STM,), per_pose=True)
    (columns,) = result.columns
    assert columns["pose"].tolist() == list(range(len(pose)))
    stat = result.contours["stat"] | result.frequency[0]["stat"]
    assert set(stat) == set(columns) - {"pose"}
    for name, (count, total, square, least, greatest) in stat.items():
        x = columns[name].astype(np.float64)
        x = x[np.isfinite(x)]
        assert count == len(x)
        np.testing.assert_allclose([total, square], [x.sum(), (x * x).sum()], rtol=1e-12)
        assert (least, greatest) == (x.min(), x.max())
    length, count = columns["length"], merge([result.contours["histogram"]["length"]])
    want = np.quantile(length, [0.5, 0.95], method="inverted_cdf")
    np.testing.assert_allclose(quantiles(count, (50, 95), length.min(), length.max()), want, rtol=2**-7)
    drawn = np.count_nonzero(columns["length"])
    assert 0 < drawn < len(pose)
    for payload in (result.contours, *result.frequency):
        assert (payload["poses"], payload["poses_drawn"]) == (len(pose), drawn)
        assert json.loads(json.dumps(payload)) == payload
    assert stat[FREQUENCIES[0]][0] == stat[FREQUENCIES[1]][0] == drawn
    assert set(result.contours["seconds"]) == {"find", "join", "draw", "measure"}


def test_time_is_shared_by_poses_and_adds_up(device):
    pose = random_on(device, SPAN + 20)
    (begun,) = measure_batch(CUBE_SCENE, pose[:SPAN], [ChunkSlice(0, 0, SPAN, (STM,))], device=device)
    slices = [ChunkSlice(0, 0, 20, (STM,), before=begun), ChunkSlice(0, 20, 60, (STM,))]
    one, two = measure_batch(CUBE_SCENE, random_on(device, 80), slices, device=device)
    for first, ended, other in (
        (begun.contours, one.contours, two.contours),
        (*begun.frequency, *one.frequency, *two.frequency),
    ):
        assert ended["seconds"].keys() == first["seconds"].keys() == other["seconds"].keys()
        for stage, seconds in ended["seconds"].items():
            assert seconds == pytest.approx(first["seconds"][stage] + other["seconds"][stage] / 3)
