"""Random batches of contours for tests of stages, and what must hold of what stages leave of them."""

from dataclasses import replace

import numpy as np

from palpate.render import ContourBatch


def random_batch(rng, pose_count, *, line_most=4, point_most=12, spread=0.04, patch_count=3, middle=(0, 0, 0.2)):
    """Polylines of random vertices, open and closed, kinds and intensity at random; some poses are empty."""
    points, kinds, counts, closed, lines = [], [], [], [], []
    for _ in range(pose_count):
        lines.append(rng.integers(0, line_most + 1))
        for _ in range(lines[-1]):
            own = rng.normal(size=(rng.integers(3, point_most), 3)) * spread + middle
            loops = rng.uniform() < 0.5
            own = (np.vstack([own, own[:1]]) if loops else own).astype(np.float32)
            kind = rng.integers(0, 3, len(own)).astype(np.uint8)
            kind[-1] = kind[-2]
            points.append(own)
            kinds.append(kind)
            counts.append(len(own))
            closed.append(loops)
    total = sum(counts)
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    intensity = rng.uniform(size=total).astype(np.float32)
    loops = np.flatnonzero(closed)
    intensity[start[loops + 1] - 1] = intensity[start[loops]]
    return ContourBatch(
        points=np.concatenate([*points, np.zeros((0, 3), np.float32)]),
        kind=np.concatenate([*kinds, np.zeros(0, np.uint8)]),
        polyline_start=start,
        polyline_patch=rng.integers(0, patch_count, len(counts)).astype(np.int32),
        polyline_closed=np.array(closed, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(lines)]).astype(np.int64),
        intensity=intensity,
    )


def weighted_batch(rng, pose_count):
    """Random polylines with intensities, and pauses at some points, which agree at seams."""
    batch = random_batch(rng, pose_count)
    dwell = rng.random(batch.point_count) * (rng.random(batch.point_count) < 0.3)
    loop = np.flatnonzero(batch.polyline_closed)
    dwell[batch.polyline_start[loop + 1] - 1] = dwell[batch.polyline_start[loop]]
    return replace(batch, dwell=dwell.astype(np.float32))


def degenerate_batch(rng, pose_count, *, weighted=True):
    """Polylines of 0 to 9 points, of which many repeat, stand alone, turn back or lie on a line; some poses are empty.

    Coordinates are multiples of 5 mm, kinds run over a few segments; closed polylines agree at their seams.
    """
    points, closed, lines = [], [], rng.integers(0, 4, pose_count)
    for _ in range(lines.sum()):
        own = 0.005 * rng.integers(-2, 3, (rng.integers(0, 9), 3)) * rng.integers(0, 2, 3) + [0, 0, 0.2]
        closed.append(rng.random() < 0.5)
        repeats = closed[-1] and (len(own) > 1 or rng.random() < 0.5)
        points.append((np.vstack([own, own[:1]]) if repeats else own).astype(np.float32))
    start = np.concatenate([[0], np.cumsum([len(own) for own in points])]).astype(np.int64)
    kind = np.repeat(rng.integers(0, 3, start[-1] // 3 + 1), 3)[: start[-1]].astype(np.uint8)
    weights = {}
    if weighted:
        weights = {"intensity": rng.random(start[-1]), "dwell": rng.random(start[-1]) * (rng.random(start[-1]) < 0.3)}
        weights = {name: value.astype(np.float32) for name, value in weights.items()}
    for a, b, loop in zip(start[:-1], start[1:], closed, strict=True):
        if b - a > 1:
            kind[b - 1] = kind[b - 2]
        for value in weights.values() if loop and b > a else ():
            value[b - 1] = value[a]
    return ContourBatch(
        points=np.concatenate([*points, np.zeros((0, 3), np.float32)]),
        kind=kind,
        polyline_start=start,
        polyline_patch=rng.integers(0, 3, len(closed)).astype(np.int32),
        polyline_closed=np.array(closed, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum(lines)]).astype(np.int64),
        **weights,
    )


def bare(batch):
    """A batch without intensity and dwell."""
    return replace(batch, intensity=None, dwell=None)


def kinds_agree(part, whole, tolerance=1e-6):
    """Assert that every segment of `part` lies on one of `whole`: of the same pose, patch, kind and direction."""
    part, whole = part.numpy(), whole.numpy()
    for pose in range(whole.pose_count):
        own = segments_of(whole, pose)
        for a, b, kind, patch in segments_of(part, pose):
            assert any(
                kind == k
                and patch == p
                and on_segment(a, c, d, tolerance)
                and on_segment(b, c, d, tolerance)
                and np.dot(b - a, d - c) > 0
                for c, d, k, p in own
            ), (pose, a, b, kind, patch)


def segments_of(batch, pose):
    """Segments of a pose on the host: start, end, kind, patch."""
    out = []
    for line in range(batch.pose_start[pose], batch.pose_start[pose + 1]):
        for i in range(batch.polyline_start[line], batch.polyline_start[line + 1] - 1):
            ends = batch.points[i : i + 2].astype(np.float64)
            out.append((ends[0], ends[1], batch.kind[i], batch.polyline_patch[line]))
    return out


def on_segment(x, a, b, tolerance):
    """Whether a point lies on a segment."""
    way = b - a
    share = np.clip(np.dot(x - a, way) / max(np.dot(way, way), 1e-30), 0, 1)
    return np.linalg.norm(a + share * way - x) <= tolerance


def random_strokes(rng, pose_count, *, line_most=4, with_intensity=False):
    """Polylines that stay from pose to pose and move by 2 mm, some of them of one place, a point or none; numbers of
    polylines change now and then, and some poses are empty."""
    middles, lines, count = rng.normal(size=(line_most, 3)) * 0.03, [], 0
    poses = []
    for _ in range(pose_count):
        count = rng.integers(0, line_most + 1) if rng.random() < 0.2 else count
        lines = [_stroke(rng, middles[k]) for k in range(0 if rng.random() < 0.15 else count)]
        poses.append(lines)
    strokes = [stroke for lines in poses for stroke in lines]
    size = [len(points) for points, _ in strokes]
    start = np.concatenate([[0], np.cumsum(size)]).astype(np.int64)
    intensity = np.clip(rng.normal(size=start[-1]) + 0.3, 0.0, 1.0).astype(np.float32)
    for k, (_, closed) in enumerate(strokes):
        if rng.random() < 0.2:
            intensity[start[k] : start[k + 1]] = 0.0
        if closed:
            intensity[start[k + 1] - 1] = intensity[start[k]]
    return ContourBatch(
        points=np.concatenate([np.zeros((0, 3)), *(points for points, _ in strokes)]).astype(np.float32),
        kind=np.zeros(start[-1], np.uint8),
        polyline_start=start,
        polyline_patch=np.zeros(len(size), np.int32),
        polyline_closed=np.array([closed for _, closed in strokes], np.uint8),
        pose_start=np.concatenate([[0], np.cumsum([len(lines) for lines in poses])]).astype(np.int64),
        intensity=intensity if with_intensity else None,
    )


def _stroke(rng, middle):
    kind = rng.random()
    if kind < 0.05:
        return rng.normal(size=(1, 3)) * 0.03 + [0, 0, 0.2], 0
    if kind < 0.1:
        return np.tile(rng.normal(size=3) * 0.03 + np.array([0, 0, 0.2]), (3, 1)), int(rng.random() < 0.5)
    steps = rng.normal(size=(rng.integers(2, 9), 3)) * rng.choice([1e-5, 1e-3, 1e-2])
    points = middle + rng.normal(size=3) * 0.002 + np.cumsum(steps, axis=0) + [0, 0, 0.2]
    if rng.random() < 0.3:
        points = np.insert(points, 1, points[1], axis=0)
    closed = int(rng.random() < 0.5)
    return (np.vstack([points, points[:1]]) if closed else points), closed
