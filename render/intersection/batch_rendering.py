"""Render many poses: chunks to a memory budget, by one worker or many, results in memory or chunk by chunk."""

import threading
import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np
import warp as wp

from ...kernels.contours import measure_contours
from ...kernels.offsets import PointLimitError
from ..contour_batch import ContourBatch, join_batches
from ..errors import StrategyError
from ..runtime.gpu_download import Downloader
from ..runtime.interrupt import interrupt_between
from ..runtime.span_workers import PoseSpans, chunks_in_order
from .job import MEMORY_SMALLEST, ContourJob

POINT_BYTES = 28  # of a contour's point and its share of the polylines: 13 and up to 13
CPU_SPAN_BYTES = 96 * 2**20  # working arrays of a span on CPUs at most: larger ones are no faster, and end less evenly


@dataclass(frozen=True)
class Chunk:
    """Contours of the poses first..stop, on the host."""

    first: int
    stop: int
    contours: ContourBatch
    lengths: np.ndarray
    """[m], float32, shape [pose, 3]: object, hand, made."""
    removed: dict[str, np.ndarray] = field(default_factory=dict)
    """Length that each prune stage removed [m], float32, shape [pose], by name."""
    timing: dict[str, float] = field(default_factory=dict)
    """Seconds by stage; on a GPU in all only, since stages would have to be waited for."""

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.contours.point_count


def rendered_chunks(job: ContourJob, ranges: Sequence[tuple[int, int]] | None = None) -> Generator[Chunk, None, None]:
    """Render a job chunk by chunk, in pose order; ranges: which poses, as (first, stop), by default all.

    Fewer workers than the job has devices work if a share of the memory would be below MEMORY_SMALLEST. The contours of
    a pose do not depend on the chunk that it is in, nor on who made it. The workers end with the generator: when it is
    exhausted, closed, or raises what one of them raised.
    """
    devices = job.devices[: max(1, (job.memory // MEMORY_SMALLEST - 1) // 2)]
    share = job.memory // _share_count(devices)
    on_cpus = all(wp.get_device(name).is_cpu for name in devices)
    spans = PoseSpans(
        [(0, len(job.motion))] if ranges is None else ranges,
        budget=min(share, CPU_SPAN_BYTES) if on_cpus else share,
        pose_bytes=job.scene.pose_bytes,
        point_bytes=POINT_BYTES,
        worker_count=len(devices),
    )
    if spans.first is None:
        return
    turns = {name: threading.Lock() for name in devices}
    for name in turns:  # uploads the object and loads Warp's modules once, by one thread: one pose takes all of them
        job.scene.contours(job.motion.pose[:1], 0, name)[0].lengths()
    workers = [_Worker(job, name, share, turns[name]) for name in devices]
    yield from cast(Iterator[Chunk], chunks_in_order(spans, workers))


def _share_count(devices: Sequence[str]) -> int:
    """Chunks that a job's memory is for: two of each worker, and the one that the caller has."""
    return 2 * len(devices) + 1


class _Worker:
    """Renders poses of a job on one device; workers of one GPU take turns in computing, and download at any time."""

    def __init__(self, job: ContourJob, device: str, share: int, turn: threading.Lock) -> None:
        self._job, self._device, self._turn = job, device, turn
        self._limits: dict[str, Any] = {"device": device, "point_limit": share // POINT_BYTES}
        self._down = None if wp.get_device(device).is_cpu else Downloader(device)

    def __call__(self, first: int, stop: int) -> Chunk:
        """Contours of the poses first..stop, or of as many from the first as fit the memory."""
        while True:
            try:
                return self._on_cpu(first, stop) if self._down is None else self._on_gpu(first, stop, self._down)
            except PointLimitError as error:
                if stop - first == 1:
                    needed = error.count * POINT_BYTES * _share_count(self._job.devices)
                    raise StrategyError(
                        f"pose {first} alone has {error.count} points, too many for {self._job.memory} bytes of memory:"
                        f" raise the memory budget to {needed} bytes"
                    ) from error
                stop = first + (stop - first) // 2

    def _on_cpu(self, first: int, stop: int) -> Chunk:
        timing: dict[str, float] = {}
        started = time.perf_counter()
        pose = self._job.motion.pose[first:stop]
        batch, removed = self._job.scene.contours(pose, first, **self._limits, timing=timing)
        lengths = batch.lengths()
        timing["total"] = time.perf_counter() - started
        return Chunk(first, stop, batch.numpy(), lengths, removed, timing)

    def _on_gpu(self, first: int, stop: int, down: Downloader) -> Chunk:
        started = time.perf_counter()
        with self._turn:
            pose = self._job.motion.pose[first:stop]
            batch, removed = self._job.scene.contours(pose, first, **self._limits)
            if not batch.on_device:
                timing = {"total": time.perf_counter() - started}
                return Chunk(first, stop, batch, batch.lengths(), removed, timing)
            lengths = measure_contours(batch.struct)
            down.start({**batch.by_name(), "lengths": lengths})
        del batch, lengths  # the downloader keeps them as long as they are needed
        host: dict[str, Any] = down.finish()
        lengths = host.pop("lengths")
        timing = {"total": time.perf_counter() - started}
        contours = replace(ContourBatch.from_arrays(host), raw_error=self._job.scene.raw_error)
        return Chunk(first, stop, contours, lengths, removed, timing)


def collect(job: ContourJob) -> tuple[ContourBatch, dict[str, np.ndarray]]:
    """Contours of all poses, on the host, and the length that each prune stage removed [m], float32 [pose], by name."""
    chunks: list[Chunk] = []
    with interrupt_between() as raise_if_interrupted:
        for chunk in rendered_chunks(job):
            chunks.append(chunk)
            job.report(chunk.stop)
            raise_if_interrupted()
    names = dict.fromkeys(name for chunk in chunks for name in chunk.removed)
    removed = {name: np.concatenate([chunk.removed[name] for chunk in chunks]) for name in names}
    return join_batches([chunk.contours for chunk in chunks]), removed


def removes_any(removed: dict[str, np.ndarray]) -> bool:
    """Whether prune stages removed anything: then there were contours; removed: as `collect` gives it."""
    return any(length.any() for length in removed.values())


def is_too_large(error: Exception) -> bool:
    """Whether a smaller batch may do: too many points, or no memory for them."""
    is_allocation = isinstance(error, RuntimeError) and "allocate" in str(error)
    return isinstance(error, PointLimitError | MemoryError) or is_allocation
