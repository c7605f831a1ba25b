"""Intervals between poses, halved: those of slerp by sines, but for a last bit; rows in order of time."""

import itertools

import numpy as np
import pytest
import warp as wp
from insertion_oracle import middle

from palpate.kernels.motions.halving import given_rows, halve_intervals, ordered_rows


def random_poses(count, spread, seed=1):
    """Poses of which each is a little away from the one before."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0, spread, (count, 4)), axis=0) + np.array([0.5, 0.5, -0.5, 0.5])
    turn *= rng.choice([-1, 1], (count, 1)) / np.linalg.norm(turn, axis=1, keepdims=True)
    return np.concatenate([rng.normal(0, 0.1, (count, 3)), turn], axis=1).astype(np.float32)


def halved(pose, far, device, *, time=None, compared=None, level=0, hold=1.0, least=0.1):
    time = np.arange(len(pose), dtype=float) if time is None else time
    rows = given_rows(time, pose, np.ones(len(pose), bool) if compared is None else compared, device)
    flags = wp.array(np.asarray(far, np.uint8), dtype=wp.uint8, device=device)
    return rows, halve_intervals(rows, flags, level, hold=hold, least=least)


@pytest.mark.parametrize("spread", [1e-8, 1e-4, 0.1, 2.0])
def test_middles_are_those_of_slerp_but_for_the_last_bit_of_one_in_a_thousand(spread, device):
    pose = random_poses(3000, spread)
    _, out = halved(pose, np.ones(3000), device)
    made = out.middle.pose.numpy()
    assert len(made) == 2999
    wanted = np.array([middle(p, q) for p, q in itertools.pairwise(pose)])
    other = made != wanted
    assert np.count_nonzero(other) <= 3
    assert (np.abs(made - wanted)[other] <= np.spacing(np.abs(wanted[other]))).all()
    np.testing.assert_array_equal(out.middle.time.numpy(), np.arange(2999) + 0.5)


def test_of_rotations_half_a_turn_apart_the_signs_decide(device):
    turns = np.array([[0, 0, 0, 1], [1, 0, 0, 0], [0.6, 0, 0, 0.8], [0.6, 0, 0, -0.8], [-1, 0, 0, 0], [0, 0, 0, 1]])
    pose = np.concatenate([np.zeros((6, 3)), turns], axis=1).astype(np.float32)
    _, out = halved(pose, [1, 1, 1, 1, 1, 0], device)
    found, half = out.middle.pose.numpy()[:, [3, 6]], np.sqrt(0.5)
    np.testing.assert_allclose(found[[0, 4]], [[half, half], [-half, half]], atol=1e-7)


def test_rows_are_the_ends_and_middles_of_chosen_intervals(device):
    """Intervals 0 and 1 share a pose; 2 is not far, 3 is not compared, 4 is longer than is held, 5 too short."""
    time = np.array([0.0, 1, 2, 3, 4, 6, 6.15])
    compared = [1, 1, 1, 0, 1, 1, 1]
    rows, out = halved(random_poses(7, 0.1), [1, 1, 0, 1, 0, 1, 1], device, time=time, compared=np.array(compared))
    assert out.rows.time.numpy().tolist() == [0, 0.5, 1, 1.5, 2, 4, 5, 6]
    assert out.rows.compared.numpy().tolist() == [1, 1, 1, 1, 0, 1, 1, 0]
    assert out.middle.time.numpy().tolist() == [0.5, 1.5, 5]
    times, pose, start = ordered_rows([rows, out.middle], np.array([0, 3, 3, 5, 7]))
    assert times.numpy().tolist() == [0, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 6.15]
    np.testing.assert_array_equal(pose.numpy()[[0, 2, 4]], rows.pose.numpy()[:3])
    assert start.tolist() == [0, 5, 5, 8, 10]


def test_levels_follow_each_other_and_end(device):
    rows, out = halved(random_poses(2, 0.1), [1, 0], device, time=np.array([0.0, 1.0]), least=0.0)
    parts = [rows, out.middle]
    for level in range(1, 4):
        far = wp.full(len(out.rows.time), 1, dtype=wp.uint8, device=device)
        out = halve_intervals(out.rows, far, level, hold=1.0, least=0.0)
        parts.append(out.middle)
    times, _, start = ordered_rows(parts, np.array([0, 2]))
    np.testing.assert_array_equal(times.numpy(), np.arange(17) / 16)
    assert start.tolist() == [0, 17]
    assert halved(random_poses(2, 0.1), [0, 0], device)[1] is None
    assert halved(random_poses(2, 0.1), [1, 0], device, level=32)[1] is None
    assert halved(random_poses(1, 0.1), [1], device)[1] is None
