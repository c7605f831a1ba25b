"""Worker threads that render spans of poses and give chunks, which the consumer gets in pose order.

A Warp launch on a CPU uses one thread and releases the interpreter lock, so there is one worker per core. On a GPU two
workers take turns: one computes while the results of the other are downloaded.

| event                       | result                                                                        |
|-----------------------------|-------------------------------------------------------------------------------|
| a worker raises             | the consumer gets the chunks before it, then the exception; all are joined    |
| the consumer stops, raises  | current spans are finished and dropped, all threads are joined                |
| a span is too large         | the worker returns a chunk of its first poses; any worker renders the rest    |
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Protocol

import warp as wp

from ..errors import StrategyError

POSES_FIRST = 2048  # in each of the first spans, whose contours show how large the next may be
POSES_FEWEST = 4096  # smaller spans are not made so that all workers end together
GROWTH = 4  # largest ratio of a span to the one before, as later poses may have more points


class Rendered(Protocol):
    """Result of a worker."""

    @property
    def stop(self) -> int:
        """The pose after its last; may be below the requested end."""
        ...

    @property
    def point_count(self) -> int:
        """Number of points of its contours."""
        ...


SpanRenderer = Callable[[int, int], Rendered]
"""Renders poses first..stop, or as many from the first as fit the memory."""


def warp_device(name: str) -> str:
    """Full name of a Warp device.

    Raises StrategyError, listing the devices, for one that this machine lacks.
    """
    name, known = name.lower(), [str(device) for device in wp.get_devices()]
    if name not in known and not (name == "cuda" and "cuda:0" in known):
        raise StrategyError(
            f"no device {name!r} on this machine; there is: {', '.join(known)} (GPUs are cuda:0, cuda:1, ...)"
        )
    return str(wp.get_device(name))


class PoseSpans:
    """Queue of the poses that are not rendered yet, taken as spans in pose order, as large as the budget allows.

    budget: for the working arrays of one span [byte]; pose_bytes, point_bytes: their size for each pose and point;
    worker_count: number of workers, among which the last poses are divided.
    """

    def __init__(
        self,
        ranges: Sequence[tuple[int, int]],
        *,
        budget: int,
        pose_bytes: int,
        point_bytes: int,
        worker_count: int,
    ) -> None:
        self._left = [(first, stop) for first, stop in ranges if first < stop]
        heapq.heapify(self._left)
        self._pose_count = sum(stop - first for first, stop in self._left)
        self._budget, self._pose_bytes, self._point_bytes = budget, pose_bytes, point_bytes
        self._worker_count = worker_count
        self._size = max(1, min(POSES_FIRST, budget // (4 * pose_bytes)))

    @property
    def first(self) -> int | None:
        """First pose of the next span; None if nothing is left."""
        return self._left[0][0] if self._left else None

    def take(self) -> tuple[int, int]:
        """The next span, (first, stop)."""
        first, end = heapq.heappop(self._left)
        share = max(POSES_FEWEST, -(-self._pose_count // self._worker_count))
        stop = min(end, first + min(self._size, share))
        if stop < end:
            heapq.heappush(self._left, (stop, end))
        self._pose_count -= stop - first
        return first, stop

    def give_back(self, first: int, stop: int) -> None:
        """Return poses first..stop of a span that did not fit the memory."""
        if first < stop:
            heapq.heappush(self._left, (first, stop))
            self._pose_count += stop - first

    def learn(self, pose_count: int, point_count: int) -> None:
        """Set the size of the next spans from the points of one, with a quarter in reserve for denser poses."""
        needed = self._pose_bytes + 1.25 * self._point_bytes * point_count / pose_count
        self._size = max(1, min(int(0.8 * self._budget / needed), GROWTH * pose_count))


def chunks_in_order(spans: PoseSpans, renderers: Sequence[SpanRenderer]) -> Generator[Rendered, None, None]:
    """Yield all chunks in pose order, each rendered by one of the renderers, which has a thread of its own.

    At most twice as many chunks as renderers are under way or wait for the consumer, besides the one that it has. The
    threads end with this generator.
    """
    thread = threading.local()
    unassigned = list(renderers)

    def assign() -> None:
        thread.renderer = unassigned.pop()

    def render(first: int, stop: int) -> Rendered:
        return thread.renderer(first, stop)

    pool = ThreadPoolExecutor(len(renderers), "palpate worker", initializer=assign)
    under_way: list[tuple[int, int, Future[Rendered]]] = []  # a heap by first pose, which no two share

    def submit() -> None:
        while spans.first is not None and len(under_way) < 2 * len(renderers):
            first, stop = spans.take()
            heapq.heappush(under_way, (first, stop, pool.submit(render, first, stop)))

    def earliest() -> Rendered:
        first, stop, future = heapq.heappop(under_way)
        chunk = future.result()
        spans.give_back(chunk.stop, stop)
        spans.learn(chunk.stop - first, chunk.point_count)
        submit()
        return chunk

    try:
        submit()
        while under_way:
            yield earliest()  # without a name here, which would keep its memory until the next chunk
    finally:
        pool.shutdown(cancel_futures=True)
