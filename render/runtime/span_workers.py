"""Workers: threads that take spans of poses, and hand in chunks that come out in pose order.

A Warp launch on a CPU is one thread, and releases the interpreter: workers on one CPU are its cores. On a GPU two
workers take turns, one computing while the results of the other come down.

| what happens                | what comes of it                                                              |
|-----------------------------|-------------------------------------------------------------------------------|
| a worker raises             | chunks before it come out, then its exception, as itself; then all are joined |
| the consumer stops, is hit  | spans under way are finished and dropped, all are joined                      |
| a span is too large         | the worker hands in its beginning, anyone takes the rest                      |
"""

from __future__ import annotations

import heapq
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

import warp as wp

from ..errors import StrategyError

WORKERS_MOST = 256  # on one device; more than any machine has cores for is a slip of the finger
GPU_WORKERS = 2  # one computes while the other's results come down
POSES_FIRST = 2048  # of the first spans, which tell how large the others may be
POSES_FEWEST = 4096  # that a span is divided for, so that all workers end together
BEFORE_ALL = -1  # a pose before the first: what waits there comes out next
GROWTH = 4  # of a span over the last one at most: its poses may be denser


class Rendered(Protocol):
    """What workers hand in."""

    @property
    def stop(self) -> int:
        """The pose after its last; may be less than was asked for."""
        ...

    @property
    def point_count(self) -> int:
        """Points of its contours."""
        ...


Work = Callable[[int, int], Rendered]
"""Renders poses first..stop, or the beginning of them that fits the memory."""


def warp_device(name: str) -> str:
    """The Warp device of that name.

    Raises StrategyError, listing what there is, for one that this machine lacks.
    """
    known = [str(device) for device in wp.get_devices()]
    if name not in known and not (name == "cuda" and "cuda:0" in known):
        raise StrategyError(f"no device {name!r} on this machine; there is: {', '.join(known)}")
    return str(wp.get_device(name))


def worker_devices(device: str, workers: int | None = None) -> list[str]:
    """The device of each worker, for the command line's words.

    device: "cpu", "cuda:0", several with commas between them, "cuda" (all GPUs), "auto" (the first GPU, else the CPU).
    workers: on each device; None is one for each core on the CPU, and two on a GPU.
    Raises StrategyError for a device that this machine lacks, one named twice, no workers, or more than WORKERS_MOST.
    """
    if workers is not None and workers < 1:
        raise StrategyError(f"workers must be at least 1, not {workers}")
    if workers is not None and workers > WORKERS_MOST:
        raise StrategyError(f"workers must be at most {WORKERS_MOST} on each device, not {workers}")
    gpus = [str(gpu) for gpu in wp.get_cuda_devices()]
    names = {"auto": gpus[:1] or ["cpu"], "cuda": gpus or ["cuda"]}.get(device) or device.split(",")
    devices = [warp_device(name.strip()) for name in names]
    if len(set(devices)) < len(devices):
        raise StrategyError(f"device {device!r} names one device twice; --workers says how many work on each")
    cores = len(os.sched_getaffinity(0))
    count = {name: workers or (cores if name == "cpu" else GPU_WORKERS) for name in devices}
    return [name for name in devices for _ in range(count[name])]


class PoseSpans:
    """Which poses are rendered next: spans in pose order, as large as the budget of one allows.

    budget: of a span's working arrays [byte]; pose_bytes, point_bytes: what they take for each; worker_count: who
    share the last poses.
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
        """Have poses rendered that were taken; they were too many."""
        if first < stop:
            heapq.heappush(self._left, (first, stop))
            self._pose_count += stop - first

    def learn(self, pose_count: int, point_count: int) -> None:
        """Size the next spans by what one took, with a quarter to spare for denser poses."""
        needed = self._pose_bytes + 1.25 * self._point_bytes * point_count / pose_count
        self._size = max(1, min(int(0.8 * self._budget / needed), GROWTH * pose_count))


class Crew:
    """Workers at their spans. At most twice as many chunks as workers are under way or wait for their turn."""

    def __init__(self, spans: PoseSpans, works: Sequence[Work]) -> None:
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
        """Everything handed in, in pose order; the threads live as long as this is gone through."""
        try:
            for thread in self._threads:
                thread.start()
            while (outcome := self._next()) is not None:
                if isinstance(outcome, BaseException):
                    raise outcome
                yield outcome
                del outcome  # or it would be kept until the next one is there
        finally:
            self._dismiss()

    def _next(self) -> Rendered | BaseException | None:
        """The earliest chunk that is still to come, waited for; None after the last."""
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

    def _run(self, work: Work) -> None:
        while (span := self._take()) is not None:
            try:
                outcome = work(*span)
            except BaseException as error:  # whatever it is, it is the consumer's
                outcome = error
            self._hand_in(span, outcome)
            del outcome  # or it would be kept until there is another

    def _take(self) -> tuple[int, int] | None:
        """The next span, waited for until there is room for its chunk; None when all is done."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_over() or self._may_take())
            if self._is_over():
                return None
            try:
                span = self._spans.take()
            except BaseException as error:  # or the consumer would wait for ever
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
            except BaseException as error:  # of a chunk that is none: the consumer's, too
                self._waiting[first] = error
            finally:
                self._changed.notify_all()

    def _earliest(self) -> int | None:
        left = () if self._spans.first is None else (self._spans.first,)
        return min([*self._waiting, *self._at_work, *left], default=None)

    def _is_over(self) -> bool:
        return self._stopped or (self._spans.first is None and not self._at_work)

    def _may_take(self) -> bool:
        # Never for ever: of the chunks that wait, the earliest goes out unless one before it is under way.
        return self._spans.first is not None and len(self._at_work) + len(self._waiting) < self._limit
