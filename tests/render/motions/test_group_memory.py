"""What a group of motions takes: never more than is estimated, nor more than its budget."""

import gc

import numpy as np
import pytest
import warp as wp

from palpate.render import ExploredPoses, render_motions
from palpate.render.motions import groups as groups_module
from palpate.render.motions.groups import motion_bytes, sample_counts

DENSE = [("corner-pauses", "stm"), ("smooth", "dtp"), ("smooth", "pendulum"), ("smooth", "am-multi-focus")]
CASES = [("cc", "stm"), ("smooth", "stm"), *DENSE, ("depth-hatch", "stm"), ("inset-hatch", "stm"), ("cc", "dtp")]


class Taken:
    """Bytes of Warp's arrays on the CPU, which neither tracemalloc nor NumPy sees."""

    def __init__(self, monkeypatch):
        self.now = self.most = 0
        allocator = type(wp.get_device("cpu").get_allocator())
        take, give = allocator.allocate, allocator.deallocate

        def allocate(own, size, *rest):
            self.now += size
            self.most = max(self.most, self.now)
            return take(own, size, *rest)

        def deallocate(own, pointer, size, *rest):
            self.now -= size
            return give(own, pointer, size, *rest)

        monkeypatch.setattr(allocator, "allocate", allocate)
        monkeypatch.setattr(allocator, "deallocate", deallocate)

    def from_now_on(self):
        gc.collect()
        self.now = self.most = 0


@pytest.fixture
def taken(monkeypatch):
    return Taken(monkeypatch)


def trials(count):
    """Motions whose palm touches the tube most of the time."""
    return [ExploredPoses.of("tube", duration=5.0, explorer=person) for person in range(1, count + 1)]


def estimated(group):
    """Of all its motions, by the points that its contours have [byte]."""
    poses, counts = np.array([motion.count for motion in group.motions]), sample_counts(group.motions, group.sampling)
    has_pauses = group.contours.dwell is not None
    return motion_bytes(group.scene, poses, counts, group.sampling, group.points_a_pose, pauses=has_pauses).sum()


@pytest.mark.exhaustive
@pytest.mark.parametrize("hand", ["palm", "planes"])
@pytest.mark.parametrize(("strategy", "sampling"), CASES)
def test_arrays_take_what_is_estimated_or_less(taken, strategy, sampling, hand):
    list(render_motions("tube", hand, trials(1), strategy, sampling))  # the mesh, which is made once
    taken.from_now_on()
    (group,) = render_motions("tube", hand, trials(3), strategy, sampling, memory=10**9)
    assert len(group.numbers) == 3
    assert 0.25 * estimated(group) < taken.most < estimated(group)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("strategy", "sampling"), DENSE)
def test_groups_keep_to_their_budget_whatever_their_contours(taken, strategy, sampling):
    memory, sizes = 40_000_000, []
    list(render_motions("tube", "palm", trials(1), strategy, sampling))
    taken.from_now_on()
    for group in render_motions("tube", "palm", trials(10), strategy, sampling, memory=memory):
        assert len(group.numbers) == len(group.motions)
        sizes.append(len(group.motions))
        del group
    assert taken.most < memory
    assert max(sizes) > 1


def test_points_of_one_group_decide_the_size_of_the_next(monkeypatch):
    tried, real = [], groups_module.MotionGroup.__post_init__

    def seen(group):
        tried.append(len(group.motions))
        real(group)

    monkeypatch.setattr(groups_module.MotionGroup, "__post_init__", seen)
    parts = list(render_motions("tube", "palm", trials(12), "smooth", "stm", memory=32_000_000))
    assert sum(len(part.motions) for part in parts) == 12
    assert len(tried) < len(parts) + 3  # a few that did not fit, not one for each
