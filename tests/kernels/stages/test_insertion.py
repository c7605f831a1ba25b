"""Points put into polylines, against the NumPy way, which sorts them all."""

import numpy as np
import pytest
import warp as wp
from contour_random import bare, degenerate_batch, random_batch, weighted_batch
from polyline_oracle import Lines, divided, with_points
from stage_cases import assert_limited, stage_batches
from transform_cases import assert_equal, assert_valid

from palpate.kernels.offsets import PointLimitError
from palpate.kernels.stages.insertion import divide_rows, insert_points
from palpate.render import ContourBatch
from palpate.render.stages.curves import divide_batch


def inserted(batch, segment, part, device="cpu"):
    """The batch with points at parts of segments, in any order, and the new places of its old points."""
    order = np.lexsort((part, segment))
    count = 1 + np.bincount(segment, minlength=batch.point_count)
    start = np.concatenate([[0], np.cumsum(count)])
    share = np.zeros(start[-1])
    old = np.zeros(len(share), bool)
    old[start[:-1]] = True
    share[~old] = part[order]
    there = batch.to(device)
    rows = wp.array(start, dtype=wp.int64, device=device), wp.array(share, dtype=wp.float64, device=device)
    new = insert_points(there.struct, *rows)
    return ContourBatch.from_struct(new.contours).numpy(), new.place.numpy()


@pytest.mark.parametrize("longest", [5e-4, 0.00137, 0.005, 0.5])
def test_segments_are_divided_as_the_oracle_divides_them(longest, device, rng):
    for batch in stage_batches(rng):
        assert_equal(divide_batch(batch.to(device), longest).numpy(), divided(batch, longest))
        assert_equal(divide_batch(batch, longest), divided(batch, longest))


def test_points_put_in_split_segments_as_the_oracle_splits_them_and_leave_the_rest(device, rng):
    for batch in (weighted_batch(rng, 30), degenerate_batch(rng, 60), bare(degenerate_batch(rng, 60))):
        segment = rng.integers(0, batch.point_count, 400)
        segment = segment[Lines.of(batch).is_segment[segment]]
        part = rng.random(len(segment)).round(1)  # several at one place, some at ends
        part[:20], part[20:40], part[40:60] = 1e-12, 1 - 1e-12, rng.random(20)  # as near to ends as none
        out, place = inserted(batch, segment, part, device)
        want, base, share = with_points(batch, segment, part)
        assert_equal(out, want)
        np.testing.assert_array_equal(place[:-1], np.flatnonzero(share == 0))
        assert place[-1] == out.point_count
        for name, values in batch.by_name().items():
            if len(values) == batch.point_count:
                np.testing.assert_array_equal(getattr(out, name)[place[:-1]], values, err_msg=name)
        new = np.delete(np.arange(out.point_count), place[:-1])
        assert len(new) > 100
        assert out.dwell is None or not out.dwell[new].any()
        np.testing.assert_array_equal(out.kind[new], batch.kind[base[new]])
        np.testing.assert_allclose(out.to(device).lengths(), batch.to(device).lengths(), rtol=1e-5, atol=1e-8)


def test_points_put_in_leave_no_segment_without_length(device, rng):
    batch = weighted_batch(rng, 30)
    segment = np.flatnonzero(Lines.of(batch).is_segment).repeat(8)
    part = rng.choice([1e-9, 1e-12, 1 / 3, 1 / 3 + 1e-9, 1 / 3 + 1e-12, 1 - 1e-9, 0.0, 1.0], len(segment))
    out, _ = inserted(batch, segment, part, device)
    assert_valid(out, batch.pose_count)
    assert out.point_count > batch.point_count


def test_points_beyond_the_limit_are_refused_before_there_is_memory_for_them(device, rng):
    batch = bare(random_batch(rng, 5)).to(device)
    assert_limited(lambda limit: divide_batch(batch, 0.001, limit).point_count)
    with pytest.raises(PointLimitError):  # more than an array of Warp's can have, and than memory holds
        divide_rows(batch.struct, 1e-12, 10**6)
