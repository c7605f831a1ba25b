"""Control points of many explorations: those of the model, each with the bits that it has alone."""

import numpy as np
import pytest
from exploration_models import around as around_model
from scipy.spatial.transform import Rotation

from palpate.render.motions.explorations import control_points as module
from palpate.render.motions.explorations.control_points import (
    control_points,
    control_turns,
    exponential,
    from_axes,
    logarithm,
    power_of_e,
    product,
    stroke_draws,
)

CUBE = [[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]]
LARGE, POINT = [[-0.4, -0.3, 0.1], [0.4, 0.3, 0.9]], [[0.1, 0.1, 0.2], [0.1, 0.1, 0.2]]
LOW, THIN = [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]], [[-0.065, -0.01, 0.15], [0.065, 0.01, 0.25]]


def test_control_points_are_those_of_the_model_and_the_bits_of_each_made_alone():
    boxes, seeds, counts = [CUBE, LARGE, POINT, LOW, THIN], list(range(5)), [204, 1, 50, 400, 30]
    together = control_points(np.array(boxes), seeds, counts)
    for k, (box, seed, count) in enumerate(zip(boxes, seeds, counts, strict=True)):
        wanted = around_model.control_points(np.array(box), np.random.default_rng(seed), count)
        alone = control_points(np.array([box]), [seed], [count])
        own = slice(together.start[k], together.start[k] + len(wanted.position))
        assert count <= len(wanted.position) <= together.start[k + 1] - together.start[k]
        np.testing.assert_allclose(together.position[own], wanted.position, rtol=0, atol=1e-14)
        np.testing.assert_allclose(together.quaternion[own], wanted.quaternion, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(together.position[own], alone.position[: len(wanted.position)])
        np.testing.assert_array_equal(together.quaternion[own], alone.quaternion[: len(wanted.position)])


@pytest.mark.exhaustive
def test_control_points_are_those_of_the_model_for_half_an_hour():
    for k, box in enumerate([CUBE, LARGE, POINT, LOW, THIN]):
        made = control_points(np.array([box]), [k], [10_000])
        wanted = around_model.control_points(np.array(box), np.random.default_rng(k), 10_000)
        np.testing.assert_allclose(made.position[:10_000], wanted.position[:10_000], rtol=0, atol=1e-13)
        np.testing.assert_allclose(made.quaternion[:10_000], wanted.quaternion[:10_000], rtol=0, atol=1e-12)


def test_progress_is_reported_now_and_then(monkeypatch):
    monkeypatch.setattr(module, "STROKES_A_REPORT", 8)
    reports = []
    control_points(np.array([CUBE]), [3], [500], lambda *report: reports.append(report))
    done, total = np.array(reports).T
    assert len(reports) > 1
    assert (np.diff(done) > 0).all()
    assert (total == 500).all()


def test_draws_are_of_visits_from_eight_octants_in_a_row():
    draws, octants = stroke_draws(5), []
    next(draws)
    while len(octants) < 16:
        _, numbers = draws.send(3)
        if numbers[0] == 0:
            octants.append(numbers[1])
    assert sorted(octants[:8]) == sorted(octants[8:]) == list(range(8))


def test_rotations_are_those_of_scipy():
    turns = Rotation.random(200, random_state=2)
    q = turns.as_quat()
    np.testing.assert_allclose(product(q[:100], q[100:]), (turns[:100] * turns[100:]).as_quat(False), atol=1e-14)
    np.testing.assert_allclose(logarithm(q), turns.as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(logarithm(-q), turns.as_rotvec(), atol=1e-13)
    np.testing.assert_allclose(control_turns(q), (turns[:-1].inv() * turns[1:]).as_rotvec(), atol=1e-13)
    same = exponential(logarithm(q))
    np.testing.assert_allclose(np.abs((same * q).sum(axis=1)), 1.0, atol=1e-14)
    axes = turns.as_matrix().transpose(0, 2, 1)
    np.testing.assert_allclose(np.abs((from_axes(axes) * q).sum(axis=1)), 1.0, atol=1e-14)
    np.testing.assert_array_equal(exponential(np.zeros((1, 3))), [[0, 0, 0, 1]])


def test_powers_of_e():
    """Angles have tests beside those of the kernels, which have the same bits."""
    x = np.linspace(-10.0, 10.0, 1001)
    np.testing.assert_allclose(power_of_e(x), np.exp(x), rtol=5e-14)
    assert power_of_e(np.zeros(1)) == 1.0
