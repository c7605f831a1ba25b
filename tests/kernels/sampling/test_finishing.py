"""A polyline under way is finished before others are entered, and then drawing goes on as the host's sampler does."""

import numpy as np
import pytest
import warp as wp
from contour_random import random_strokes
from contour_shapes import batch_of, circle, still
from sampling_oracle import entered_by_host

from palpate.kernels.sampling.finishing import finish_pieces
from palpate.render.sampling.kernel_plan import plan_of
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import MotionSchedule, sample_motions
from palpate.render.sampling.strategy import Gap, SamplingStrategy, Sections

STRATEGIES = {
    "stm": SamplingStrategy(continuity="finish"),
    "slow": SamplingStrategy(speed=0.5, continuity="finish"),
    "return": SamplingStrategy(continuity="finish", gap=Gap("return")),
    "sections": preset("stp", continuity="finish", sections=Sections(3, 20.0)),
}


@pytest.mark.parametrize("name", STRATEGIES)
def test_contours_are_entered_when_and_where_the_host_enters_them(name, device, monkeypatch):
    strategy, time, duration = STRATEGIES[name], np.arange(40) / 90, 40 / 90
    schedule = MotionSchedule.of(time, [0, 40], [duration], strategy, None)
    pose = wp.array(still(40), dtype=wp.transformd, device=device)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        batch = random_strokes(rng, 40, line_most=int(rng.integers(1, 8)))
        drawn = finish_pieces(batch.to(device).as_struct(), plan_of(strategy), schedule.on(device, strategy), pose)
        entries = drawn.entries.numpy()
        with monkeypatch.context() as there:
            expected = entered_by_host(batch, time, duration, strategy, there)
        entered = np.flatnonzero((entries["drawn"] == 1) & (entries["start"] < schedule.count))
        assert len(entered) == len(expected) > 1
        samples = schedule.row[entered] + entries["start"][entered]
        got = zip(samples.tolist(), entries["anchor"][entered], entries["index"][entered], strict=True)
        assert list(got) == [(sample, knot, index) for _, knot, index, sample in expected]


def test_a_circle_is_drawn_to_its_end_although_others_have_replaced_it(device):
    ring = circle(0.7 / (2 * np.pi), count=720)  # 0.7 m take 0.1 s at 7 m/s
    far = [(circle(0.02) + np.array([x, 0.3, 0.0]), True) for x in (0.0, 0.05)]
    batch = batch_of([[(ring, True)], *[far] * 11])
    rows = np.arange(12) / 90, [0, 12], [12 / 90], SamplingStrategy(continuity="finish")
    samples = sample_motions(batch, still(12), *rows, device=device)
    on_ring = samples.focus(0).position[:, 1] < 0.2
    assert np.flatnonzero(~on_ring)[0] == on_ring.sum() == 1000
