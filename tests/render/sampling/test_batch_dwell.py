"""Dwell maps of many motions are those of each motion's focal points."""

import numpy as np
import pytest

from palpate.render import MeshObject, Palm, Scene, exploration
from palpate.render.sampling.batch_dwell import dwell_maps
from palpate.render.sampling.metrics import dwell_map
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import sample_bounds, sample_motions
from palpate.render.sampling.strategy import SamplingStrategy


@pytest.mark.parametrize("strategy", [SamplingStrategy(), preset("multi-focus")], ids=["stm", "multi-focus"])
def test_each_cell_has_the_time_that_its_focal_points_give_it(strategy, device):
    motions = [exploration("tube", duration=2.0, rate=90.0, seed=seed) for seed in range(2)]
    pose, time = (np.concatenate([getattr(motion, name) for motion in motions]) for name in ("pose", "time"))
    batch = Scene.of(MeshObject.load("tube"), Palm(), "cc").contours(pose, 0, device)[0]
    start = np.cumsum([0, *map(len, motions)])
    samples = sample_motions(batch, pose, time, start, [2.0, 2.0], strategy)
    grid = {"width": 0.08, "length": 0.06, "cell": 2e-3}
    for k, found in enumerate(dwell_maps(samples, strategy.update_rate, **grid)):
        bounds = sample_bounds(motions[k].time, 2.0, strategy.update_rate)
        single = dwell_map([samples.focus(k)], motions[k].pose, bounds, strategy.update_rate, **grid)
        assert (found.time == single.time).all()
        assert single.time.any()
        assert found.area == single.area
        assert (found.spread, found.outside, found.silent) == (single.spread, single.outside, single.silent)
        assert single.outside > 0
