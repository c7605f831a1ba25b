"""The stage "resample": more vertices along the same contours, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from transform_cases import (
    assert_equal,
    assert_valid,
    random_regions,
    run_stage,
    with_weights,
)

from palpate.kernels.offsets import PointLimitError
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


@pytest.mark.parametrize("far", [0.2, 100.0, 1e5])
def test_far_from_the_array_parts_may_be_as_long_as_rounding_makes_them(far, rng):
    batch, setting, _ = random_regions(rng)
    batch = replace(batch, points=batch.points + np.float32([far, 0, 0]))
    out = run_stage("resample", batch, setting, spacing=0.001)
    assert segment_lengths(out)[1].max() <= 0.001 + 4 * np.spacing(np.float32(far))
    assert_equal(run_stage("resample", out, setting, spacing=0.001), out)


def test_more_points_than_the_limit_ask_for_smaller_batches(rng):
    batch, setting, _ = random_regions(rng)
    count = run_stage("resample", batch, setting, spacing=0.001).point_count
    enough = replace(setting, point_limit=count)
    assert run_stage("resample", batch, enough, spacing=0.001).point_count == count
    with pytest.raises(PointLimitError) as refused:
        run_stage("resample", batch, replace(setting, point_limit=count - 1), spacing=0.001)
    assert refused.value.count == count
