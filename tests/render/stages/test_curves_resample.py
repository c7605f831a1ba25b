"""The stage "resample": more vertices along the same contours, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from transform_cases import (
    a_setting,
    assert_equal,
    assert_valid,
    batch_of_loops,
    random_poses,
    random_regions,
    run_stage,
    with_weights,
)

from palpate.kernels.offsets import PointLimitError
from palpate.render import ContourBatch, IntersectionStrategy, MeshObject, Palm, Stage, exploration, render
from palpate.render.errors import StrategyError
from palpate.render.intersection.job import MEMORY_SMALLEST
from palpate.render.stages.point_function import segment_lengths

ROUNDING = 1e-7  # [m]; of the length of a part whose ends are float32, near the array


def resampled(batch, spacing):
    """Slow and obvious: rows (x, y, z, kind, intensity, dwell) of each polyline, segment by segment."""
    lines = []
    for a, b in zip(batch.polyline_start[:-1].tolist(), batch.polyline_start[1:].tolist(), strict=True):
        p, level = batch.points.astype(float), batch.intensity.astype(float)
        rows = []
        for i in range(a, b - 1):
            rows.append([*p[i], batch.kind[i], level[i], batch.dwell[i]])
            parts = max(1, int(np.ceil(np.linalg.norm(p[i + 1] - p[i]) / spacing)))
            for share in [k / parts for k in range(1, parts)]:
                x, value = p[i] + share * (p[i + 1] - p[i]), level[i] + share * (level[i + 1] - level[i])
                rows.append([*x, batch.kind[i], value, 0.0])
        lines.append(np.array([*rows, [*p[b - 1], batch.kind[b - 1], level[b - 1], batch.dwell[b - 1]]]))
    return lines


@pytest.mark.parametrize("spacing", [1e-4, 0.00137, 0.5])
def test_segments_are_divided_as_the_oracle_divides_them_and_the_rest_stays(spacing, rng):
    batch, setting, _ = random_regions(rng)
    batch = with_weights(replace(batch, raw_error=1e-8), rng)
    out = run_stage("resample", batch, setting, spacing=spacing)
    assert_valid(out, batch.pose_count)
    for name in ("pose_start", "polyline_patch", "polyline_closed"):
        np.testing.assert_array_equal(getattr(out, name), getattr(batch, name), err_msg=name)
    assert out.raw_error == 1e-8
    want = resampled(batch, spacing)
    assert np.diff(out.polyline_start).tolist() == [len(rows) for rows in want]
    got = np.column_stack([out.points, out.kind, out.intensity, out.dwell])
    np.testing.assert_allclose(got, np.concatenate(want), rtol=0, atol=1e-7)
    assert segment_lengths(out)[1].max() <= spacing + ROUNDING
    np.testing.assert_allclose(out.lengths(), batch.lengths(), rtol=2e-6)
    assert_equal(run_stage("resample", out, setting, spacing=spacing), out)


def test_old_vertices_keep_their_bits_and_their_pauses(rng):
    batch, setting, _ = random_regions(rng)
    batch = with_weights(batch, rng)
    out = run_stage("resample", batch, setting, spacing=0.001)
    place = {tuple(row): k for k, row in enumerate(out.points.tolist())}
    old = np.array([place[tuple(row)] for row in batch.points.tolist()])
    np.testing.assert_array_equal(out.intensity[old], batch.intensity)
    np.testing.assert_array_equal(out.dwell[old], batch.dwell)
    assert np.count_nonzero(out.dwell) == np.count_nonzero(batch.dwell)


def test_sides_of_a_whole_number_of_spacings_have_as_many_parts_wherever_they_are(rng):
    square = 0.0425 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    setting = a_setting(random_poses(rng, 50))
    batch = batch_of_loops([[square]] * 50, setting.frames)
    assert len({*segment_lengths(batch)[1].tolist()}) > 10  # rounded differently at each pose
    out = run_stage("resample", batch, setting, spacing=0.005)
    assert np.diff(out.polyline_start).tolist() == [4 * 17 + 1] * 50
    assert_equal(run_stage("resample", out, setting, spacing=0.005), out)


@pytest.mark.parametrize("far", [0.2, 100.0, 1e5])
def test_far_from_the_array_parts_may_be_as_long_as_rounding_makes_them(far, rng):
    batch, setting, _ = random_regions(rng)
    batch = replace(batch, points=batch.points + np.float32([far, 0, 0]))
    out = run_stage("resample", batch, setting, spacing=0.001)
    assert segment_lengths(out)[1].max() <= 0.001 + 4 * np.spacing(np.float32(far))
    assert_equal(run_stage("resample", out, setting, spacing=0.001), out)


def test_nothing_and_segments_of_no_length_stay_as_they_are(rng):
    batch, setting, _ = random_regions(rng)
    for none in (batch.select(0, 1), batch.select(0, 0)):
        assert none.polyline_count == 0
        assert_equal(run_stage("resample", none, a_setting(setting.pose[: none.pose_count])), none)
    still = ContourBatch(
        points=np.full((3, 3), 0.1, np.float32),
        kind=np.zeros(3, np.uint8),
        polyline_start=np.array([0, 3]),
        polyline_patch=np.zeros(1, np.int32),
        polyline_closed=np.ones(1, np.uint8),
        pose_start=np.array([0, 1]),
    )
    assert_equal(run_stage("resample", still, a_setting(setting.pose[:1]), spacing=1e-4), still)


def test_the_default_is_a_quarter_of_the_focal_width(rng):
    batch, setting, _ = random_regions(rng)
    assert setting.focal_width == 0.01
    assert_equal(run_stage("resample", batch, setting), run_stage("resample", batch, setting, spacing=0.0025))


@pytest.mark.parametrize("spacing", [0, -0.001, 9e-5, 1.5, float("nan"), float("inf"), "1 mm", True])
def test_a_spacing_out_of_range_is_refused_with_its_bounds(spacing):
    with pytest.raises(StrategyError, match=r"resample\.spacing must .*0\.0001\.\.1 m, not "):
        IntersectionStrategy(prune=("outside",), transform=("close", Stage("resample", {"spacing": spacing})))


def test_more_points_than_the_limit_ask_for_smaller_batches(rng):
    batch, setting, _ = random_regions(rng)
    count = run_stage("resample", batch, setting, spacing=0.001).point_count
    enough = replace(setting, point_limit=count)
    assert run_stage("resample", batch, enough, spacing=0.001).point_count == count
    with pytest.raises(PointLimitError) as refused:
        run_stage("resample", batch, replace(setting, point_limit=count - 1), spacing=0.001)
    assert refused.value.count == count


def test_renderings_are_the_same_however_little_memory_there_is():
    tube = MeshObject.load("tube")
    motion = exploration(tube, duration=2.0, rate=200.0, seed=1)
    strategy = IntersectionStrategy(prune=("outside",), transform=("close", Stage("resample", {"spacing": 1e-4})))
    whole, parts = (render(tube, Palm(), motion, strategy, memory=m) for m in (None, 2 * MEMORY_SMALLEST))
    assert whole.point_count * 28 > 2 * MEMORY_SMALLEST  # 28 bytes a point: one batch would not fit
    for name, values in whole.arrays().items():
        np.testing.assert_array_equal(parts.arrays()[name], values, err_msg=name)
