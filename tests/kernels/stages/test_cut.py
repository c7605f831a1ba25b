"""Cutting: what is left of contours when segments, or parts of them, are taken out."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_batch

from palpate.kernels.stages.cut import cut_contours, divide_segments
from palpate.render import ContourBatch
from palpate.render.stages.prune import cut_batch


def runs_of(kept, closed):
    """Runs of kept parts of one polyline, as lists of part numbers, in the order in which pieces are written."""
    count = len(kept)
    if all(kept):
        return [list(range(count))]
    turn = kept.index(False) if closed else 0
    runs, own = [], []
    for part in [(turn + j) % count for j in range(count)]:
        if kept[part]:
            own.append(part)
        elif own:
            runs.append(own)
            own = []
    return [*runs, own] if own else runs


def slow_cut(batch, start, segment, share, keep):
    """The rules of `kernels.cut`, one polyline after the other; parts as arrays."""
    rows = {"points": [], "kind": [], "intensity": []}
    counts, patches, closed_rows, pose_counts = [], [], [], []

    def write(i, t, kind):
        mixed = {}
        for name in ("points", "intensity"):
            value = getattr(batch, name)
            a = np.asarray(value[i], np.float64)
            mixed[name] = a if t == 0 else a + t * (np.asarray(value[i + 1], np.float64) - a)
        rows["points"].append(mixed["points"])
        rows["intensity"].append(mixed["intensity"])
        rows["kind"].append(kind)

    for pose in range(batch.pose_count):
        pieces = 0
        for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
            base, last = batch.polyline_start[line], batch.polyline_start[line + 1] - 1
            first, stop = start[base], start[last]
            kept = [bool(k) for k in keep[first:stop]]
            for run in runs_of(kept, batch.polyline_closed[line]):
                before = len(rows["kind"])
                for k, part in enumerate(run):
                    if k == 0 or share[first + part] == 0:
                        write(segment[first + part], share[first + part], batch.kind[segment[first + part]])
                end = first + run[-1] + 1
                own = segment[end - 1]
                whole = end == start[own + 1]
                write(own + 1 if whole else own, 0.0 if whole else share[end], batch.kind[own])
                counts.append(len(rows["kind"]) - before)
                patches.append(batch.polyline_patch[line])
                closed_rows.append(batch.polyline_closed[line] and all(kept))
                pieces += 1
        pose_counts.append(pieces)
    return ContourBatch(
        points=np.array(rows["points"], np.float64).reshape(-1, 3).astype(np.float32),
        kind=np.array(rows["kind"], np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        polyline_patch=np.array(patches, np.int32),
        polyline_closed=np.array(closed_rows, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(pose_counts)]).astype(np.int64),
        intensity=np.array(rows["intensity"], np.float64).astype(np.float32),
    )


def assert_same(batch, other):
    host, wanted = batch.numpy().by_name(), other.numpy().by_name()
    assert host.keys() == wanted.keys()
    for name in host:
        np.testing.assert_array_equal(host[name], wanted[name], err_msg=name)


@pytest.mark.parametrize("share_kept", [0.0, 0.3, 0.8, 1.0])
def test_segments_are_cut_as_the_slow_way_does(device, rng, share_kept):
    batch = random_batch(rng, 40)
    keep = (rng.uniform(size=batch.point_count) < share_kept).astype(np.uint8)
    start = np.zeros(batch.point_count + 1, np.int64)
    is_segment = np.ones(batch.point_count, np.int64)
    is_segment[batch.polyline_start[1:] - 1] = 0
    start[1:] = np.cumsum(is_segment)
    segment = np.flatnonzero(is_segment)
    wanted = slow_cut(batch, start, segment, np.zeros(len(segment)), keep[segment])
    cut, _ = cut_batch(batch.to(device), wp.array(keep, device=device))
    assert_same(cut, wanted)


def test_parts_of_segments_are_cut_as_the_slow_way_does(device, rng):
    batch = random_batch(rng, 40)
    on = batch.to(device)
    parts = divide_segments(on.struct, 0.004)
    keep = (rng.uniform(size=parts.segment.shape[0]) < 0.8).astype(np.uint8)
    wanted = slow_cut(batch, parts.start.numpy(), parts.segment.numpy(), parts.share.numpy(), keep)
    cut, removed = cut_batch(on, wp.array(keep, device=device), parts=parts)
    assert_same(cut, wanted)
    np.testing.assert_allclose(cut.length() + removed, batch.length(), atol=2e-6)
    assert removed.sum() > 0.1


def test_pauses_stay_at_the_points_they_were_at(rng):
    batch = random_batch(rng, 10)
    dwell = rng.uniform(size=batch.point_count).astype(np.float32)
    number = np.arange(batch.point_count, dtype=np.float32)  # as an intensity: whole at what was a point
    on = ContourBatch(**{**batch.by_name(), "intensity": number, "dwell": dwell}).to("cpu")
    parts = divide_segments(on.struct, 0.004)
    keep = (rng.uniform(size=parts.segment.shape[0]) < 0.7).astype(np.uint8)
    keep = wp.array(keep, device="cpu")  # where the batch is: by default it would be on a GPU
    cut, _ = cut_batch(on, keep, parts=parts)
    at = cut.intensity.numpy()
    want = np.where(at == np.floor(at), dwell[at.astype(int)], 0)
    np.testing.assert_array_equal(cut.dwell.numpy(), want)
    assert 0 < np.count_nonzero(want) < len(want)
    assert cut_contours(batch.to("cpu").struct, keep, parts).dwell is None
