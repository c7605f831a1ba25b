"""Worker threads that render spans of poses and give chunks, which the consumer gets in pose order.

A Warp launch on a CPU uses one thread and releases the interpreter lock, so there is one worker per core. On a GPU two
workers take turns: one computes while the results of the other are downloaded.

| event                       | result                                                                        |
|-----------------------------|-------------------------------------------------------------------------------|
| a worker raises             | the consumer gets the chunks before it, then the exception; all are joined    |
| the consumer stops, raises  | current spans are finished and dropped, all threads are joined                |
| a span is too large         | the worker gives a chunk of its first poses; any worker takes the rest        |
"""

from __future__ import annotations

import heapq
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import warp as wp

from ..errors import StrategyError

POSES_FIRST = 2048  # in each of the first spans, whose contours show how large the next may be
POSES_FEWEST = 4096  # smaller spans are not made so that all workers end together
BEFORE_ALL = -1  # a pose before the first: an error stored there is raised next
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


class WorkerThreads:
    """Worker threads; at most twice as many chunks as workers are being rendered or wait for the consumer."""

    def __init__(self, spans: PoseSpans, works: Sequence[SpanRenderer]) -> None:
        self._spans = spans
        self._limit = 2 * len(works)
        self._changed = threading.Condition()
        self._at_work: set[int] = set()  # first poses
        self._waiting: dict[int, Rendered | BaseException] = {}
        self._stopped = False
        self._threads = [
            threading.Thread(target=self._run, args=(work,), name=f"palpate worker {k}", daemon=True)
            for k, work in enumerate(works)
        ]

    def chunks(self) -> Iterator[Rendered]:
        """All chunks in pose order; the threads end with this generator."""
        try:
            for thread in self._threads:
                thread.start()
            while (outcome := self._next()) is not None:
                if isinstance(outcome, BaseException):
                    raise outcome
                yield outcome
                del outcome  # otherwise its memory would be kept until the next chunk
        finally:
            self._dismiss()

    def _next(self) -> Rendered | BaseException | None:
        """Wait for the next chunk in pose order; None after the last."""
        with self._changed:
            self._changed.wait_for(lambda: self._earliest() is None or self._earliest() in self._waiting)
            earliest = self._earliest()
            if earliest is None:
                return None
            self._changed.notify_all()
            return self._waiting.pop(earliest)

    def _dismiss(self) -> None:
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        for thread in self._threads:
            if thread.ident is not None:
                thread.join()
        self._waiting.clear()

    def _run(self, work: SpanRenderer) -> None:
        while (span := self._take()) is not None:
            try:
                outcome = work(*span)
            except BaseException as error:  # any exception is passed to the consumer
                outcome = error
            self._hand_in(span, outcome)
            del outcome  # otherwise its memory would be kept until the next chunk

    def _take(self) -> tuple[int, int] | None:
        """Wait until there is room for another chunk, and take the next span; None when all are rendered."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_over() or self._may_take())
            if self._is_over():
                return None
            try:
                span = self._spans.take()
            except BaseException as error:  # otherwise the consumer would wait for ever
                self._waiting[BEFORE_ALL] = error
                self._changed.notify_all()
                return None
            self._at_work.add(span[0])
            return span

    def _hand_in(self, span: tuple[int, int], outcome: Rendered | BaseException) -> None:
        first, stop = span
        with self._changed:
            self._at_work.remove(first)
            self._waiting[first] = outcome
            try:
                if not isinstance(outcome, BaseException):
                    self._spans.give_back(outcome.stop, stop)
                    self._spans.learn(outcome.stop - first, outcome.point_count)
            except BaseException as error:  # the worker gave an object that is no chunk: passed to the consumer too
                self._waiting[first] = error
            finally:
                self._changed.notify_all()

    def _earliest(self) -> int | None:
        left = () if self._spans.first is None else (self._spans.first,)
        return min([*self._waiting, *self._at_work, *left], default=None)

    def _is_over(self) -> bool:
        return self._stopped or (self._spans.first is None and not self._at_work)

    def _may_take(self) -> bool:
        # Cannot deadlock: the consumer takes the earliest waiting chunk unless an earlier span is being rendered, and
        # that span ends without needing another place.
        return self._spans.first is not None and len(self._at_work) + len(self._waiting) < self._limit
