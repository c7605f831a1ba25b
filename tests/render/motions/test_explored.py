"""Explorations around objects, made on a device: the poses of `exploration`, to the bit."""

import itertools

import numpy as np
import pytest
import warp as wp

from palpate.datasets import exploration
from palpate.kernels.motions import around
from palpate.render import ExploredPoses, MeshObject
from palpate.render.motions.explored import joined_rows

ARGUMENTS = [
    {"bounds": "tube", "seed": 3},
    {"bounds": "cube", "seed": 4, "duration": 61.0, "rate": 77.7},
    {"bounds": [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]], "seed": 2**40, "duration": 0.01},
    {"bounds": "dog", "seed": 0, "rate": 1000.0, "duration": 2.0},
]


def made():
    """Poses to be made, and those of `exploration`."""
    motions = [ExploredPoses.of(**own, model="around") for own in ARGUMENTS]
    return motions, [exploration(**own, model="around").pose for own in ARGUMENTS]


def test_poses_are_those_of_exploration(device):
    motions, wanted = made()
    together = joined_rows([(own, 0, own.count) for own in motions], device)
    np.testing.assert_array_equal(together.numpy(), np.concatenate(wanted))
    for own, pose in zip(motions, wanted, strict=True):
        np.testing.assert_array_equal(own.motion.pose, pose)
        np.testing.assert_array_equal(own.time, exploration(**own.arguments).time)


def test_parts_are_those_of_the_whole(device):
    motions, wanted = made()
    bounds = [0, 1, 700, 701, 2699, 2700]
    parts = [joined_rows([(motions[0], *pair)], device).numpy() for pair in itertools.pairwise(bounds)]
    np.testing.assert_array_equal(np.concatenate(parts), wanted[0])
    mixed = joined_rows([(motions[1], 5, 900), (motions[3], 0, 2000), (motions[1], 900, 901)], device)
    np.testing.assert_array_equal(mixed.numpy(), np.concatenate([wanted[1][5:900], wanted[3], wanted[1][900:901]]))


def test_models_may_be_mixed(device):
    motions, wanted = made()
    over = ExploredPoses.of("tube", duration=1.0, explorer=6)
    rows = joined_rows([(motions[3], 0, 2000), (over, 0, 90), (motions[0], 0, 10)], device)
    np.testing.assert_array_equal(rows.numpy(), np.concatenate([wanted[3], over.motion.pose, wanted[0][:10]]))
    assert repr(motions[1]) == "ExploredPoses(4740 poses at 77.7 Hz, around, seed 4)"


def test_doubtful_poses_are_made_on_the_host(monkeypatch, device):
    """Were all poses doubtful, all would be right."""
    motions, wanted = made()

    def nothing(*given, device):
        count = int(given[-1][-1])
        return wp.zeros(count, dtype=wp.transform, device=device), wp.array(np.arange(count)[::-1], dtype=wp.int32)

    monkeypatch.setattr(around, "place_on_splines", nothing)
    rows = joined_rows([(motions[2], 0, 1), (motions[0], 100, 180), (motions[1], 0, 20)], device)
    np.testing.assert_array_equal(rows.numpy(), np.concatenate([wanted[2], wanted[0][100:180], wanted[1][:20]]))


@pytest.mark.exhaustive
def test_every_bit_of_a_million_poses(device):
    tube = MeshObject.load("tube")
    motions = [ExploredPoses.of(tube, duration=300.0, seed=seed, model="around") for seed in range(40)]
    rows = joined_rows([(own, 0, own.count) for own in motions], device).numpy()
    np.testing.assert_array_equal(rows, np.concatenate([own.motion.pose for own in motions]))
