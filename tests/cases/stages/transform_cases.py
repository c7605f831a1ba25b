"""Random regions in the plane of a palm, as contours and as shapely's polygons, for tests of transformations."""

from dataclasses import replace

import numpy as np
import shapely
import warp as wp
from contour_random import random_batch

from palpate.kernels.section.draw import HAND, MADE, OBJECT
from palpate.kernels.stages.regions import Regions
from palpate.render import ContourBatch, MeshObject, Palm, Scene
from palpate.render.hands.plane_hand import flat_hand
from palpate.render.stages.registry import Stage, find_stage
from palpate.render.stages.setting import Setting

FOCAL_WIDTH = 0.01


def run_stage(name, batch, setting, **options):
    """A transform stage by name, wherever it runs, its result on the host."""
    entry = find_stage("transform", name)
    stage = Stage(name, options)
    entry.check(stage)
    batch = batch if entry.on == "host" else batch.to(setting.device)
    return entry.function(batch, setting, **entry.values(stage, setting.focal_width)).numpy()


def a_setting(pose, *, solid=None, hand=None, device="cpu", object_pose=None):
    return Setting(
        solid, hand or Palm(), np.asarray(pose, np.float32), 0, device, FOCAL_WIDTH, 0.0025, object_pose=object_pose
    )


def random_poses(rng, count):
    pose = rng.normal(size=(count, 7))
    pose[:, :3] = 0.05 * pose[:, :3] + [0, 0, 0.2]
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    return pose.astype(np.float32)


def star(rng, middle, radius, count=40):
    """A simple loop around a middle, counter-clockwise."""
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(-0.3, 0.3, count)) / count
    reach = radius * (1 + 0.25 * np.sin(3 * angle + rng.uniform(0, 6)) + rng.uniform(-0.1, 0.1, count))
    return middle + reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def lifted(flat, frames, pose):
    return frames.origin[pose, 0] + flat[:, :1] * frames.u[pose, 0] + flat[:, 1:] * frames.v[pose, 0]


def flattened(points, frames, pose):
    off = np.asarray(points, np.float64) - frames.origin[pose, 0]
    return np.stack([off @ frames.u[pose, 0], off @ frames.v[pose, 0]], axis=1)


def batch_of_loops(poses, frames, rng=None, closed=True):
    """A batch from loops in the palm's plane by pose, the first point not repeated; kinds at random."""
    points, kinds, counts = [], [], []
    for k, loops in enumerate(poses):
        for loop in loops:
            own = np.vstack([loop, loop[:1]]) if closed else np.asarray(loop)
            kind = np.zeros(len(own)) if rng is None else rng.integers(0, 2, len(own))
            kind[-1] = kind[-2]
            points.append(lifted(own, frames, k))
            kinds.append(kind)
            counts.append(len(own))
    return ContourBatch(
        points=np.concatenate([*points, np.zeros((0, 3))]).astype(np.float32),
        kind=np.concatenate([*kinds, []]).astype(np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        polyline_patch=np.zeros(len(counts), np.int32),
        polyline_closed=np.full(len(counts), closed, np.uint8),
        pose_start=np.concatenate([[0], np.cumsum([len(loops) for loops in poses])]).astype(np.int64),
    )


def random_regions(rng, count=8):
    """Poses with none, one or two regions, some with a hole: batch, setting, and polygons by pose."""
    pose = random_poses(rng, count)
    setting = a_setting(pose)
    loops, polygons = [], []
    for k in range(count):
        own, shapes = [], []
        for side in range(k % 3):
            middle = np.array([0.022 * (2 * side - 1), rng.uniform(-0.01, 0.01)])
            outer = star(rng, middle, 0.016)
            own.append(outer)
            hole = None
            if rng.random() < 0.5:
                hole = star(rng, middle, 0.005)[::-1]
                own.append(hole)
            shapes.append(shapely.Polygon(outer, [] if hole is None else [hole]))
        loops.append(own)
        polygons.append(shapes)
    return batch_of_loops(loops, setting.frames, rng), setting, polygons


def nested_loops(rng, setting, pose_count):
    """Loops in loops, each pose's in any order: holes in holes' islands, holes without a loop around, lone loops."""
    poses = []
    for _ in range(pose_count):
        loops = []
        for side in range(rng.integers(0, 4)):
            middle = np.array([0.05 * side, rng.uniform(-0.01, 0.01)])
            for level, radius in enumerate((0.02, 0.012, 0.006, 0.003)[: rng.integers(1, 5)]):
                loops.append(star(rng, middle, radius, rng.integers(3, 30))[:: 1 - 2 * (level % 2)])
            if rng.random() < 0.3:
                loops = loops[1:]  # a hole without its loop
        poses.append([loops[k] for k in rng.permutation(len(loops))])
    return batch_of_loops(poses, setting.frames, rng)


def region_batches(rng, device):
    """Batches and settings: regions with holes, nested loops, lines on many patches, and several kinds of nothing."""
    batch, setting, _ = random_regions(rng, 9)
    yield batch, a_setting(setting.pose, device=device)
    setting = a_setting(random_poses(rng, 40), device=device)
    nested = nested_loops(rng, setting, 40)
    yield nested, setting
    hand = flat_hand()
    lines = random_batch(rng, 30, patch_count=hand.patch_count)
    yield lines, a_setting(random_poses(rng, 30), hand=hand, device=device)
    yield nested.select(3, 3), a_setting(setting.pose[3:3], device=device)
    yield random_batch(rng, 5, line_most=0), a_setting(random_poses(rng, 5), device=device)


def with_weights(batch, rng):
    """A batch with an intensity at each point and a pause at some, which agree at seams."""
    intensity = rng.random(batch.point_count).astype(np.float32)
    dwell = np.where(rng.random(batch.point_count) < 0.1, 0.01, 0).astype(np.float32)
    for a, b in zip(batch.polyline_start[:-1], batch.polyline_start[1:], strict=True):
        intensity[b - 1], dwell[b - 1] = intensity[a], dwell[a]
    return replace(batch, intensity=intensity, dwell=dwell)


def near_poses(rng, count, spread=0.02):
    pose = random_poses(rng, count)
    pose[:, :3] = spread * rng.normal(size=(count, 3)) + [0, 0, 0.2]
    return pose


def rendered(rng, device, *, thing="tube", hand=None, moved=False, count=25):
    """Contours of some poses, and their setting, with intensities and an object that has moved if asked."""
    solid, hand, pose = MeshObject.load(thing), hand or Palm(), near_poses(rng, count)
    batch, _ = Scene.of(solid, hand, "cc").contours(pose, 0, device)
    batch = batch.numpy()
    intensity = rng.uniform(0.2, 1.0, batch.point_count).astype(np.float32)
    intensity[batch.polyline_start[1:] - 1] = intensity[batch.polyline_start[:-1]]
    batch = ContourBatch(**{**batch.by_name(), "intensity": intensity})
    return batch, a_setting(
        pose, solid=solid, hand=hand, device=device, object_pose=near_poses(rng, count) if moved else None
    )


def assert_valid(batch, pose_count):
    """Whatever a stage gives is a batch: offsets, dtypes, seams, kinds, no segment without length."""
    start, count = batch.polyline_start, batch.point_count
    assert batch.pose_count == pose_count
    assert (start[0], start[-1]) == (0, count)
    assert (batch.pose_start[0], batch.pose_start[-1]) == (0, batch.polyline_count)
    assert (np.diff(start) >= 2).all()
    assert (np.diff(batch.pose_start) >= 0).all()
    for name, dtype in (("points", "f4"), ("kind", "u1"), ("polyline_patch", "i4"), ("polyline_closed", "u1")):
        assert getattr(batch, name).dtype == dtype, name
    assert start.dtype == batch.pose_start.dtype == np.int64
    assert batch.points.shape == (count, 3)
    assert np.isfinite(batch.points).all()
    assert np.isin(batch.kind, (OBJECT, HAND, MADE)).all()
    for a, b, closed in zip(start[:-1], start[1:], batch.polyline_closed, strict=True):
        assert (np.linalg.norm(np.diff(batch.points[a:b], axis=0), axis=1) > 0).all()
        assert batch.kind[b - 1] == batch.kind[b - 2]
        if closed:
            for values in (batch.points, batch.intensity, batch.dwell):
                assert values is None or (values[a] == values[b - 1]).all()
    for values in (batch.intensity, batch.dwell):
        if values is not None:
            assert values.shape == (count,)
            assert values.dtype == np.float32
            assert (values >= 0).all()
    if batch.intensity is not None:
        assert (batch.intensity <= 1).all()


def assert_equal(got, want):
    assert got.by_name().keys() == want.by_name().keys()
    for name, values in want.by_name().items():
        np.testing.assert_array_equal(getattr(got, name), values, err_msg=name)


def plane_arrays(regions, device, *, order=None, filled=None):
    """Arguments of `draw_hatch` for regions in a plane, each a list of loops; order: that of all loops in the batch."""
    loops = [np.reshape(loop, (-1, 2)) for region in regions for loop in region]
    order = np.arange(len(loops)) if order is None else order
    place = np.empty(len(loops), np.int32)
    place[order] = np.arange(len(loops))
    closed = [np.vstack([loops[k], loops[k][:1]]) for k in order]
    points = np.concatenate([*closed, np.zeros((0, 2))])
    filled = np.ones(len(regions)) if filled is None else filled
    out = Regions()
    out.local = wp.array(np.column_stack([points, np.zeros(len(points))]), dtype=wp.vec3d, device=device)
    out.polyline_start = offsets_on([len(loop) for loop in closed], device)
    out.region_start = offsets_on([len(region) for region in regions], device)
    out.region_line = wp.array(place, dtype=wp.int32, device=device)
    return out, wp.array(np.asarray(filled), dtype=wp.uint8, device=device)


def offsets_on(counts, device):
    return wp.array(np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), dtype=wp.int64, device=device)


def random_stars(rng, count):
    """Regions at random places, most with a hole or two."""
    regions = []
    for _ in range(count):
        middle, radius = rng.uniform(-0.05, 0.05, 2), 10 ** rng.uniform(-3.5, -1.2)
        loops = [star(rng, middle, radius, int(rng.integers(5, 80)))]
        for side in range(int(rng.integers(0, 3))):
            away = radius * np.array([0.3 * (2 * side - 1), rng.uniform(-0.1, 0.1)])
            loops.append(star(rng, middle + away, 0.2 * radius, int(rng.integers(3, 30)))[::-1])
        regions.append(loops)
    return regions
