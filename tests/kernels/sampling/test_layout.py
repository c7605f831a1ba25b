"""Sums in the order of NumPy's, and the samples of a cycle."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.patch import EXACT
from palpate.kernels.sampling.layout import SamplingPlan, distance, samples_of, squared, sum_of
from palpate.render.sampling.kernel_plan import plan_of
from palpate.render.sampling.strategy import Order, Pace, SamplingStrategy

wp.set_module_options(EXACT)


@wp.kernel
def _sum_all(
    # In:
    values: wp.array[wp.float64],
    # Out:
    total: wp.array[wp.float64],  # of the first i values
):
    """Sum values from the second on."""
    i = wp.tid()
    total[i] = sum_of(values, wp.int64(1), i)


@wp.kernel
def _measure_lengths(
    # In:
    points: wp.array[wp.vec3d],
    # Out:
    square: wp.array[wp.float64],
    norm: wp.array[wp.float64],
):
    """Measure points' distances from the origin."""
    i = wp.tid()
    square[i] = squared(points[i])
    norm[i] = distance(points[i], wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)))


@wp.kernel
def _count_samples(
    # In:
    plan: SamplingPlan,
    seconds: wp.array[wp.float64],
    # Out:
    count: wp.array[wp.int64],
):
    """Count the samples of cycles."""
    i = wp.tid()
    count[i] = samples_of(plan, seconds[i])


def test_sums_are_those_of_numpy_to_the_bit_whatever_their_number(rng, device):
    values = rng.random(1500)
    total = wp.empty(700, dtype=wp.float64, device=device)
    wp.launch(_sum_all, 700, inputs=[wp.array(values, device=device)], outputs=[total], device=device)
    assert (total.numpy() == [values[1 : 1 + i].sum() for i in range(700)]).all()


def test_lengths_are_those_of_numpy_to_the_bit(rng, device):
    points = rng.normal(size=(500, 3))
    square, norm = (wp.empty(500, dtype=wp.float64, device=device) for _ in range(2))
    inputs = [wp.array(points, dtype=wp.vec3d, device=device)]
    wp.launch(_measure_lengths, 500, inputs=inputs, outputs=[square, norm], device=device)
    assert (square.numpy() == np.einsum("ij,ij->i", points, points)).all()
    assert (norm.numpy() == np.linalg.norm(points, axis=1)).all()


@pytest.mark.parametrize(
    "strategy",
    [
        SamplingStrategy(),
        SamplingStrategy(pace=Pace("frequency", frequency=37.0)),
        SamplingStrategy(pace=Pace("capped")),
        SamplingStrategy(pace=Pace("still")),
        SamplingStrategy(pace=Pace(points=40), order=Order("step", 3)),
    ],
)
def test_a_cycle_has_the_samples_of_the_strategy(strategy, rng, device):
    seconds = np.concatenate([rng.uniform(0, 0.1, 200), np.arange(50) * 1e-4, np.arange(50) * 1e-4 + 1e-7])
    count = wp.empty(300, dtype=wp.int64, device=device)
    wp.launch(
        _count_samples,
        300,
        inputs=[plan_of(strategy), wp.array(seconds, device=device)],
        outputs=[count],
        device=device,
    )
    assert count.numpy().tolist() == [strategy.samples_of(float(s)) for s in seconds]
