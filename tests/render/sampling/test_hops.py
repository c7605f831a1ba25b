"""Hops: steps over twice the ordinary one that are no jumps, by cause, against geometry and a count of the steps."""

import numpy as np
import pytest
from contour_shapes import batch_of, circle, still

from palpate.render import IntersectionStrategy, MeshObject, Palm, Stage, closed_contour, exploration, render
from palpate.render.sampling.presets import preset
from palpate.render.sampling.sampler import Sampler, joined, sample_contours
from palpate.render.sampling.strategy import Gap, LateralModulation, Order, Pace, SamplingStrategy

STEP = 7.0 / 10_000  # [m] the ordinary one
NONE = {"polyline": 0, "order": 0, "pose": 0, "re-entry": 0}


def counted(poses, strategy=None, samples=111):
    sampler = Sampler(strategy or SamplingStrategy())
    batch = batch_of(poses)
    for k in range(len(poses)):
        sampler.draw(batch[k : k + 1], still(1)[0], samples)
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
    assert count.hops_longest["re-entry"] == pytest.approx(3e-3, abs=1e-6)
    assert count.hop_longest == 0.0  # it follows a silence


@pytest.mark.parametrize("silent", [False, True])
def test_the_longest_hop_is_kept_by_cause(silent):
    """Two lines in a row, 1.3 mm apart, that rise by 2 mm in mid line; after a silence they are 4 mm higher."""
    reach = 20 * STEP

    def lines(z):
        first = ([[0, 0, z], [reach, 0, z]], False)
        return [first, ([[reach + 1.3e-3, 0, z], [2 * reach + 1.3e-3, 0, z]], False)]

    sampler, pose = Sampler(SamplingStrategy(order=Order(route="given"))), still(1)[0]
    for z, samples in ((0.2, 10), (0.202, 25)):
        sampler.draw(batch_of([lines(z)]), pose, samples)
    if silent:
        sampler.draw(None, pose, 5)
        sampler.draw(batch_of([lines(0.206)]), pose, 2)
    longest = sampler.count.hops_longest
    assert longest["pose"] == pytest.approx(np.hypot(2e-3, STEP), rel=1e-4)
    assert longest["polyline"] == pytest.approx(STEP + 1.3e-3, rel=1e-4)
    assert longest["re-entry"] == pytest.approx(4e-3 if silent else 0.0, rel=1e-4)
    assert longest["order"] == 0.0
    assert sampler.count.hop_longest == longest["pose"]


def test_on_one_contour_every_focal_point_hops_by_the_pose():
    """A ring that grows by up to 4 mm where the second of two focal points is: there is no way between polylines."""
    angle = 2 * np.pi * np.arange(360) / 360
    ring = np.stack([0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.2 + 0 * angle], axis=1)
    grown = ring - np.stack([0.002 * (1 - np.cos(angle)), 0 * angle, 0 * angle], axis=1)
    rings = [batch_of([[(points, True)]]) for points in (ring, grown)]
    sampler, pose = Sampler(SamplingStrategy(foci=2)), still(1)[0]
    sampler.draw(rings[0], pose, 1)
    for k in range(40):
        sampler.draw(rings[(k + 1) % 2], pose, 270 if k % 2 else 268)
    assert sampler.count.hops == NONE | {"pose": sampler.count.hops["pose"]}
    assert sampler.count.hops["pose"] >= 39


def test_the_ordinary_step_is_that_of_the_strategy():
    """A ring that stays has no hop, however fast its strategy draws it: 0.6 m at 70 Hz are 42 m/s."""
    for name in ("constant-frequency", "capped", "dtp", "stp", "lm", "fast-return"):
        assert counted([[(circle(0.1, count=720), True)]], preset(name), samples=3000).hops == NONE, name


@pytest.mark.parametrize("kind", ["frequency", "capped"])
def test_steps_on_new_contours_are_judged_by_those_of_these_contours(kind):
    """A ring of 188 mm in place of one of 25 mm and back, at 20 Hz: steps of 0.38 and 0.05 mm, and no hop."""
    rings = [[(circle(radius, (0, 0, 0.2), 360), True)] for radius in (0.03, 0.004)]
    pace = Pace(kind=kind, frequency=20.0) if kind == "frequency" else Pace(kind=kind, lowest=19.5, highest=20.5)
    count = counted(rings * 10, SamplingStrategy(pace=pace))
    assert count.hops == NONE
    assert count.jumps == NONE | {"pose": 19}


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


@pytest.mark.exhaustive
@pytest.mark.parametrize("span", [70, 1 << 16])
@pytest.mark.parametrize("name", ["stm", "step", "random"])
def test_re_entries_to_contours_with_dark_hand_edges_are_the_steps_from_dark_to_bright(name, span, monkeypatch):
    """A recount from the focal points alone: all steps to one that is drawn from one that is silent."""
    motion = exploration("tube", duration=4.0, rate=90.0, seed=1)
    dark = IntersectionStrategy(prune=("outside",), transform=("close", Stage("edges", {"on_hand": 0.0})))
    monkeypatch.setattr("palpate.render.sampling.sampler.SPAN_SAMPLES", span)
    sampler = Sampler(preset(name))
    blocks = sample_contours([render("tube", "palm", motion, dark)], motion.pose, motion.time, 4.0, sampler)
    focus = joined(list(blocks))
    drawn = focus.intensity > 0
    first = np.flatnonzero((focus.position != np.float32([0, 0, 0.2])).any(axis=1))[0]  # before it nothing is there
    step = np.linalg.norm(np.diff(focus.position.astype(float), axis=0), axis=1)[first:]
    step = step[drawn[first + 1 :] & ~drawn[first:-1]]
    assert sampler.count.hops["re-entry"] == np.count_nonzero((step > 2 * STEP) & (step <= 5e-3)) > 1
    assert sampler.count.jumps["re-entry"] == np.count_nonzero(step > 5e-3) > 0


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("update_rate", [10_000.0, 40_000.0])
def test_hops_and_jumps_of_an_exploration_are_the_steps_that_are_too_long(update_rate):
    """A recount from the focal points alone: all steps between two that are not silent."""
    tube = MeshObject.load("tube")
    motion = exploration(tube.bounds, duration=5.0, rate=90.0, seed=1, model="around")
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
