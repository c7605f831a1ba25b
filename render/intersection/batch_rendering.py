"""Render many poses: chunks to a memory budget, by one worker or many, results in memory or chunk by chunk."""

import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, cast

import numpy as np
import warp as wp

from ...datasets.motions.hand_motion import HandMotion
from ...kernels.metrics.measure import measure_contours
from ...kernels.offsets import PointLimitError
from ..contour_batch import ContourBatch, join_batches
from ..coordinate_spacing import warn_of_spacing
from ..deprecated_names import accept_old_keywords
from ..errors import PoseError, StrategyError
from ..hands.hand import Hand
from ..objects.moving_object import object_poses
from ..objects.solid import Solid
from ..runtime.gpu_download import Downloader
from ..runtime.interrupt import interrupt_between
from ..runtime.span_workers import PoseSpans, SpanRenderer, WorkerThreads, warp_device
from ..strategies.intersection_strategy import IntersectionStrategy
from ..validation import is_number
from .scene import Scene

MEMORY_DEFAULT = 512 * 10**6  # [byte]; or more for many workers:
MEMORY_WORKER = {"cpu": 200 * 10**6, "cuda": 10**9}  # [byte] by kind of device; a GPU is full with 300,000 poses
MEMORY_SMALLEST = 2**20  # [byte]; room for one pose of any mesh that fits itself
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


def check_poses(motion: HandMotion | np.ndarray) -> np.ndarray:
    """Poses of a motion or an array, float32, shape [pose, 7]; an array is checked as a motion without time is.

    Raises PoseError or MotionError with the row.
    """
    if isinstance(motion, HandMotion):
        return motion.pose
    array = np.asarray(motion)
    if array.ndim != 2 or array.shape[1] != 7:
        raise PoseError(
            f"poses must be an array [pose, 7] (x y z, qx qy qz qw), not of shape {array.shape}; "
            "static_pose([x, y, z]) makes one of a position"
        )
    return HandMotion(None, array).pose


def memory_for(devices: Sequence[str]) -> int:
    """Memory that workers on these devices have together unless they are told another [byte]."""
    return max(MEMORY_DEFAULT, sum(MEMORY_WORKER["cpu" if name == "cpu" else "cuda"] for name in devices))


def checked_memory(memory: float | None, devices: Sequence[str], *, smallest: int = MEMORY_SMALLEST) -> int:
    """A budget [byte], by default `memory_for` the devices; raises StrategyError for one that is none or too small."""
    if memory is None:
        return memory_for(devices)
    if not is_number(memory):
        raise StrategyError(f"memory must be a number of bytes, not {memory!r}")
    if not smallest <= memory < np.inf:  # a NaN compares false
        raise StrategyError(f"memory must be at least {smallest} bytes, not {memory}")
    return int(memory)


def named_devices(device: str, devices: Sequence[str] | str | None) -> list[str]:
    """Full names of Warp's devices: of `devices`, or of `device` if that is None."""
    return [
        warp_device(name)
        for name in ([device] if devices is None else [devices] if isinstance(devices, str) else devices)
    ]


def rendered_chunks(
    scene: Scene,
    pose: np.ndarray,
    *,
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    ranges: Sequence[tuple[int, int]] | None = None,
) -> Generator[Chunk, None, None]:
    """Render poses of a scene chunk by chunk, in pose order.

    pose: float32, shape [pose, 7]; ranges: which poses, as (first, stop), by default all.
    devices: one worker on each of these Warp devices, a name as often as it has workers; by default one on `device`.
    memory: for the working arrays and results of all chunks that are computed, wait or are with the caller [byte]; by
    default `memory_for` the workers. Fewer work than `devices` names if a share of it would be below MEMORY_SMALLEST.
    The contours of a pose do not depend on the chunk that it is in, nor on who made it. The workers end with the
    generator: when it is exhausted, closed, or raises what one of them raised.
    """
    names = named_devices(device, devices)
    if not names:
        raise StrategyError("devices must name one device at least")
    memory = checked_memory(memory, names)
    scene.require_poses(len(pose))
    wanted = 2 * len(names) + 1
    names = names[: max(1, (memory // MEMORY_SMALLEST - 1) // 2)]  # fewer workers if memory is short
    rendering = _Rendering(scene, pose, memory, share_count=2 * len(names) + 1, share_count_wanted=wanted)
    on_cpus = all(wp.get_device(name).is_cpu for name in names)
    spans = PoseSpans(
        [(0, len(pose))] if ranges is None else ranges,
        budget=min(rendering.share, CPU_SPAN_BYTES) if on_cpus else rendering.share,
        pose_bytes=scene.pose_bytes,
        point_bytes=POINT_BYTES,
        worker_count=len(names),
    )
    if spans.first is None:
        return
    turns = {name: threading.Lock() for name in names}
    for name in turns:
        rendering.prepare(name)
    threads = WorkerThreads(spans, [rendering.work_on(name, turns[name]) for name in names])
    yield from cast(Iterator[Chunk], threads.chunks())


@dataclass(frozen=True)
class _Rendering:
    """State shared by all workers."""

    scene: Scene
    pose: np.ndarray
    memory: int
    share_count: int
    """Chunks that the memory is for: two of each worker, and the one that the caller has."""
    share_count_wanted: int
    """The same if all workers had room."""

    @property
    def share(self) -> int:
        """Memory of one chunk [byte]."""
        return self.memory // self.share_count

    def prepare(self, device: str) -> None:
        """Upload the object and load Warp's modules, once and by one thread: one pose takes all that chunks take."""
        self.scene.contours(self.pose[:1], 0, device)[0].lengths()

    def work_on(self, device: str, turn: threading.Lock) -> SpanRenderer:
        """Function of a worker on a device; workers of one GPU take turns in computing, and download at any time."""
        if wp.get_device(device).is_cpu:
            return lambda first, stop: self._fitting(first, stop, lambda *span: self._on_cpu(device, *span))
        down = Downloader(device)
        return lambda first, stop: self._fitting(first, stop, lambda *span: self._on_gpu(device, turn, down, *span))

    def _fitting(self, first: int, stop: int, make: Callable[[int, int], Chunk]) -> Chunk:
        """The chunk, or the beginning of it that fits the memory."""
        while True:
            try:
                return make(first, stop)
            except PointLimitError as error:
                if stop - first == 1:
                    raise StrategyError(
                        f"pose {first} alone has {error.count} points, too many for {self.memory} bytes of memory: "
                        f"raise the memory budget to {error.count * POINT_BYTES * self.share_count_wanted} bytes"
                    ) from error
                stop = first + (stop - first) // 2

    def _intersected(
        self, device: str, first: int, stop: int, timing: dict[str, float] | None
    ) -> tuple[ContourBatch, dict[str, np.ndarray]]:
        limit = self.share // POINT_BYTES
        return self.scene.contours(self.pose[first:stop], first, device, point_limit=limit, timing=timing)

    def _on_cpu(self, device: str, first: int, stop: int) -> Chunk:
        timing: dict[str, float] = {}
        started = time.perf_counter()
        batch, removed = self._intersected(device, first, stop, timing)
        lengths = batch.lengths()
        timing["total"] = time.perf_counter() - started
        return Chunk(first, stop, batch.numpy(), lengths, removed, timing)

    def _on_gpu(self, device: str, turn: threading.Lock, down: Downloader, first: int, stop: int) -> Chunk:
        started = time.perf_counter()
        with turn:
            batch, removed = self._intersected(device, first, stop, None)
            if not batch.on_device:
                timing = {"total": time.perf_counter() - started}
                return Chunk(first, stop, batch, batch.lengths(), removed, timing)
            lengths = measure_contours(batch.struct)
            down.start({**batch.by_name(), "lengths": lengths})
        del batch, lengths  # the downloader keeps them as long as they are needed
        host: dict[str, Any] = down.finish()
        lengths = host.pop("lengths")
        timing = {"total": time.perf_counter() - started}
        contours = replace(ContourBatch.from_arrays(host), raw_error=self.scene.raw_error)
        return Chunk(first, stop, contours, lengths, removed, timing)


@accept_old_keywords(thing="solid", moved="object_pose")
def render(
    solid: Solid,
    hand: Hand,
    motion: HandMotion | np.ndarray,
    strategy: IntersectionStrategy | str,
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    points: str = "array",
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> ContourBatch:
    """Contours of all poses, in memory on the host.

    motion: a HandMotion, or poses alone, shape [pose, 7]. object_pose: motion or poses of an object that moves, see
    `object_poses`.
    points: "array", or "patch" for points relative to the middle of their patch, along its u, v and n, which float32
    holds to 4e-9 m anywhere (`array_points` gives them in the array's frame in float64). devices: one worker on each
    of these Warp devices, by default one on `device`; the contours are the same. memory: budget of what is being
    computed [byte], results apart, by default `memory_for` the workers. progress: called with the number of poses done.
    Raises MeshError where the strategy needs a closed surface and the object has none; MotionError with the row of a
    bad pose; StrategyError for an unknown device, too small a budget, or points relative to patches of what is not a
    mesh cut by planes, or has stages that need points in the array's frame. Warns of coordinates that float32 does not
    hold to 1e-5 m.
    """
    return collect(
        solid,
        hand,
        motion,
        strategy,
        object_pose=object_pose,
        points=points,
        device=device,
        devices=devices,
        memory=memory,
        progress=progress,
    ).contours


class Collected(NamedTuple):
    """All contours of a motion, and what a file says of them beside."""

    scene: Scene
    contours: ContourBatch
    removed: dict[str, np.ndarray]
    """Length that each prune stage removed [m], float32, shape [pose], by name."""

    @property
    def removed_any(self) -> bool:
        """Whether prune stages removed anything: then there were contours."""
        return any(length.any() for length in self.removed.values())


def collect(
    solid: Solid,
    hand: Hand,
    motion: HandMotion | np.ndarray,
    strategy: IntersectionStrategy | str,
    *,
    object_pose: HandMotion | np.ndarray | None = None,
    points: str = "array",
    device: str = "cpu",
    devices: Sequence[str] | None = None,
    memory: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Collected:
    """Contours of all poses; arguments and errors as for `render`."""
    chunks: list[Chunk] = []
    pose = check_poses(motion)
    poses = None if object_pose is None else object_poses(object_pose, motion)
    scene = Scene.of(solid, hand, strategy, object_pose=poses, points=points)
    way = '; points="patch" keeps the points themselves exact, but not the poses'
    warn_of_spacing(solid.name, solid.bounds, pose, scene.object_pose, way=way)
    with interrupt_between() as raise_if_interrupted:
        for chunk in rendered_chunks(scene, pose, device=device, devices=devices, memory=memory):
            chunks.append(chunk)
            if progress is not None:
                progress(chunk.stop)
            raise_if_interrupted()
    names = dict.fromkeys(name for chunk in chunks for name in chunk.removed)
    removed = {name: np.concatenate([chunk.removed[name] for chunk in chunks]) for name in names}
    return Collected(scene, join_batches([chunk.contours for chunk in chunks]), removed)


def is_too_large(error: Exception) -> bool:
    """Whether a smaller batch may do: too many points, or no memory for them."""
    is_allocation = isinstance(error, RuntimeError) and "allocate" in str(error)
    return isinstance(error, PointLimitError | MemoryError) or is_allocation
