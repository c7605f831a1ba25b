"""Batches of poses: every pose once, in order, within the memory; what is loaded is kept within a limit."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from palpate.render.intersection.batch_rendering import CPU_SPAN_BYTES
from palpate.render.intersection.named_inputs import load_hand
from palpate.render.sweeps.make.batch import PoseRange, batch_capacity, poses_of, take_batch
from palpate.render.sweeps.make.rendering import CostCache
from palpate.render.sweeps.make.unit import CHUNK_POSES, SPAN


def test_a_batch_on_a_cpu_is_as_large_as_those_of_render():
    for hand in (None, "planes"):
        scene_bytes = 1024 * (1 if hand is None else load_hand(hand, None).patch_count)
        capacity = batch_capacity(scene_bytes, "cpu")
        assert capacity % SPAN == 0
        assert capacity * scene_bytes <= CPU_SPAN_BYTES


@given(
    counts=st.lists(st.integers(1, 12 * SPAN), min_size=1, max_size=6),
    spans=st.integers(1, 16),
    fits=st.lists(st.booleans(), max_size=30),
)
def test_batches_cover_every_pose_once_in_order_whatever_does_not_fit(counts, spans, fits):
    chunks = [SimpleNamespace(reached=0, stop=count) for count in counts]
    capacity = spans * SPAN
    while left := [own for own in chunks if own.reached < own.stop]:
        batch = take_batch(left, capacity)
        if not (fits.pop() if fits else True) and capacity > SPAN:
            capacity = capacity // 2 // SPAN * SPAN
            continue
        assert 0 < sum(own.count for own in batch) <= capacity
        assert [own.chunk for own in batch] == left[: len(batch)]
        for own in batch:
            assert own.chunk.reached == own.first
            assert own.stop % SPAN == 0 or own.stop == own.chunk.stop
            own.chunk.reached = own.stop


class Rows:
    """Poses whose numbers are all the same; it counts the calls that made them."""

    def __init__(self, value):
        self.value = value
        self.calls = []

    def rows(self, first, stop, device):
        self.calls.append((first, stop))
        return np.full((stop - first, 7), self.value, np.float32)


def test_poses_are_those_of_each_rendering_though_one_ends_where_the_next_begins():
    one, other = (SimpleNamespace(rendering=SimpleNamespace(poses=Rows(value))) for value in (1.0, 2.0))
    batch = [
        PoseRange(one, CHUNK_POSES - 2, CHUNK_POSES),
        PoseRange(one, CHUNK_POSES, CHUNK_POSES + 1),
        PoseRange(other, CHUNK_POSES + 1, CHUNK_POSES + 4),
    ]
    assert poses_of(batch, "cpu")[:, 0].tolist() == [1.0] * 3 + [2.0] * 3
    assert one.rendering.poses.calls == [(CHUNK_POSES - 2, CHUNK_POSES + 1)]


def test_what_is_kept_for_later_units_has_a_limit():
    kept, made_of = CostCache(10, len), []
    for text in ("aaaa", "bbbb", "a", "cccc", "b", "dddddddddddd", "d", "c"):
        kept.get(text[:1], lambda text=text: made_of.append(text) or text)
    assert made_of == ["aaaa", "bbbb", "cccc", "b", "dddddddddddd", "c"]
    asked = []
    other = CostCache(10**6, lambda value: asked.append(value) or 1)
    for k in range(100):
        other.get(str(k), lambda k=k: k)
    assert asked == list(range(100))  # the cost of a value is computed once
