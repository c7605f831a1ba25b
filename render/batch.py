"""Render many poses: chunks to a memory budget, results in memory or chunk by chunk."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import warp as wp

from ..datasets.motion import HandMotion
from ..kernels.slice import CrossingLimitError
from .contours import ContourBatch, join_batches
from .errors import PoseError, StrategyError
from .hands import Palm
from .objects import MeshObject
from .strategy import IntersectionStrategy, intersect

MEMORY_DEFAULT = 512 * 2**20  # [byte]
MEMORY_SMALLEST = 2**20  # [byte]; room for one pose of any mesh that fits itself
CROSSING_BYTES = 160  # all stages' arrays per crossing of a mesh edge, added up as if none were freed: 117, and room
SECTION_BYTES = 256  # the same per pose and patch
POSES_FIRST = 2048  # of the first chunk, which tells how large the others may be


@dataclass(frozen=True)
class Chunk:
    """Contours of the poses first..stop, on the host."""

    first: int
    stop: int
    contours: ContourBatch
    lengths: np.ndarray
    """[m], float32, shape [pose, 3]: object, hand, made."""
    timing: dict[str, float] = field(default_factory=dict)
    """Seconds by stage."""


def warp_device(name: str) -> str:
    """The Warp device of that name.

    Raises StrategyError, listing what there is, for one that this machine lacks.
    """
    known = [str(device) for device in wp.get_devices()]
    if name not in known and not (name == "cuda" and "cuda:0" in known):
        raise StrategyError(f"no device {name!r} on this machine; there is: {', '.join(known)}")
    return str(wp.get_device(name))


def check_poses(motion: HandMotion | np.ndarray) -> np.ndarray:
    """Poses of a motion or an array, float32, shape [pose, 7]; an array is checked as a motion without time is.

    Raises PoseError or MotionError with the row.
    """
    if isinstance(motion, HandMotion):
        return motion.pose
    array = np.asarray(motion)
    if array.ndim != 2 or array.shape[1] != 7:
        raise PoseError(f"poses must be an array [pose, 7] (x y z, qx qy qz qw), not of shape {array.shape}")
    return HandMotion(None, array).pose


def rendered_chunks(
    thing: MeshObject,
    hand: Palm,
    pose: np.ndarray,
    strategy: IntersectionStrategy,
    *,
    device: str = "cpu",
    memory: int = MEMORY_DEFAULT,
    ranges: Sequence[tuple[int, int]] | None = None,
) -> Iterator[Chunk]:
    """Render poses chunk by chunk, each small enough for `memory` bytes of working arrays.

    pose: float32, shape [pose, 7]; ranges: which poses, as (first, stop), by default all.
    The contours of a pose do not depend on the chunk that it is in.
    """
    if memory < MEMORY_SMALLEST:
        raise StrategyError(f"memory must be at least {MEMORY_SMALLEST} bytes, not {memory}")
    if strategy.needs_closed:
        thing.require_closed()
    device = warp_device(device)
    limit = memory // CROSSING_BYTES
    pose_bytes = SECTION_BYTES * hand.patch_count
    size = max(1, min(POSES_FIRST, memory // (4 * pose_bytes)))
    for first, stop in ranges if ranges is not None else [(0, len(pose))]:
        while first < stop:
            last = min(stop, first + size)
            try:
                chunk, crossing_count = _render_chunk(thing, hand, pose, (first, last), strategy, device, limit)
            except CrossingLimitError as error:
                if last - first == 1:
                    raise StrategyError(
                        f"pose {first} alone crosses {error.count} mesh edges, too many for {memory} bytes of memory: "
                        f"raise the memory budget to {error.count * CROSSING_BYTES} bytes"
                    ) from error
                size = max(1, (last - first) // 2)
                continue
            yield chunk
            needed = pose_bytes + 1.25 * CROSSING_BYTES * crossing_count / (last - first)
            size = max(1, min(int(0.8 * memory / needed), 4 * size))
            first = last


def _render_chunk(
    thing: MeshObject,
    hand: Palm,
    pose: np.ndarray,
    span: tuple[int, int],
    strategy: IntersectionStrategy,
    device: str,
    limit: int,
) -> tuple[Chunk, int]:
    timing: dict[str, float] = {}
    started = time.perf_counter()
    poses = wp.array(pose[span[0] : span[1]], dtype=wp.transform, device=device)
    on_device, crossing_count = intersect(thing, hand, poses, strategy, crossing_limit=limit, timing=timing)
    lengths = on_device.lengths()
    contours = on_device.numpy()
    timing["total"] = time.perf_counter() - started
    return Chunk(span[0], span[1], contours, lengths, timing), crossing_count


def render(
    thing: MeshObject,
    hand: Palm,
    motion: HandMotion | np.ndarray,
    strategy: IntersectionStrategy,
    *,
    device: str = "cpu",
    memory: int = MEMORY_DEFAULT,
    progress: Callable[[int], None] | None = None,
) -> ContourBatch:
    """Contours of all poses, in memory on the host.

    motion: a HandMotion, or poses alone, shape [pose, 7]. memory: budget of the working arrays [byte], results apart.
    progress: called with the number of poses done.
    Raises MeshError where the strategy needs a closed surface and the object has none; MotionError with the row of a
    bad pose; StrategyError for an unknown device or too small a budget.
    """
    batches = []
    for chunk in rendered_chunks(thing, hand, check_poses(motion), strategy, device=device, memory=memory):
        batches.append(chunk.contours)
        if progress is not None:
            progress(chunk.stop)
    return join_batches(batches)
