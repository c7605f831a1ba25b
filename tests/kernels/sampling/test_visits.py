"""Revisits of any focal points, silent ones among them, are those that the host's watch counts."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.sampling.skin_boxes import REVISIT_RADIUS, skin_samples
from palpate.kernels.sampling.visits import count_revisits
from palpate.render.sampling import revisits
from palpate.render.sampling.metrics import FocalPoints, SamplingCount
from palpate.render.sampling.sampler import MotionSchedule
from palpate.render.sampling.strategy import SamplingStrategy

RATE = 1000.0


def wandering(rng, foci, count):
    """Focal points that go round and round, wander off, rest, and are silent for a while now and then."""
    turn = np.cumsum(rng.uniform(0, 0.2, (count, foci)), axis=0)
    turn[: count // 4] = turn[0]
    reach = 0.02 + 0.01 * np.sin(np.arange(count) / 300)[:, None]
    position = np.stack([reach * np.cos(turn), reach * np.sin(turn), np.full(turn.shape, 0.2)], axis=2)
    intensity = rng.uniform(size=(count, foci)) * (rng.uniform(size=(count, foci)) > 0.05)
    for first in rng.integers(0, count, 3):
        intensity[first : first + rng.integers(1, 400)] = 0
    return position.astype(np.float32), intensity.astype(np.float32)


def rest_in_poses(rng, schedule, position, intensity):
    """Let focal points rest throughout most poses, some of them silent; in some samples all are."""
    for first, count in zip(schedule.row.tolist(), schedule.count.tolist(), strict=False):
        if rng.random() < 0.8:
            rows = slice(first, first + count)
            position[rows] = position[first : first + 1]
            intensity[rows] = rng.uniform(size=position.shape[1]) > 0.2
            intensity[rows][rng.uniform(size=count) < 0.2] = 0


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("pose_rate", [90, 11])  # poses of one box, and of several
@pytest.mark.parametrize("foci", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_picks_wait_as_long_as_the_host_counts(seed, foci, pose_rate, rests, device):
    rng = np.random.default_rng(seed)
    count, motions = 400 * pose_rate // 90, 2
    time = np.tile(np.arange(count) / pose_rate, motions)
    strategy = SamplingStrategy(update_rate=RATE, foci=foci)
    schedule = MotionSchedule.of(time, [0, count, 2 * count], [count / pose_rate] * 2, strategy, None)
    position, intensity = wandering(rng, foci, int(schedule.row[-1]))
    if rests:
        rest_in_poses(rng, schedule, position, intensity)
    pose = rng.normal(size=(2 * count, 7)) * 0.001 + [0, 0, 0.2, 0.7, 0, 0, 0.7]
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    when = schedule.on(device, strategy)
    skin = skin_samples(
        when,
        wp.array(pose, dtype=wp.transformd, device=device),
        wp.array(position, dtype=wp.vec3, device=device),
        wp.array(intensity, device=device),
    )
    starts = schedule.sample_start
    interval = round(revisits.PICK_INTERVAL * RATE)
    picks = np.concatenate([[0], np.cumsum(-(-np.diff(starts) // interval))])
    offsets = (wp.array(values, dtype=wp.int64, device=device) for values in (starts, picks))
    number, waited = count_revisits(when, skin, *offsets, interval=interval, limit=int(RATE), rate=RATE)
    for motion in range(motions):
        expected = SamplingCount()
        watch = revisits.RevisitWatch(expected, RATE)
        for k in range(motion * count, (motion + 1) * count):
            rows = slice(schedule.row[k], schedule.row[k + 1])
            watch.take(FocalPoints(position[rows], intensity[rows]), pose[k])
        assert number.numpy()[motion] == expected.revisits > 10
        assert waited.numpy()[motion] == expected.revisit_time


def test_the_radius_is_the_hosts():
    assert REVISIT_RADIUS == revisits.REVISIT_RADIUS
