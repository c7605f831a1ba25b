"""Draw frequencies of many poses at once are those of the cycles that the sampler in NumPy lays, by strategy."""

import numpy as np
import pytest
import warp as wp
from mesh_cases import bodies, generic_poses, shell
from numpy_sampler.cycle import lay_cycle
from numpy_sampler.path import paths_of

from palpate.kernels.metrics.tally import METRICS, tally_contours
from palpate.render import MeshObject, Palm, SamplingStrategy, closed_contour, load_strategy, open_contour
from palpate.render.intersection.scene import Scene
from palpate.render.sampling.presets import PRESETS
from palpate.render.sampling.sampler import laid_cycles
from palpate.render.sampling.strategy import Dwell, Gap, Order, Pace
from palpate.render.sweeps.make import frequency as frequency_module
from palpate.render.sweeps.make.frequency import Pacer

THERE_AND_BACK = Order(kind="pendulum")
STRATEGIES = {name: make() for name, make in PRESETS.items()} | {
    "slow": SamplingStrategy(speed=0.9, update_rate=3_000),
    "there and back": SamplingStrategy(order=THERE_AND_BACK),
    "there and back twice": SamplingStrategy(order=THERE_AND_BACK, gap=Gap(kind="pendulum")),
    "closed": SamplingStrategy(gap=Gap(kind="close")),
    "closed, there and back": SamplingStrategy(gap=Gap(kind="close"), order=THERE_AND_BACK),
    "returns within": SamplingStrategy(gap=Gap(kind="return", speed=3.0), order=THERE_AND_BACK),
    "narrow": SamplingStrategy(speed=7.0, pace=Pace(kind="capped", lowest=30.0, highest=37.0)),
    "narrow, closed": SamplingStrategy(pace=Pace(kind="capped", lowest=30.0, highest=37.0), gap=Gap(kind="close")),
    "many points": SamplingStrategy(pace=Pace(points=700), order=Order(kind="random")),
    "many points held": SamplingStrategy(pace=Pace(points=700)),
    "pauses": SamplingStrategy(dwell=Dwell(time=2e-3)),
    "share of pauses": SamplingStrategy(dwell=Dwell(share=0.4), gap=Gap(kind="return")),
    "given": SamplingStrategy(order=Order(route="given"), foci=3, update_rate=40_000),
}


def batch_of(solid, strategy, poses, device):
    return Scene.of(solid, Palm(), strategy).contours(poses, 0, device)[0].to(device)


def pacer_of(batch, device):
    value = wp.empty((len(METRICS), batch.pose_count), dtype=wp.float32, device=device)
    length = wp.empty(batch.pose_count, dtype=wp.float64, device=device)
    tally_contours(batch.struct, value, length, measures=True, encloses=False)
    return Pacer(batch, length)


def wanted(batch, strategy):
    """By the cycles of every pose."""
    nominal, actual = [], []
    still = strategy.pace.kind == "still"
    for path in paths_of(batch.numpy()):
        nominal.append(np.nan if path is None else strategy.draw_frequency(path.length))
        count = np.nan if path is None else lay_cycle(path, strategy).sample_count
        actual.append(0.0 * count if still else strategy.update_rate / count)
    return np.array(nominal), np.array(actual, np.float32)


def assert_as_sampled(batch, strategy, device):
    nominal, actual = pacer_of(batch, device).frequencies(strategy).numpy()
    want_nominal, want_actual = wanted(batch, strategy)
    np.testing.assert_array_equal(actual, want_actual)
    np.testing.assert_allclose(nominal, want_nominal, rtol=2e-7)
    return actual


@pytest.fixture(scope="module")
def poses():
    poses = generic_poses(40, 7)
    poses[::9, :3] += 1.0  # nothing there
    return poses


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", STRATEGIES)
def test_draw_frequencies_are_those_of_the_cycles(name, poses, device):
    for solid, strategy in ((MeshObject.load("tube"), closed_contour()), (MeshObject(*bodies()), open_contour())):
        actual = assert_as_sampled(batch_of(solid, strategy, poses, device), STRATEGIES[name], device)
        assert np.isnan(actual).any()
        assert np.isfinite(actual).any()


@pytest.mark.parametrize("name", ["fast-return", "constant-frequency", "am"])
def test_pauses_of_the_contours_count(name, poses, device):
    paused = load_strategy("corner-pauses")
    batch = batch_of(MeshObject.load("cube"), paused, poses[:15], device)
    assert batch.dwell is not None
    assert_as_sampled(batch, STRATEGIES[name], device)


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("name", STRATEGIES)
def test_cycles_are_laid_only_where_nothing_else_tells(name, poses, device, monkeypatch):
    laid = []

    def counted(batch, strategy):
        laid.append(len(batch))
        return laid_cycles(batch, strategy)

    monkeypatch.setattr(frequency_module, "laid_cycles", counted)
    batch = batch_of(MeshObject(*shell()), open_contour(), poses, device)
    pacer_of(batch, device).frequencies(STRATEGIES[name])
    needed = name in ("fast-return", "returns within", "pauses", "share of pauses")
    assert laid == ([len(batch)] if needed else [])
