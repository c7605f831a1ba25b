"""Hops: steps over twice the ordinary one that are no jumps, by cause, against geometry and a count of the steps."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle, still

from palpate.datasets import exploration
from palpate.render import MeshObject, Palm, closed_contour, render
from palpate.render.sampling import (
    Gap,
    LateralModulation,
    Order,
    Pace,
    Path,
    Sampler,
    SamplingStrategy,
    preset,
    sample_contours,
)

STEP = 7.0 / 10_000  # [m] the ordinary one
NONE = {"polyline": 0, "order": 0, "pose": 0, "re-entry": 0}


def counted(poses, strategy=None, samples=111):
    sampler = Sampler(strategy or SamplingStrategy())
    batch = batch_of(poses)
    for k in range(len(poses)):
        sampler.draw(Path.of(batch, k), still(1)[0], samples)
    return sampler.count


@pytest.mark.parametrize(("rise", "hops", "jumps"), [(1.1e-3, 0, 0), (1.4e-3, 39, 0), (4.8e-3, 39, 0), (5.1e-3, 0, 39)])
def test_a_ring_that_rises_at_each_pose_makes_the_step_of_pythagoras(rise, hops, jumps):
    """One step along the ring, of 270 a cycle, and `rise` upwards; 40 poses."""
    poses = [[(circle(0.03, (0, 0, 0.2 + rise * k), 720), True)] for k in range(40)]
    count = counted(poses)
    assert count.hops == NONE | {"pose": hops}
    assert count.jumps == NONE | {"pose": jumps}
    along = 2 * np.pi * 0.03 / 270
    assert count.hop_longest == pytest.approx(np.hypot(along, rise) if hops else 0.0, rel=1e-4)


@pytest.mark.parametrize(("gap", "hops"), [(0.5e-3, 0), (0.69e-3, 0), (0.71e-3, 1), (2e-3, 1), (4.29e-3, 1)])
def test_a_short_gap_between_two_lines_is_a_hop_of_its_own_cause(gap, hops):
    """Two lines of 20 steps, one behind the other; drawn once, and not back from the end."""
    reach = 20 * STEP
    lines = [([[0, 0, 0.2], [reach, 0, 0.2]], False), ([[reach + gap, 0, 0.2], [2 * reach + gap, 0, 0.2]], False)]
    strategy = SamplingStrategy(order=Order(route="given"))
    count = counted([lines], strategy, samples=40)
    assert count.hops == NONE | {"polyline": hops}
    assert count.hop_longest == pytest.approx(STEP + gap if hops else 0.0, abs=1e-7)
    shown = counted([lines] * 40, strategy, samples=1)  # a pose for each sample: the way is still between polylines
    assert shown.hops == count.hops


def test_a_return_after_a_silence_a_little_beside_is_a_hop_of_that_cause():
    rings = [[(circle(0.03, (0, 0, z), 720), True)] for z in (0.2, 0.203)]
    count = counted([rings[0], [], rings[1]])
    assert count.hops == NONE | {"re-entry": 1}
    assert count.hop_longest == pytest.approx(3e-3, abs=1e-6)


@pytest.mark.parametrize("name", ["constant-frequency", "capped", "dtp", "stp", "lm", "pressure", "fast-return", "stm"])
def test_the_ordinary_step_is_that_of_the_strategy(name):
    """A ring that stays has no hop, however fast its strategy draws it: 0.6 m at 70 Hz are 42 m/s."""
    assert counted([[(circle(0.1, count=720), True)]], preset(name), samples=9000).hops == NONE


def test_a_fast_return_and_a_small_circle_are_ordinary_steps():
    line = [([[0, 0, 0.2], [0.07, 0, 0.2]], False)]
    back = SamplingStrategy(gap=Gap(kind="return", speed=60.0))
    assert counted([line], back, samples=5000).hops == NONE
    assert counted([line], SamplingStrategy(gap=Gap(kind="pendulum")), samples=5000).hops == NONE
    fast = SamplingStrategy(lm=LateralModulation(radius=0.003, frequency=1000.0))  # 19 m/s along the circle
    assert counted([[(circle(0.05, count=720), True)]], fast, samples=5000).hops == NONE


def test_held_points_hop_from_one_to_the_next_by_the_order():
    """40 points on a ring of 80 mm: 2 mm apart, each held for 25 samples of 1000 a cycle."""
    ring = [(circle(0.08 / (2 * np.pi), count=720), True)]
    strategy = SamplingStrategy(pace=Pace(kind="frequency", frequency=10.0, points=40))
    count = counted([ring], strategy, samples=1000)
    assert count.hops == NONE | {"order": 39}
    assert count.hop_longest == pytest.approx(2e-3, rel=2e-3)


@pytest.mark.parametrize("update_rate", [10_000.0, 40_000.0])
def test_hops_and_jumps_of_an_exploration_are_the_steps_that_are_too_long(update_rate):
    """A recount from the focal points alone: all steps between two that are not silent."""
    tube = MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=5.0, rate=90.0, seed=1)
    batch = render(tube, Palm(), motion, closed_contour())
    sampler = Sampler(SamplingStrategy(update_rate=update_rate))
    blocks = list(sample_contours([batch], motion.pose, motion.time, 5.0, sampler))
    position = np.concatenate([block.position for block in blocks]).astype(float)
    drawn = np.concatenate([block.intensity for block in blocks]) > 0
    step = np.linalg.norm(np.diff(position, axis=0), axis=1)
    both = drawn[1:] & drawn[:-1]
    limit = 2 * 7.0 / update_rate
    hops = both & (step > limit) & (step <= 5e-3)
    count = sampler.count
    assert sum(count.hops.values()) - count.hops["re-entry"] == np.count_nonzero(hops) > 50
    assert sum(count.jumps.values()) - count.jumps["re-entry"] == np.count_nonzero(both & (step > 5e-3)) > 5
    assert count.hop_longest == pytest.approx(step[hops].max(), abs=1e-7)
    first = np.ceil(motion.time * update_rate - 1e-6).astype(int)
    assert count.hops["pose"] >= 0.99 * np.count_nonzero(hops[first[1:] - 1])  # nearly all are at new poses
