"""The samples of a cycle."""

import numpy as np
import pytest
import warp as wp

from palpate.kernels.patch import EXACT
from palpate.kernels.sampling.layout import SamplingPlan, samples_of
from palpate.render.sampling.plan import plan_of
from palpate.render.sampling.strategy import Order, Pace, SamplingStrategy

wp.set_module_options(EXACT)


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
