"""Workers: the same contours whoever makes them, in order, within bounds, and none left behind."""

import gc
import itertools
import os
import threading
import time
from dataclasses import dataclass

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import generic_poses

from palpate.datasets.contour_file.reader import ContourFile
from palpate.datasets.motions.hand_motion import HandMotion
from palpate.render import MeshObject, Palm, closed_contour, record, render
from palpate.render.contour_batch import join_batches
from palpate.render.errors import StrategyError
from palpate.render.intersection import batch_rendering as batch_module
from palpate.render.intersection.batch_rendering import rendered_chunks
from palpate.render.intersection.job import ContourJob
from palpate.render.intersection.scene import Scene
from palpate.render.runtime.span_workers import PoseSpans, chunks_in_order
from palpate.render.runtime.worker_devices import worker_devices

PALM = Palm()
TUBE = MeshObject.load("tube")


@pytest.fixture(autouse=True)
def no_thread_is_left():
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) == before


@pytest.fixture(scope="module")
def poses():
    return generic_poses(6000, 3, spread=0.08)


def assert_same(one, two):
    first, second = one.arrays(), two.arrays()
    assert first.keys() == second.keys()
    for name in first:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


@dataclass(frozen=True)
class Made:
    """A chunk without geometry."""

    first: int
    stop: int
    point_count: int = 0


def spans_of(ranges, *, size=10, workers=2):
    spans = PoseSpans(ranges, budget=10**6, pose_bytes=1000, point_bytes=1, worker_count=workers)
    spans._size = size
    spans.learn = lambda *_: None
    return spans


@settings(max_examples=20, deadline=None)
@given(
    ranges=st.lists(st.integers(0, 40), min_size=0, max_size=6).map(lambda steps: list(itertools.accumulate(steps))),
    size=st.integers(1, 12),
    workers=st.integers(1, 4),
    fits=st.integers(1, 12),
    delays=st.lists(st.sampled_from([0.0, 0.0005, 0.002]), min_size=1, max_size=7),
)
def test_chunks_cover_every_pose_in_order_within_bounds(ranges, size, workers, fits, delays):
    pairs = [(a, b) for a, b in itertools.pairwise(ranges) if a % 3 != 1]
    lock, alive, most = threading.Lock(), 0, 0
    delay = itertools.cycle(delays)

    def work(first, stop):
        nonlocal alive, most
        with lock:
            alive += 1
            most = max(most, alive)
            wait = next(delay)
        time.sleep(wait)
        return Made(first, min(stop, first + fits))

    covered = []
    for chunk in chunks_in_order(spans_of(pairs, size=size, workers=workers), [work] * workers):
        covered += range(chunk.first, chunk.stop)
        with lock:
            alive -= 1
    assert covered == [pose for a, b in pairs for pose in range(a, b)]
    assert most <= 2 * workers + 1  # one with the consumer


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_a_failure_comes_out_as_itself_after_all_chunks_before_it(workers):
    fault = RuntimeError("pose 57")
    done = []

    def work(first, stop):
        if first <= 57 < stop:
            raise fault
        time.sleep(0.001 if first % 20 else 0.01)
        return Made(first, stop)

    chunks = chunks_in_order(spans_of([(0, 1000)], workers=workers), [work] * workers)
    with pytest.raises(RuntimeError) as raised:
        done.extend((chunk.first, chunk.stop) for chunk in chunks)
    assert raised.value is fault
    assert done == [(first, first + 10) for first in range(0, 50, 10)]


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, GeneratorExit])
def test_a_consumer_that_stops_early_leaves_no_thread(interruption):
    chunks = chunks_in_order(spans_of([(0, 1000)]), [lambda a, b: Made(a, b)] * 2)
    next(chunks)
    if interruption is GeneratorExit:
        chunks.close()
    else:
        with pytest.raises(KeyboardInterrupt):
            chunks.throw(KeyboardInterrupt)


def test_spans_grow_to_the_budget_and_shrink_with_denser_poses():
    spans = PoseSpans([(0, 10**6)], budget=10**6, pose_bytes=100, point_bytes=10, worker_count=1)
    first, stop = spans.take()
    assert stop - first == 2048
    spans.learn(2048, 0)
    assert np.diff(spans.take()) == 8000  # 0.8 of the budget, 100 bytes a pose
    spans.learn(8000, 8000 * 72)
    assert np.diff(spans.take()) == 800


def test_workers_share_the_last_poses():
    spans = PoseSpans([(0, 100_000)], budget=10**9, pose_bytes=1, point_bytes=1, worker_count=4)
    spans.learn(10**6, 0)
    sizes = []
    while spans.first is not None:
        first, stop = spans.take()
        sizes.append(stop - first)
    assert sizes[0] == 25_000
    assert sizes == sorted(sizes, reverse=True)
    assert max(sizes[-4:]) <= 4096


@pytest.mark.exhaustive(after=1)
@pytest.mark.parametrize("workers", [1, 2, 3])
@pytest.mark.parametrize("memory", [2**20, 2**22, 2**28])
def test_workers_and_chunk_sizes_change_no_bit(device, poses, workers, memory):
    scene = Scene.of(TUBE, PALM, closed_contour())
    alone = list(rendered_chunks(ContourJob.of(scene, poses, device=device, memory=2**24)))
    chunks = list(rendered_chunks(ContourJob.of(scene, poses, devices=[device] * workers, memory=memory)))
    assert len(chunks) > 1
    assert [chunk.first for chunk in chunks[1:]] == [chunk.stop for chunk in chunks[:-1]]
    assert_same(join_batches([c.contours for c in alone]), join_batches([c.contours for c in chunks]))
    lengths, expected = (np.concatenate([chunk.lengths for chunk in made]) for made in (chunks, alone))
    np.testing.assert_array_equal(lengths, expected)


def test_a_pose_too_large_for_its_share_is_refused_with_the_memory_that_it_needs(device, monkeypatch):
    monkeypatch.setattr(batch_module, "POINT_BYTES", 10**6)  # as if points were that large
    pose = np.array([[0, 0, 0.2, 0, 0, 0, 1]], np.float32)
    with pytest.raises(StrategyError, match=r"pose 0 alone has (\d+) points.* raise the memory budget to") as refusal:
        render(TUBE, PALM, pose, closed_contour(), devices=[device] * 2, memory=2**20)
    needed = int(str(refusal.value).split()[-2])
    assert needed > 2**20
    assert render(TUBE, PALM, pose, closed_contour(), devices=[device] * 2, memory=needed).pose_count == 1


@pytest.mark.exhaustive
@pytest.mark.parametrize("workers", [1, 2])
def test_memory_of_chunks_under_way_stays_below_the_budget(workers, poses, monkeypatch):
    """Every array that Warp takes and gives back on the CPU is counted: the results of a chunk, and more."""
    allocator = wp.get_device("cpu").get_allocator()
    lock, held, most = threading.Lock(), 0, 0
    take, give = type(allocator).allocate, type(allocator).deallocate

    def counted_take(self, size, *rest):
        nonlocal held, most
        with lock:
            held += size
            most = max(most, held)
        return take(self, size, *rest)

    def counted_give(self, ptr, size, *rest):
        nonlocal held
        with lock:
            held -= size
        return give(self, ptr, size, *rest)

    for budget in (2**22, 2**24):
        scene = Scene.of(TUBE, PALM, closed_contour())
        list_of_chunks = rendered_chunks(
            ContourJob.of(scene, np.tile(poses, (10, 1)), devices=["cpu"] * workers, memory=budget)
        )
        with monkeypatch.context() as patch:
            patch.setattr(type(allocator), "allocate", counted_take)
            patch.setattr(type(allocator), "deallocate", counted_give)
            gc.collect()
            start = most = held
            largest = max(sum(array.nbytes for array in chunk.contours.arrays().values()) for chunk in list_of_chunks)
        assert largest < most - start < budget


@pytest.mark.exhaustive
def test_recording_that_fails_keeps_what_was_done_and_leaves_no_thread(tmp_path, poses, monkeypatch):
    motion, path = HandMotion(None, poses), tmp_path / "out.h5"
    real, calls = Scene.contours, []

    def failing(*arguments, **options):
        calls.append(None)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return real(*arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Scene, "contours", failing)
        with pytest.raises(KeyboardInterrupt):
            record(path, TUBE, PALM, motion, closed_contour(), devices=["cpu"] * 2, memory=2**22)
    with ContourFile(path) as file:
        done = file.done
    assert len(done) == 1
    assert 0 < done[0][1] < len(poses)
    resumed = record(path, TUBE, PALM, motion, closed_contour(), mode="resume", devices=["cpu"] * 2, memory=2**22)
    assert resumed.rendered == len(poses) - done[0][1]
    with ContourFile(path) as file:
        want = render(TUBE, PALM, poses, closed_contour()).arrays()
        for name, array in file.contours().items():
            np.testing.assert_array_equal(array, want[name], err_msg=name)


def test_devices_by_the_command_lines_words(monkeypatch):
    assert worker_devices("cpu", 3) == ["cpu"] * 3
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 5})
    assert worker_devices("cpu") == ["cpu"] * 3
    if not wp.get_cuda_devices():
        assert worker_devices("auto", 1) == ["cpu"]
        for name in ("cuda", "cuda:0", "cpu,cuda:1"):
            with pytest.raises(StrategyError, match=r"no device 'cuda.*there is: cpu"):
                worker_devices(name)
    else:
        assert worker_devices("auto") == ["cuda:0"] * 2
        assert len(worker_devices("cuda")) == 2 * len(wp.get_cuda_devices())
    with pytest.raises(StrategyError, match="workers must be at least 1, not 0"):
        worker_devices("cpu", 0)
    with pytest.raises(StrategyError, match="names one device twice"):
        worker_devices("cpu,cpu")
    with pytest.raises(StrategyError, match="name one device at least"):
        render(TUBE, PALM, np.array([[0, 0, 0.2, 0, 0, 0, 1]]), closed_contour(), devices=[])
