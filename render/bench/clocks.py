"""Clocks of `palpate bench`: turns taken in one process, the copy rate beside them, memory at its peak."""

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np
import warp as wp

from ..contour_batch import ContourBatch
from ..hands.hand import Palm
from ..intersection.mesh_section import intersect
from ..objects.mesh.solid_mesh import MeshObject
from ..strategies.intersection_strategy import IntersectionStrategy

CHUNK_POINTS = {True: 200_000_000, False: 10_000_000}  # of one launch, by whether it is on CUDA: 2.6 GB and 130 MB
CHUNK_POSES = {True: 4_000_000, False: 20_000}  # 4 GB of working arrays; 20 MB, which caches like
COPY_BYTES = {True: 2**30, False: 2**28}  # far beyond any cache
COPY_COUNT = {True: 20, False: 2}  # of one turn: on a GPU one copy takes 0.5 ms, and waiting for it a good part of that
POSE_BYTES, VERTEX_BYTES, POLYLINE_BYTES = 28, 12, 8
"""What any layout must at least move: a pose in, a distinct vertex and an offset out."""


@dataclass(frozen=True)
class Clocks:
    """Medians over the repetitions [s]."""

    cpu: float
    """Of the whole process, all threads."""
    wall: float
    repeats: int


Call = Callable[[], Any]


def timed(call: Call) -> tuple[float, float]:
    """CPU time of the process and wall time of one call [s].

    What it returns is freed after the clocks are read; and waited for, since a GPU's pool gives memory back to the
    system when it is next waited for, which would be in the time of whoever comes next.
    """
    cpu, wall = process_time(), perf_counter()
    kept = call()
    out = process_time() - cpu, perf_counter() - wall
    del kept
    wp.synchronize()
    return out


def interleaved(calls: Sequence[Call], repeats: int) -> list[Clocks]:
    """Time calls in turns, each once a round and the first one later every round; nothing is run to warm up."""
    taken = np.zeros((repeats, len(calls), 2))
    collecting = gc.isenabled()
    gc.disable()
    try:
        for turn in range(repeats):
            for place in range(len(calls)):
                index = (turn + place) % len(calls)
                taken[turn, index] = timed(calls[index])
            gc.collect()
    finally:
        if collecting:
            gc.enable()
    return [Clocks(float(cpu), float(wall), repeats) for cpu, wall in np.median(taken, axis=0)]


class CopyTurn:
    """Copies one large array to another on one device; counted are the bytes read and the bytes written."""

    def __init__(self, device: str) -> None:
        target = wp.get_device(device)
        size, self._count = COPY_BYTES[target.is_cuda], COPY_COUNT[target.is_cuda]
        self.bytes = 2 * size * self._count
        self._device = device
        with wp.ScopedMempool(target, False):  # these are no part of what rendering takes of the pool
            self._source = wp.zeros(size, dtype=wp.uint8, device=device)
            self._target = wp.zeros(size, dtype=wp.uint8, device=device)
        self()  # pages that nobody has written yet are slower

    def __call__(self) -> None:
        """Copy some times in a row."""
        for _ in range(self._count):
            wp.copy(self._target, self._source)
        wp.synchronize_device(self._device)

    def rate(self, clocks: Clocks) -> float:
        """Bytes read and written a second."""
        return self.bytes / clocks.wall


class OwnTurn:
    """Renders all poses on a device and leaves the results there; poses are uploaded beforehand."""

    def __init__(self, mesh: MeshObject, hand: Palm, pose: np.ndarray, strategy: IntersectionStrategy, device: str):
        self.mesh, self.hand, self.strategy, self.device = mesh, hand, strategy, device
        self.pose_count = len(pose)
        probe = wp.array(pose[:: max(1, len(pose) // 500)], dtype=wp.transform, device=device)
        points = intersect(mesh, hand, probe, strategy)[0].point_count / len(probe)
        size = chunk_size(points, wp.get_device(device).is_cuda)
        self._parts = [
            wp.array(pose[first : first + size], dtype=wp.transform, device=device)
            for first in range(0, len(pose), size)
        ]

    def __call__(self, timing: dict[str, float] | None = None) -> list[ContourBatch]:
        """All chunks; returns when the device is done."""
        batches = [intersect(self.mesh, self.hand, part, self.strategy, timing=timing)[0] for part in self._parts]
        wp.synchronize_device(self.device)
        return batches

    def stages(self) -> dict[str, float]:
        """Share of the time of each stage; each is waited for, which costs a little."""
        timing: dict[str, float] = {}
        self(timing)
        total = sum(timing.values())
        return {stage: seconds / total for stage, seconds in timing.items()} if total else {}


def chunk_size(points_per_pose: float, is_cuda: bool) -> int:
    """Poses of one launch, so that its results stay within bounds."""
    return max(1, min(CHUNK_POSES[is_cuda], int(CHUNK_POINTS[is_cuda] / max(points_per_pose, 1.0))))


@dataclass(frozen=True)
class Yield:
    """What a rendering gave, in total."""

    poses: int
    hit: int
    """Poses with contours."""
    points: int
    """The repeated first point of a closed polyline included."""
    vertices: int
    """Distinct points of polylines: without the repeated ones."""
    polylines: int
    bytes: int
    """Of all arrays."""

    @classmethod
    def of(cls, batches: Sequence[ContourBatch]) -> "Yield":
        """Count batches on the host or a device."""
        closed = sum(int(_host(batch.polyline_closed).sum(dtype=np.int64)) for batch in batches)
        points = sum(batch.point_count for batch in batches)
        return cls(
            poses=sum(batch.pose_count for batch in batches),
            hit=sum(int((np.diff(_host(batch.pose_start)) > 0).sum()) for batch in batches),
            points=points,
            vertices=points - closed,
            polylines=sum(batch.polyline_count for batch in batches),
            bytes=sum(_bytes(batch) for batch in batches),
        )

    @property
    def segments(self) -> int:
        """Lines between consecutive points."""
        return self.points - self.polylines

    def floor(self, copy_rate: float) -> float:
        """Seconds that moving the least any layout must move takes: each byte once, at the rate of a copy."""
        moved = POSE_BYTES * self.poses + VERTEX_BYTES * self.vertices + POLYLINE_BYTES * self.polylines
        return moved / copy_rate


def _host(array: Any) -> np.ndarray:
    return array.numpy() if isinstance(array, wp.array) else array


def _bytes(batch: ContourBatch) -> int:
    total = 0
    for array in batch.by_name().values():
        if isinstance(array, wp.array):
            total += array.size * wp.types.type_size_in_bytes(array.dtype)
        else:
            total += array.nbytes
    return total


class CountingAllocator:
    """A device's own allocator that also counts the bytes of the arrays that live."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner
        self.deallocate_requires_context_guard = inner.deallocate_requires_context_guard
        self.memory_kind = inner.memory_kind
        self.live = self.most = 0

    def allocate(self, size_in_bytes: int) -> int:
        """Pass on and count."""
        pointer = self._inner.allocate(size_in_bytes)
        self.live += size_in_bytes
        self.most = max(self.most, self.live)
        return pointer

    def deallocate(self, ptr: int, size_in_bytes: int) -> None:
        """Pass on and count."""
        self.live -= size_in_bytes
        self._inner.deallocate(ptr, size_in_bytes)


@dataclass(frozen=True)
class Peak:
    """Device memory of one rendering [byte], its poses apart."""

    arrays: int
    """Most that Warp's arrays took at once, results included; counted, exact."""
    pool: int | None
    """The same by the pool's high-water mark, temporaries of native code included; None where an earlier rendering
    reached higher, since the mark cannot be put back."""


def memory_peak(call: Call, device: str) -> tuple[Any, Peak | None]:
    """What one call returns, and its peak on a CUDA device with a memory pool; None on another."""
    target = wp.get_device(device)
    if not target.is_cuda or not wp.is_mempool_enabled(target):
        return call(), None
    counting = CountingAllocator(wp.get_device_allocator(target))
    wp.synchronize_device(target)
    used, high = wp.get_mempool_used_mem_current(target), wp.get_mempool_used_mem_high(target)
    with wp.ScopedAllocator(target, counting):
        kept = call()
        wp.synchronize_device(target)
    risen = wp.get_mempool_used_mem_high(target)
    return kept, Peak(counting.most, risen - used if risen > high else None)


def fitting_count(seconds_a_pose: float, seconds: float, least: int, most: int) -> int:
    """How many poses take about so long, as 1, 2 or 5 times a power of ten, within bounds."""
    wanted = max(1.0, seconds / max(seconds_a_pose, 1e-12))
    decade = 10 ** int(np.log10(wanted))
    rounded = max(step * decade for step in (1, 2, 5) if step * decade <= wanted)
    return max(least, min(most, rounded))
