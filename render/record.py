"""Render into a contour file, writing each chunk while the next is computed."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np

from ..datasets.header import FileHeader
from ..datasets.motion import HandMotion
from ..datasets.writer import ContourWriter
from .batch import MEMORY_DEFAULT, MEMORY_SMALLEST, Chunk, rendered_chunks, warp_device
from .contours import KINDS
from .errors import StrategyError
from .hands import Palm
from .objects import MeshObject
from .strategy import IntersectionStrategy

PACKAGES = ("palpate", "warp-lang", "numpy", "trimesh", "h5py")


@dataclass(frozen=True)
class Recording:
    """What recording a motion's contours came to."""

    path: Path
    pose_count: int
    rendered: int
    """Poses rendered by this call; the others were there already."""
    repairs: tuple[str, ...]
    """What resuming found damaged and rendered again."""


def file_header(
    thing: MeshObject, hand: Palm, motion: HandMotion, strategy: IntersectionStrategy, device: str
) -> FileHeader:
    """Everything of a contour file that is known before the first pose is rendered."""
    described = thing.described()
    return FileHeader(
        pose=motion.pose,
        time=motion.time,
        time_offset=motion.offset,
        seed=motion.seed,
        object_name=thing.name,
        vertices=thing.vertices,
        faces=thing.faces,
        placement=described["placement"],
        object_attributes={"triangles": described["triangles"], "report": described["report"]},
        hand=hand.described(),
        strategy=strategy.described(),
        versions={package: version(package) for package in PACKAGES},
        device=device,
    )


def metrics_of(chunk: Chunk) -> dict[str, np.ndarray]:
    """Per-pose metrics of a chunk, as the file names them."""
    return {
        "length": chunk.lengths.sum(axis=1, dtype=np.float64).astype(np.float32),
        **{f"length_{kind}": np.ascontiguousarray(chunk.lengths[:, k]) for kind, k in KINDS.items()},
        "polylines": np.diff(chunk.contours.pose_start).astype(np.int32),
    }


def record(
    path: str | Path,
    thing: MeshObject,
    hand: Palm,
    motion: HandMotion,
    strategy: IntersectionStrategy,
    *,
    mode: Literal["create", "resume", "overwrite"] = "create",
    device: str = "cpu",
    memory: int = MEMORY_DEFAULT,
    gzip: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Recording:
    """Render a motion into a contour file; what was reported done survives a kill and a full disk.

    mode: "create" refuses an existing file; "resume" goes on with an unfinished one of the same object, hand, motion,
    strategy and version; "overwrite" replaces it when the new one is whole. memory: budget of all working arrays
    [byte]; the motion itself (36 bytes a pose) and the object come on top. progress: called with the poses that are
    done, safe on the disk, and with all.
    Raises MeshError, StrategyError, MotionError as `render` does; ContourFileError for what the file refuses.
    """
    if strategy.needs_closed:
        thing.require_closed()
    device = warp_device(device)
    if memory < 4 * MEMORY_SMALLEST:
        raise StrategyError(f"memory must be at least {4 * MEMORY_SMALLEST} bytes to record, not {memory}")
    header = file_header(thing, hand, motion, strategy, device)
    with ContourWriter(path, header, mode=mode) as writer, ThreadPoolExecutor(1) as thread:
        missing = writer.missing()
        rendered = sum(stop - first for first, stop in missing)
        done = len(motion) - rendered
        if progress is not None:
            progress(done, len(motion))
        pending: Future[int] | None = None
        # A quarter for the working arrays: beside them, a chunk being written takes about three times its own size.
        for chunk in rendered_chunks(
            thing, hand, motion.pose, strategy, device=device, memory=memory // 4, ranges=missing
        ):
            done += _settled(pending, done, len(motion), progress)
            pending = thread.submit(_write_chunk, writer, chunk)
        _settled(pending, done, len(motion), progress)
        writer.seal(gzip=gzip)
        return Recording(Path(path), len(motion), rendered, writer.repairs)


def _write_chunk(writer: ContourWriter, chunk: Chunk) -> int:
    writer.write(chunk.first, chunk.stop, chunk.contours.arrays(), metrics_of(chunk), chunk.timing)
    return chunk.stop - chunk.first


def _settled(pending: Future[int] | None, done: int, total: int, progress: Callable[[int, int], None] | None) -> int:
    """Wait for the chunk under way; poses that are done with it."""
    if pending is None:
        return 0
    count = pending.result()
    if progress is not None:
        progress(done + count, total)
    return count
