"""Contours, palms and settings for tests of prune stages."""

from types import SimpleNamespace

import numpy as np

from palpate.render import ContourBatch, IntersectionStrategy
from palpate.render.hands.hand import PatchFrames
from palpate.render.stages.registry import Stage
from palpate.render.stages.setting import Setting
from palpate.render.strategies.stage_runner import run_stages

FOCAL_WIDTH = 0.0101


def flat_frames(origins, half=((0.0425, 0.0425),)):
    """Patches whose skin faces an array below them, for one pose."""
    count = len(origins)
    axes = [np.tile(np.array(axis, float), (1, count, 1)) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    return PatchFrames(np.array([origins], float), *axes, np.array(half, float))


def a_setting(frames, device="cpu", **other):
    count = len(frames.origin)
    hand = SimpleNamespace(frames=lambda pose, first: frames, **{"pose_count": count, **other})
    pose = np.tile(np.array([0, 0, 0.2, 0, 0, 0, 1], np.float32), (count, 1))
    return Setting(None, hand, pose, 0, device, FOCAL_WIDTH, FOCAL_WIDTH / 4)


def pruned(batch, setting, name, **options):
    out, removed = run_stages(batch, IntersectionStrategy(prune=(Stage(name, options),)), setting)
    assert list(removed) == [name]
    return out.numpy(), removed[name]


def lines_at(*lines, closed=False, patches=None):
    """A batch of one pose from polylines, all open or all closed."""
    lines = [np.vstack([line, line[:1]]) if closed else np.asarray(line) for line in map(np.asarray, lines)]
    count = len(lines)
    points = np.concatenate(lines).astype(np.float32)
    return ContourBatch(
        points=points,
        kind=np.zeros(len(points), np.uint8),
        polyline_start=np.concatenate([[0], np.cumsum([len(line) for line in lines])]).astype(np.int64),
        polyline_patch=np.array(patches or [0] * count, np.int32),
        polyline_closed=np.full(count, closed, np.uint8),
        pose_start=np.array([0, count]),
    )


def circle(radius, middle=(0, 0, 0.2), count=40):
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1) + middle
