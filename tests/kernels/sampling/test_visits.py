"""Revisits of any focal points, silent ones among them, are those that the watch in NumPy counts."""

from itertools import pairwise

import numpy as np
import pytest
import warp as wp
from numpy_sampler import revisits as numpy_revisits
from sampling_cases import schedule_of_motions

from palpate.kernels.sampling.visits import REVISIT_RADIUS, count_revisits, picked_sample
from palpate.render.sampling import revisits
from palpate.render.sampling.metrics import FocalPoints, SamplingCount

RATE = 1000.0
INTERVAL = round(revisits.PICK_INTERVAL * RATE)


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


def rest_in_poses(rng, starts, position, intensity):
    """Let focal points rest throughout most poses, some of them silent; in some samples all are."""
    for first, stop in pairwise(starts.tolist()):
        if rng.random() < 0.8 and stop > first:
            position[first:stop] = position[first : first + 1]
            intensity[first:stop] = rng.uniform(size=position.shape[1]) > 0.2
            intensity[first:stop][rng.uniform(size=stop - first) < 0.2] = 0


@pytest.mark.parametrize("rests", [False, True])
@pytest.mark.parametrize("pose_rate", [90, 11])  # poses of one box, and of several
@pytest.mark.parametrize("foci", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_picks_wait_as_long_as_the_watch_in_numpy_counts(seed, foci, pose_rate, rests, device):
    rng = np.random.default_rng(seed)
    count, motions = 400 * pose_rate // 90, 2
    bounds = np.ceil(np.arange(count + 1) / pose_rate * RATE).astype(int)
    starts = np.concatenate([bounds[:-1], bounds[-1] + bounds])
    position, intensity = wandering(rng, foci, int(starts[-1]))
    if rests:
        rest_in_poses(rng, starts, position, intensity)
    pose = rng.normal(size=(2 * count, 7)) * 0.001 + [0, 0, 0.2, 0.7, 0, 0, 0.7]
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    found = count_revisits(
        schedule_of_motions([np.diff(bounds)] * 2, device),
        wp.array(pose, dtype=wp.transformd, device=device),
        wp.array(position, dtype=wp.vec3, device=device),
        wp.array(intensity, device=device),
        sample_start=starts[::count],
        pick_count=np.full(2, -(-bounds[-1] // INTERVAL)),
        first_sample=np.zeros(2, np.int64),
        first_pick=np.zeros(2, np.int64),
        interval=INTERVAL,
        limit=int(RATE),
    )
    for motion in range(motions):
        expected = SamplingCount()
        watch = numpy_revisits.RevisitWatch(expected, RATE)
        for k in range(motion * count, (motion + 1) * count):
            rows = slice(starts[k], starts[k + 1])
            watch.take(FocalPoints(position[rows], intensity[rows]), pose[k])
        assert found[motion, 0] == expected.revisits > 10
        assert found[motion, 1] == round(expected.revisit_time * RATE)


def test_each_interval_has_one_pick():
    assert [picked_sample(pick, 200) // 200 for pick in range(5000)] == list(range(5000))


def test_places_and_waits_are_those_of_the_watch_in_numpy():
    assert REVISIT_RADIUS == numpy_revisits.REVISIT_RADIUS
    assert (revisits.REVISIT_LIMIT, revisits.PICK_INTERVAL) == (
        numpy_revisits.REVISIT_LIMIT,
        numpy_revisits.PICK_INTERVAL,
    )
