"""Control points of many explorations: the bits of each as it was first written, whatever is made with it."""

import around_oracle
import numpy as np

from palpate.datasets.motions import exploration_strokes
from palpate.datasets.motions.exploration import exploration_path
from palpate.datasets.motions.exploration_draws import stroke_draws
from palpate.datasets.motions.exploration_strokes import control_points

CUBE = [[-0.065, -0.065, 0.135], [0.065, 0.065, 0.265]]
LARGE, POINT = [[-0.4, -0.3, 0.1], [0.4, 0.3, 0.9]], [[0.1, 0.1, 0.2], [0.1, 0.1, 0.2]]
LOW, THIN = [[-0.1, -0.1, 0.0], [0.1, 0.1, 0.03]], [[-0.065, -0.01, 0.15], [0.065, 0.01, 0.25]]


def alone(box, seed, count):
    rng = np.random.default_rng(seed)
    return around_oracle._control_points(around_oracle._space(np.array(box)), rng, count, around_oracle.unheard)


def test_control_points_have_the_bits_of_each_stroke_made_alone():
    boxes, seeds, counts = [CUBE, LARGE, POINT, LOW, THIN] * 2, list(range(10)), [204, 1, 50, 700, 30] * 2
    made = control_points(np.array(boxes), seeds, counts)
    for k, own in enumerate(zip(boxes, seeds, counts, strict=True)):
        wanted = alone(*own)
        rows = slice(made.start[k], made.start[k] + len(wanted.position))
        assert counts[k] <= len(wanted.position) <= made.start[k + 1] - made.start[k]
        np.testing.assert_array_equal(made.position[rows], wanted.position)
        np.testing.assert_array_equal(made.quaternion[rows], wanted.quaternion)


def test_poses_have_the_bits_of_the_model_as_it_was_first_written():
    for box, seed, rate in ((CUBE, 7, 90.0), (THIN, 8, 77.7), (POINT, 9, 10.0), (CUBE, 10, 1000.0)):
        time = np.arange(1500) / rate
        wanted = around_oracle.exploration_path(np.array(box), time, seed)
        np.testing.assert_array_equal(exploration_path(np.array(box), time, seed), wanted)


def test_progress_is_told_now_and_then(monkeypatch):
    monkeypatch.setattr(exploration_strokes, "_STROKES_TOLD", 8)
    told = []
    control_points(np.array([CUBE]), [3], [500], lambda done, total: told.append((done, total)))
    done, total = np.array(told).T
    assert len(told) > 1
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
